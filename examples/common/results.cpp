// SPDX-License-Identifier: MIT
#include "results.hpp"

#include <cstdio>

#include "files.hpp"
#include "traceur/body/kinematics.hpp"
#include "traceur/io/atomic_file.hpp"
#include "traceur/io/safetensors.hpp"

namespace example {

using namespace traceur;
namespace fs = std::filesystem;

fs::path default_character() {
  const fs::path inside = fs::path("characters") / "humanoid.xml";
  fs::path found = fs::path(TRACEUR_EXAMPLES_DIR) / inside;
  std::error_code failure;
  if (fs::exists(found, failure)) return found;
  const fs::path program = fs::read_symlink("/proc/self/exe", failure);
  return program.parent_path().parent_path() / "share" / "traceur" / inside;
}

fs::path absolute_path(const fs::path& path) { return path.empty() ? path : fs::absolute(path).lexically_normal(); }

void check_writable(const fs::path& folder, const fs::path& file) {
  std::error_code failure;
  if (!folder.empty()) fs::create_directories(folder, failure);
  if (failure) throw Error(folder.string() + ": cannot be made: " + failure.message());
  if (!fs::exists(file) || fs::is_regular_file(file)) io::AtomicFile(file).write("");
  if (fs::is_directory(file)) throw Error(file.string() + ": is a folder; expected a file");
}

std::string rounded(double x, int digits) {
  char text[32];
  std::snprintf(text, sizeof text, "%.*f", digits, x);
  return text;
}

int write_report(const fs::path& path, nlohmann::ordered_json report, double wall_s, const Ending& ending) {
  report["wall_s"] = wall_s;
  report["status"] = ending.status;
  if (!ending.why.empty()) report["why"] = ending.why;
  io::write_atomically(path, report.dump(2) + "\n");
  std::printf("%s%s\nreport: %s\n", ending.status.c_str(), ending.why.empty() ? "" : (": " + ending.why).c_str(), path.string().c_str());
  return ending.status == "done" ? 0 : 1;
}

Error not_written_by(const fs::path& path, const std::string& program) {
  return Error(path.string() + ": expected what a run of " + program + " wrote");
}

nlohmann::ordered_json saved_arguments(const fs::path& path, const std::string& program) {
  const io::Safetensors file = read_tensors(path);
  const auto found = file.metadata.find("arguments");
  nlohmann::ordered_json json;
  if (found != file.metadata.end()) json = nlohmann::ordered_json::parse(found->second, nullptr, false);
  if (!json.is_object()) throw not_written_by(path, program);
  return json;
}

io::ReplayTerrain replay_terrain(const terrain::HeightGrid& grid) {
  io::ReplayTerrain t;
  t.nx = grid.nx();
  t.ny = grid.ny();
  t.dx = static_cast<float>(grid.cell());
  t.x0 = static_cast<float>(grid.center_x(0));
  t.y0 = static_cast<float>(grid.center_y(0));
  for (int j = 0; j < grid.ny(); ++j)
    for (int i = 0; i < grid.nx(); ++i) t.heights.push_back(static_cast<float>(grid(i, j)));
  return t;
}

io::ReplayCharacter replay_character(const body::Character& c) {
  io::ReplayCharacter out;
  for (const body::Joint& j : c.skeleton.joints()) out.bodies.push_back({j.body, j.parent});
  const auto f = [](double x) { return static_cast<float>(x); };
  for (const body::Shape& s : c.shapes) {
    io::ReplayShape shape;
    shape.kind = s.kind == body::Shape::Kind::sphere    ? io::ReplayShape::Kind::sphere
                 : s.kind == body::Shape::Kind::capsule ? io::ReplayShape::Kind::capsule
                                                        : io::ReplayShape::Kind::box;
    shape.body = s.body;
    shape.position = {f(s.position.x), f(s.position.y), f(s.position.z)};
    shape.rotation = {f(s.rotation.x), f(s.rotation.y), f(s.rotation.z), f(s.rotation.w)};
    shape.size = {f(s.size.x), f(s.size.y), f(s.size.z)};
    out.shapes.push_back(shape);
  }
  return out;
}

std::vector<float> replay_poses(const body::Skeleton& skeleton, const Eigen::MatrixXd& poses) {
  std::vector<float> out;
  body::Frames<double> frames(skeleton);
  for (Eigen::Index k = 0; k < poses.cols(); ++k) {
    body::forward_kinematics(skeleton, poses.col(k).data(), frames);
    for (std::size_t b = 0; b < frames.position.size(); ++b) {
      const auto& p = frames.position[b];
      const auto& r = frames.rotation[b];
      for (const double x : {p.x, p.y, p.z, r.x, r.y, r.z, r.w}) out.push_back(static_cast<float>(x));
    }
  }
  return out;
}

}  // namespace example
