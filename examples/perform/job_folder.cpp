// SPDX-License-Identifier: MIT
#include "job_folder.hpp"

#include <fstream>
#include <sstream>

#include "traceur/core/version.hpp"
#include "traceur/io/atomic_file.hpp"

namespace perform {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

namespace {

Json to_json(const Eigen::MatrixXd& m) {
  return Json{{"rows", m.rows()}, {"cols", m.cols()}, {"values", std::vector<double>(m.data(), m.data() + m.size())}};
}

Eigen::MatrixXd to_matrix(const Json& j) {
  const auto rows = j.at("rows").get<Eigen::Index>(), cols = j.at("cols").get<Eigen::Index>();
  const auto values = j.at("values").get<std::vector<double>>();
  if (rows < 0 || cols < 0 || static_cast<std::size_t>(rows * cols) != values.size())
    throw traceur::Error("a matrix has the wrong size");
  return Eigen::Map<const Eigen::MatrixXd>(values.data(), rows, cols);
}

/// Runs `read` and names the file in whatever it complains about.
template <class F>
auto reading(const fs::path& path, F&& read) {
  try {
    return read();
  } catch (const Json::exception&) {
    throw traceur::Error(path.string() + ": expected a state file of this program");
  } catch (const traceur::Error& e) {
    throw traceur::Error(path.string() + ": " + e.what());
  }
}

}  // namespace

void JobFolder::begin(const Json& arguments, const std::string& digest) const {
  std::error_code failure;
  fs::create_directories(folder_, failure);
  if (failure) throw traceur::Error(folder_.string() + ": cannot be made: " + failure.message());
  for (const char* name : {"job.json", "open_loop.json", "cycle.json", "learning.json"})
    fs::remove(folder_ / name, failure);
  const Json job{{"version", traceur::core::version_string}, {"digest", digest}, {"arguments", arguments}};
  traceur::io::write_atomically(folder_ / "job.json", job.dump(2) + "\n");
}

Json JobFolder::read_job() const {
  const fs::path path = folder_ / "job.json";
  if (!fs::exists(path))
    throw traceur::Error("--resume: " + folder_.parent_path().string() + " holds no job to continue");
  return read(path);
}

void JobFolder::check(const std::string& digest) const {
  const Json job = read_job();
  const std::string where = (folder_ / "job.json").string();
  if (job.value("version", "") != traceur::core::version_string)
    throw traceur::Error(where + ": begun by another version of this program");
  if (job.value("digest", "") != digest)
    throw traceur::Error(where + ": the clip, character or terrain has changed since the job began");
}

Json JobFolder::read(const fs::path& path) const {
  std::ifstream in(path, std::ios::binary);
  if (!in) throw traceur::Error(path.string() + ": cannot be opened");
  return reading(path, [&] { return Json::parse(in); });
}

void JobFolder::save(const std::string& name, const SavedSearch& search) const {
  const auto& r = search.result;
  const Json j{{"offsets", to_json(r.offsets)},
               {"targets", to_json(r.targets)},
               {"poses", to_json(r.poses)},
               {"velocities", to_json(r.velocities)},
               {"tied_offsets", to_json(r.tied_offsets)},
               {"round_cost", r.round_cost},
               {"mean_joint_error", r.mean_joint_error},
               {"mean_local_error", r.mean_local_error},
               {"worst_tick_error", r.worst_tick_error},
               {"simulated_seconds", r.simulated_seconds},
               {"wall_s", search.wall_s}};
  traceur::io::write_atomically(folder_ / (name + ".json"), j.dump() + "\n");
}

std::optional<SavedSearch> JobFolder::load_search(const std::string& name) const {
  const fs::path path = folder_ / (name + ".json");
  if (!fs::exists(path)) return std::nullopt;
  const Json j = read(path);
  return reading(path, [&] {
    SavedSearch s;
    s.result.offsets = to_matrix(j.at("offsets"));
    s.result.targets = to_matrix(j.at("targets"));
    s.result.poses = to_matrix(j.at("poses"));
    s.result.velocities = to_matrix(j.at("velocities"));
    s.result.tied_offsets = to_matrix(j.at("tied_offsets"));
    s.result.round_cost = j.at("round_cost").get<std::vector<double>>();
    s.result.mean_joint_error = j.at("mean_joint_error").get<double>();
    s.result.mean_local_error = j.at("mean_local_error").get<double>();
    s.result.worst_tick_error = j.at("worst_tick_error").get<double>();
    s.result.simulated_seconds = j.at("simulated_seconds").get<double>();
    s.wall_s = j.at("wall_s").get<double>();
    return std::optional<SavedSearch>(s);
  });
}

void JobFolder::save(const SavedLearning& learning) const {
  std::ostringstream optimizer;
  learning.optimizer.save(optimizer);
  const auto& p = learning.progress;
  const Json j{
      {"generation", p.generation},      {"seconds", p.seconds},           {"perturbation", p.perturbation},
      {"mean_cost", p.mean_cost},        {"mean_success", p.mean_success}, {"best_validation", p.best_validation},
      {"best_law", to_json(p.best_law)}, {"since_best", p.since_best},     {"simulated_seconds", p.simulated_seconds},
      {"wall_s", learning.wall_s},       {"look_at", learning.look_at},    {"optimizer", optimizer.str()}};
  traceur::io::write_atomically(folder_ / "learning.json", j.dump() + "\n");
}

std::optional<SavedLearning> JobFolder::load_learning() const {
  const fs::path path = folder_ / "learning.json";
  if (!fs::exists(path)) return std::nullopt;
  const Json j = read(path);
  return reading(path, [&] {
    traceur::control::FeedbackProgress p;
    p.generation = j.at("generation").get<int>();
    p.seconds = j.at("seconds").get<double>();
    p.perturbation = j.at("perturbation").get<double>();
    p.mean_cost = j.at("mean_cost").get<double>();
    p.mean_success = j.at("mean_success").get<double>();
    p.best_validation = j.at("best_validation").get<double>();
    p.best_law = to_matrix(j.at("best_law"));
    p.since_best = j.at("since_best").get<int>();
    p.simulated_seconds = j.at("simulated_seconds").get<double>();
    std::istringstream optimizer(j.at("optimizer").get<std::string>());
    return std::optional<SavedLearning>(SavedLearning{p, traceur::optimize::CmaEs::load(optimizer),
                                                      j.at("wall_s").get<double>(), j.value("look_at", 0)});
  });
}

}  // namespace perform
