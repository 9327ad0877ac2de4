// SPDX-License-Identifier: MIT
#include "report.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <map>
#include <numbers>

#include "../common/plot.hpp"
#include "../common/progress.hpp"
#include "../common/results.hpp"
#include "protocols.hpp"
#include "traceur/core/error.hpp"
#include "traceur/io/atomic_file.hpp"
#include "traceur/io/controller_file.hpp"
#include "trainer.hpp"

namespace terrain_runner {

using namespace traceur;
using example::Axes;
using example::Mark;
using example::rounded;
using example::Series;
using parameterize::Continuation;
using parameterize::NodeStatus;
using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

namespace {

constexpr const char* blue = "#2b6cb0";
constexpr const char* orange = "#c05621";
constexpr const char* green = "#2f855a";
constexpr const char* grey = "#718096";
constexpr const char* colors[] = {blue, orange, green, "#6b46c1"};

/// How nodes of each status are drawn, in the legend's order.
struct StatusLook {
  NodeStatus status;
  const char* name;
  Mark mark;
  const char* color;
};
constexpr StatusLook looks[] = {{NodeStatus::solved, "solved", Mark::disc, blue},
                                {NodeStatus::extrapolated, "extrapolated", Mark::ring, green},
                                {NodeStatus::failed, "failed", Mark::square, orange},
                                {NodeStatus::untried, "untried", Mark::small_ring, grey}};

std::string counts(const Continuation& c) {
  std::string out = std::to_string(c.node_count()) + " nodes";
  for (const StatusLook& look : looks)
    if (c.count(look.status) > 0) out += ", " + std::to_string(c.count(look.status)) + " " + look.name;
  return out + "; " + std::to_string(c.evaluations()) + " runs of its continuation";
}

/// A series for each status; `place(node)` is where a node is drawn. Nodes are labelled with the round in which they
/// were last tried, where there was one.
template <class Place>
std::vector<Series> nodes_by_status(const std::vector<const Continuation*>& all, bool label, Place&& place) {
  std::vector<Series> out;
  for (const StatusLook& look : looks) {
    Series s{look.name, look.mark, look.color, {}};
    for (std::size_t k = 0; k < all.size(); ++k)
      for (int n = 0; n < all[k]->node_count(); ++n) {
        if (all[k]->status(n) != look.status) continue;
        s.points.push_back(place(*all[k], k, n));
        const int round = label ? all[k]->tested_round(n) : 0;
        s.labels.push_back(n == all[k]->seed() && label ? "0" : round > 0 ? std::to_string(round) : "");
      }
    if (!s.points.empty()) out.push_back(s);
  }
  return out;
}

std::vector<double> values(const Eigen::VectorXd& axis) { return {axis.data(), axis.data() + axis.size()}; }

std::string step_lengths(const std::vector<NodeResult>& nodes, const plan::StepLength<double>& line, double& residual) {
  Series straight{"straight ahead", Mark::dot, blue, {}}, turning{"turning", Mark::dot, green, {}};
  std::vector<double> speeds, lengths;
  for (const NodeResult& n : nodes) {
    if (!(n.judgement.share > 0.5)) continue;
    (n.task.turn == 0 ? straight : turning).points.push_back({n.judgement.speed, n.judgement.step_length});
    speeds.push_back(n.judgement.speed);
    lengths.push_back(n.judgement.step_length);
  }
  if (speeds.empty()) throw Error("plot: no node of running holds, so there are no steps to measure");
  residual = line.residual(speeds, lengths);
  const auto [least, most] = std::ranges::minmax(speeds);
  const auto along = [&](const plan::StepLength<double>& l) {
    return std::vector<std::pair<double, double>>{{least, l(least)}, {most, l(most)}};
  };
  const plan::StepLength<double> paper{0.2, 0.17};
  return example::chart(
      "Step length against speed", {"speed, m/s", "step length, m"},
      {{rounded(line.slope, 2) + " v + " + rounded(line.offset, 2) + ", planned with", Mark::line, blue, along(line)},
       {"0.2 v + 0.17, the paper", Mark::dashed_line, grey, along(paper)},
       turning,
       straight});
}

/// One obstacle's skill.
struct Found {
  Kind kind;
  Continuation found;
};

std::vector<Found> obstacle_skills(const fs::path& folder) {
  std::vector<Found> out;
  for (const Kind kind : kinds)
    if (auto c = read_stage(folder, name_of(kind))) out.push_back({kind, std::move(*c)});
  return out;
}

std::string obstacle_range(const std::vector<Found>& skills) {
  std::vector<const Continuation*> all;
  Axes axes{"size of the obstacle, m", ""};
  for (std::size_t k = 0; k < skills.size(); ++k) {
    all.push_back(&skills[k].found);
    axes.y_names.push_back(name_of(skills[k].kind));
    axes.y_ticks.push_back(static_cast<double>(k));
  }
  if (skills.size() == 1) axes.x_label = obstacle_sizes[index_of(skills[0].kind)].size;
  return example::chart("Obstacles: nodes, and which round tried them last", axes,
                        nodes_by_status(all, true, [](const Continuation& c, std::size_t k, int n) {
                          return std::pair{c.parameter(n)[0], static_cast<double>(k)};
                        }));
}

/// Shares of trials that train's report tells of, for each skill that it tells of.
std::vector<Series> success_shares(const fs::path& path, const std::vector<Found>& skills) {
  std::vector<Series> out;
  if (!fs::exists(path)) return out;
  std::ifstream in(path);
  const nlohmann::json json = nlohmann::json::parse(in, nullptr, false);
  if (!json.is_object()) throw Error(path.string() + ": expected a report of train, in JSON");
  for (const Found& s : skills) {
    const char* name = name_of(s.kind);
    if (!json.contains(name)) continue;
    const std::string where = path.string() + ": field '" + name + "'";
    const io::detail::FieldReader fields(json[name], where);
    const nlohmann::json& heights = fields.at("heights");
    if (!heights.is_array()) throw Error(where + ": field 'heights': expected a list");
    Series dots{name, Mark::dot, colors[out.size() / 2 % std::size(colors)], {}};
    for (std::size_t i = 0; i < heights.size(); ++i) {
      const io::detail::FieldReader row(heights[i], where + ": field 'heights': entry " + std::to_string(i));
      const double trials = row.number("trials");
      if (trials >= 1) dots.points.push_back({row.number("height_m"), 100 * row.number("cleared") / trials});
    }
    std::ranges::sort(dots.points);
    out.push_back({"", Mark::line, dots.color, dots.points});
    out.push_back(dots);
  }
  return out;
}

}  // namespace

std::string running_range(const std::string& title, const Continuation& c) {
  if (c.dimension() != 2) throw Error("running.txt: expected a range of turn and speed");
  return example::chart(
      title, {"turn, degrees per step", "speed, m/s", values(c.parameters().axes[0]), values(c.parameters().axes[1])},
      nodes_by_status({&c}, true, [](const Continuation& of, std::size_t, int n) {
        const Eigen::VectorXd theta = of.parameter(n);
        return std::pair{theta[0], theta[1]};
      }));
}

void write_skill_report(const Options& o, const sim::Model& model, const control::Roles& roles, const Skills& skills,
                        Json& report) {
  const Continuation& running = *skills.running;
  if (running.dimension() != 2)
    throw Error((o.skills / "running.txt").string() + ": expected a range of turn and speed");
  const auto obstacles = obstacle_skills(o.skills);
  const auto shares = success_shares(o.skills / "report.json", obstacles);
  Trainer trainer(model, roles, Effort::of(o.quick, o.seed), o.out, o.threads, [](const char*, const std::string&) {});
  const int trials = o.quick ? 4 : 16;
  const std::vector<NodeResult> nodes = trainer.test_running(skills.gait, running, trials);
  if (example::interruption_asked()) throw example::Interrupted{};
  const plan::StepLength<double>& line = skills.measured->length;
  double residual = 0;
  std::vector<std::string> plots{running_range("Running: nodes, and which round tried them last", running),
                                 step_lengths(nodes, line, residual)};
  const plan::StepLength<double> fresh = trainer.step_length(nodes);
  std::vector<std::pair<std::string, std::string>> facts{{"running", counts(running)}};
  if (!skills.wider.empty()) {
    plots.insert(plots.begin() + 1, running_range("Running, and under lesser disturbances as well", skills.wider.back()));
    facts.push_back({"running, under lesser disturbances as well", counts(skills.wider.back())});
  }
  for (const Found& s : obstacles) facts.push_back({name_of(s.kind), counts(s.found)});
  facts.push_back({"step length planned with", rounded(line.slope, 3) + " v + " + rounded(line.offset, 3) + " m"});
  facts.push_back({"fitted to these runs", rounded(fresh.slope, 3) + " v + " + rounded(fresh.offset, 3) + " m"});
  facts.push_back({"off the planner's line, r.m.s.", rounded(residual, 3) + " m"});
  facts.push_back({"runs of each running task",
                   std::to_string(trials) + ", of starts that learning never saw; drawn where most did as asked"});
  if (!obstacles.empty()) plots.push_back(obstacle_range(obstacles));
  if (!shares.empty())
    plots.push_back(example::chart("Trials that cleared the obstacle and ran on",
                                   {"size of the obstacle, m", "trials, %", {}, {0, 20, 40, 60, 80, 100}}, shares));
  const fs::path page = o.out / "report.html";
  io::write_atomically(page, example::plot_page("Terrain Runner: skills", facts, plots));
  report["plots"] = plots.size();
  report["trials"] = trials;
  report["step_length"] = {{"slope_s", fresh.slope}, {"offset_m", fresh.offset}, {"residual_of_planned_m", residual}};
  std::printf("page: %s\n", page.string().c_str());
}

}  // namespace terrain_runner
