// SPDX-License-Identifier: MIT
#include "engines.hpp"

#include <algorithm>
#include <cmath>

#include "simulators.hpp"
#include "traceur/control/engine.hpp"

namespace example {

using namespace traceur;

namespace {

/// At the 240 Hz that controllers are learnt with, some engines lose gaits that they keep at smaller steps.
constexpr double engine_hz = 960;

/// A model of sim::Simulator that stands for a plain one.
class EngineLane {
public:
  EngineLane(const sim::Model& model, double dt, std::unique_ptr<PlainSimulator> plain)
      : model_(&model), dt_(dt), plain_(std::move(plain)) {}

  int lanes() const { return 1; }
  const body::Character& character() const { return model_->character; }
  double dt() const { return dt_; }
  void reset(int, const Eigen::VectorXd& q, const Eigen::VectorXd& v) { plain_->reset(q.data(), v.data()); }
  void set_target(int, const Eigen::VectorXd& q) { plain_->set_target(q.data()); }
  void push(int, int joint, const core::Vector3<double>& force, const core::Vector3<double>& point) {
    double f[3], p[3];
    force.store(f);
    point.store(p);
    plain_->push(joint, f, p);
  }
  void hold(int, int joint, const core::Vector3<double>& point, const core::Vector3<double>& anchor) {
    double p[3], a[3];
    point.store(p);
    anchor.store(a);
    plain_->hold(joint, p, a);
  }
  void release(int, int joint) { plain_->release(joint); }
  core::Vector3<double> contact_force(int, int joint) const {
    double f[3];
    plain_->contact_force(joint, f);
    return core::Vector3<double>::from(f);
  }
  void step(int count) { plain_->step(count); }
  void pose(int, Eigen::VectorXd& q) const { plain_->pose(q.data()); }
  void velocity(int, Eigen::VectorXd& v) const { plain_->velocity(v.data()); }
  bool failed(int) const { return plain_->failed(); }

private:
  const sim::Model* model_;
  double dt_;
  std::unique_ptr<PlainSimulator> plain_;
};

}  // namespace

std::shared_ptr<Engine> make_engine(const std::string& name, const std::string& character, const sim::Model& model,
                                    const std::vector<const terrain::HeightGrid*>& terrain, const sim::Parameters& parameters) {
  const SimulatorChoice choice = find_simulator(name);
  if (!choice.factory) return nullptr;
  EngineRequest request;
  request.character = character.c_str();
  request.parameters = parameters;
  request.parameters.dt = parameters.dt / std::ceil(engine_hz * parameters.dt - 1e-9);
  // One character each: what has fallen is then not simulated further.
  std::vector<EngineLane> lanes;
  for (std::size_t l = 0; l < core::lane_count<Lane>; ++l) {
    request.heights_m = nullptr;
    if (const terrain::HeightGrid* g = terrain.empty() ? nullptr : terrain[std::min(l, terrain.size() - 1)]) {
      request.heights_m = g->heights().data();
      request.nx = g->nx();
      request.ny = g->ny();
      request.cell_m = g->cell();
      request.x0_m = g->x0();
      request.y0_m = g->y0();
    }
    char fault[400] = "";
    std::unique_ptr<PlainSimulator> plain(choice.factory(request, fault, sizeof fault));
    if (!plain) throw Error("--simulator " + name + ": " + fault);
    lanes.emplace_back(model, request.parameters.dt, std::move(plain));
  }
  return control::engine_of<Lane>(std::move(lanes));
}

std::vector<std::shared_ptr<Engine>> make_engines(const std::string& name, const std::string& character, const sim::Model& model,
                                                  const terrain::HeightGrid* terrain, const sim::Parameters& parameters, int count) {
  std::vector<std::shared_ptr<Engine>> out;
  for (int worker = 0; worker < count; ++worker)
    if (auto engine = make_engine(name, character, model, {terrain}, parameters)) out.push_back(std::move(engine));
  return out;
}

}  // namespace example
