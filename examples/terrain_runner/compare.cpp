// SPDX-License-Identifier: MIT
#include "compare.hpp"

#include <cstdio>
#include <fstream>

#include "../common/plot.hpp"
#include "../common/progress.hpp"
#include "../common/results.hpp"
#include "report.hpp"
#include "traceur/core/error.hpp"
#include "traceur/io/atomic_file.hpp"
#include "traceur/io/controller_file.hpp"
#include "trainer.hpp"

namespace terrain_runner {

using namespace traceur;
using parameterize::Continuation;
using parameterize::NodeStatus;
using parameterize::Strategy;
using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

namespace {

struct Way {
  Strategy strategy;
  const char* folder;
  const char* name;
  const char* color;
};
constexpr Way ways[] = {{Strategy::predictor_corrector, "predictor_corrector", "predictor-corrector", "#2b6cb0"},
                        {Strategy::axis_by_axis, "axis_by_axis", "axis by axis", "#c05621"}};

/// How much was covered after how many runs, round by round.
struct History {
  std::vector<std::pair<std::int64_t, double>> rounds;

  void add(const Continuation& c) {
    if (rounds.empty() || rounds.back().first < c.evaluations()) rounds.push_back({c.evaluations(), c.coverage()});
  }
  double coverage_after(double runs) const {
    double last = 0;
    for (const auto& [evaluations, coverage] : rounds)
      if (static_cast<double>(evaluations) <= runs) last = coverage;
    return last;
  }
  void write(const fs::path& path) const {
    Json json = Json::array();
    for (const auto& [evaluations, coverage] : rounds)
      json.push_back({{"evaluations", evaluations}, {"coverage", coverage}});
    io::write_atomically(path, Json{{"rounds", json}}.dump(2) + "\n");
  }
  /// None if there is no file.
  static History read(const fs::path& path) {
    History h;
    if (!fs::exists(path)) return h;
    std::ifstream in(path);
    const nlohmann::json json = nlohmann::json::parse(in, nullptr, false);
    const nlohmann::json& rounds = io::detail::FieldReader(json, path.string()).at("rounds");
    if (!rounds.is_array()) throw Error(path.string() + ": field 'rounds': expected a list");
    for (std::size_t i = 0; i < rounds.size(); ++i) {
      const io::detail::FieldReader row(rounds[i], path.string() + ": field 'rounds': entry " + std::to_string(i));
      h.rounds.push_back({static_cast<std::int64_t>(row.at_least_zero("evaluations")), row.at_least_zero("coverage")});
    }
    return h;
  }
};

}  // namespace

void compare(const Options& o, const sim::Model& model, const control::Roles& roles, const Skills& skills,
             Json& report) {
  Effort effort = Effort::of(o.quick, o.seed);
  if (o.runs > 0) effort.running_evaluations = o.runs;
  const auto axis = [](const std::vector<double>& x) {
    return Eigen::VectorXd(Eigen::Map<const Eigen::VectorXd>(x.data(), static_cast<Eigen::Index>(x.size())));
  };
  const Continuation& given = *skills.running;
  std::vector<example::Series> curves;
  std::vector<std::string> plots{""};
  std::vector<std::pair<std::string, std::string>> facts{
      {"runs after which no new round begins", std::to_string(effort.running_evaluations)}};
  Json rows = Json::array();
  if (!o.resume) {
    write_gait(o.out, skills.gait);
    write_stage(o.out, "running", given);
    write_measured(o.out, *skills.measured);
  }
  for (const Way& way : ways) {
    const fs::path folder = o.out / way.folder, history_file = folder / "coverage.json";
    fs::create_directories(folder);
    std::optional<Continuation> c;
    History history;
    if (o.resume) {
      c = read_stage(folder, "running");
      history = History::read(history_file);
    }
    if (!c) {
      parameterize::ContinuationParameters grid = given.parameters();
      grid.axes = {axis(effort.turns), axis(effort.speeds)};
      grid.strategy = way.strategy;
      c.emplace(grid, given.parameter(given.seed()), given.control(given.seed()));
    }
    if (c->parameters().strategy != way.strategy)
      throw Error((folder / "running.txt").string() + ": expected to be explored " + way.name);
    history.add(*c);
    Trainer trainer(model, roles, effort, folder, o.threads, [&](const char*, const std::string& what) {
      std::printf("%s: %s\n", way.name, what.c_str());
      std::fflush(stdout);
    });
    trainer.on_range = [&](const Continuation& now) {
      history.add(now);
      history.write(history_file);
    };
    c = trainer.learn_running(skills.gait, std::move(c));
    example::Series curve{way.name, example::Mark::line, way.color, {}};
    double before = 0;
    for (const auto& [evaluations, coverage] : history.rounds) {
      const double runs = static_cast<double>(evaluations) / 1000;
      curve.points.push_back({runs, 100 * before});
      curve.points.push_back({runs, 100 * coverage});
      before = coverage;
    }
    curves.push_back(curve);
    plots.push_back(running_range(way.name, *c));
    Json shares = Json::array();
    for (const double share : {0.25, 0.5, 0.75, 1.0}) {
      const double runs = share * static_cast<double>(effort.running_evaluations);
      shares.push_back({{"evaluations", runs}, {"coverage", history.coverage_after(runs)}});
    }
    rows.push_back({{"strategy", way.folder},
                    {"finished", c->finished()},
                    {"evaluations", c->evaluations()},
                    {"coverage", c->coverage()},
                    {"solved", c->count(NodeStatus::solved)},
                    {"extrapolated", c->count(NodeStatus::extrapolated)},
                    {"failed", c->count(NodeStatus::failed)},
                    {"untried", c->count(NodeStatus::untried)},
                    {"tests", c->tests()},
                    {"optimizations", c->optimizations()},
                    {"coverage_after", shares}});
    std::string found = example::rounded(100 * c->coverage(), 0) + " % of " + std::to_string(c->node_count()) +
                        " nodes in " + std::to_string(c->evaluations()) + " runs, " +
                        std::to_string(c->optimizations()) + " searches";
    facts.push_back({way.name, found + (c->finished() ? ", ended by itself" : "")});
    std::printf("%s: %s\n", way.name, facts.back().second.c_str());
  }
  plots[0] = example::chart("Coverage over runs",
                            {"thousands of runs", "nodes covered, %", {}, {0, 20, 40, 60, 80, 100}}, curves);
  const fs::path page = o.out / "compare.html";
  io::write_atomically(page, example::plot_page("Terrain Runner: two ways to explore", facts, plots));
  report["budget"] = effort.running_evaluations;
  report["ways"] = rows;
  std::printf("page: %s\n", page.string().c_str());
}

}  // namespace terrain_runner
