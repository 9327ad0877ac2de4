// SPDX-License-Identifier: MIT
#include <chrono>
#include <cmath>
#include <tuple>

#include <doctest/doctest.h>

#include "support.hpp"

using namespace examples_test;

namespace {

const fs::path program = fs::path(TRACEUR_BIN_DIR) / "terrain_runner";
const fs::path skills = fs::path(TRACEUR_SOURCE_DIR) / "examples" / "skills";

Outcome runner(const fs::path& folder, const std::string& arguments) { return shell(folder, program.string() + " " + arguments); }

}  // namespace

TEST_CASE("terrain_runner runs a course with the skills that come with it") {
  const fs::path folder = fresh("terrain_runner", "run"), out = folder / "out";
  REQUIRE(runner(folder, "run --seed 5 --obstacles 3 --kinds jump --jump 0.1 0.2 --threads 1 --out " + out.string()).status == 0);
  const nlohmann::json report = report_of(out);
  CHECK(report["status"] == "done");
  CHECK(report["obstacles"] == 3);
  CHECK(report["cleared"].get<int>() >= 0);
  CHECK(report["distance_m"].get<double>() > 10);
  CHECK(report["real_time_factor"].get<double>() > 1);
  CHECK(report["core_time_factor"].get<double>() > 1);
  CHECK(fs::file_size(out / "replay.html") > 10000);
}

TEST_CASE("a live runner is not ahead of the clock, says where it is, and ends as another does") {
  const fs::path folder = fresh("terrain_runner", "live");
  const auto run = [&](const std::string& more) {
    const auto begin = std::chrono::steady_clock::now();
    const Outcome o = runner(folder, "run --seed 5 --obstacles 1 --kinds jump --jump 0.1 0.1 --threads 1 " + more + " --out " + (folder / "out").string());
    REQUIRE(o.status == 0);
    const double wall = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    return std::tuple{o.out, report_of(folder / "out"), wall};
  };
  const auto [said, report, wall] = run("--live");
  const double simulated = report["simulated_s"];
  CHECK(simulated > 5);
  CHECK(wall >= simulated);
  CHECK(std::count(said.begin(), said.end(), '\n') >= static_cast<int>(simulated));
  CHECK(said.find("obstacle 1 of 1") != std::string::npos);
  // What it slept is not counted.
  CHECK(report["real_time_factor"].get<double>() > 2);
  const auto [quiet, other, time] = run("");
  CHECK(other["distance_m"] == report["distance_m"]);
  CHECK(quiet.find("obstacle 1 of 1") == std::string::npos);
}

TEST_CASE("courses go the same on any number of threads, most are completed, and without feedback hardly one") {
  const fs::path folder = fresh("terrain_runner", "evaluate");
  const auto evaluate = [&](const char* name, const std::string& more) {
    const fs::path out = folder / name;
    REQUIRE(runner(folder, "evaluate --quick --courses 16 --obstacles 2 --kinds jump --jump 0.1 0.25 " + more + " --out " + out.string()).status == 0);
    nlohmann::json report = report_of(out);
    report.erase("wall_s");
    return report;
  };
  const nlohmann::json one = evaluate("one", "--threads 1"), two = evaluate("two", "--threads 2");
  CHECK(one == two);
  CHECK(one["courses"] == 16);
  CHECK(one["completed"].get<int>() >= 12);
  const nlohmann::json blind = evaluate("blind", "--threads 2 --without feedback");
  CHECK(blind["completed"].get<int>() <= 4);
}

TEST_CASE("each part is left out in turn, on the same courses") {
  const fs::path folder = fresh("terrain_runner", "ablations"), out = folder / "out";
  const std::string courses = "evaluate --courses 8 --obstacles 2 --kinds jump --jump 0.1 0.2 ";
  REQUIRE(runner(folder, courses + "--ablations --out " + out.string()).status == 0);
  const nlohmann::json rows = report_of(out)["ablations"];
  REQUIRE(rows.size() == 6);
  CHECK(rows[0]["without"] == "");
  CHECK(rows[0]["completed_percent_lower"] == 0);
  for (const nlohmann::json& row : rows) {
    CHECK(row["obstacles_cleared"].get<int>() <= row["obstacles_met"].get<int>());
    CHECK(row["completed_percent_lower"].get<double>() <= 100);
  }
  REQUIRE(runner(folder, courses + "--without feedback --out " + out.string()).status == 0);
  const nlohmann::json alone = report_of(out);
  CHECK(rows[2]["without"] == "feedback");
  CHECK(rows[2]["completed"] == alone["completed"]);
  CHECK(rows[2]["obstacles_met"] == alone["obstacles_met"]);
}

TEST_CASE("one step is met from many distances") {
  const fs::path folder = fresh("terrain_runner", "approach"), out = folder / "out";
  REQUIRE(runner(folder, "evaluate --approach --kinds jump --trials 15 --out " + out.string()).status == 0);
  const nlohmann::json all = report_of(out)["approach"];
  REQUIRE(all.size() == 1);
  const nlohmann::json& found = all[0];
  CHECK(found["skill"] == "jump");
  CHECK(found["trials"] == 15);
  CHECK(found["size_m"] == 0.2);
  CHECK(found["successes"].get<int>() >= 11);
  REQUIRE(found["by_distance"].size() == 7);
  int trials = 0, successes = 0;
  for (const nlohmann::json& bin : found["by_distance"]) {
    CHECK(bin["trials"] == (bin["to_m"] == 100 ? 3 : 2));
    trials += bin["trials"].get<int>();
    successes += bin["successes"].get<int>();
  }
  CHECK(trials == 15);
  CHECK(successes == found["successes"]);
}

TEST_CASE("every speed and turn of the paper's range is run") {
  const fs::path folder = fresh("terrain_runner", "range"), out = folder / "out";
  REQUIRE(runner(folder, "evaluate --running --seed 5 --out " + out.string()).status == 0);
  const nlohmann::json found = report_of(out)["running"];
  REQUIRE(found["grid"].size() == 169);
  // 95 % of them.
  CHECK(found["nine_of_ten_stand"].get<int>() >= 161);
  CHECK(found["as_asked"].get<int>() >= 161);
  for (const nlohmann::json& task : found["grid"])
    if (task["as_asked"] == 1.0) CHECK(std::abs(task["measured_speed_m_s"].get<double>() - task["speed_m_s"].get<double>()) < 0.25);
}

TEST_CASE("steps, boxes and cliffs are cleared in another engine as they are") {
#ifndef EXAMPLES_WITH_MUJOCO
  MESSAGE("skipped: this build has no MuJoCo");
#else
  const fs::path folder = fresh("terrain_runner", "engine"), out = folder / "out";
  REQUIRE(runner(folder, "evaluate --approach --trials 8 --simulator mujoco --out " + out.string()).status == 0);
  const nlohmann::json all = report_of(out)["approach"];
  REQUIRE(all.size() == 3);
  for (const nlohmann::json& found : all) {
    CAPTURE(found["skill"].get<std::string>());
    CHECK(found["trials"] == 8);
    // Most who drop fall in the steps after the roll there.
    CHECK(found["successes"].get<int>() >= (found["skill"] == "drop" ? 0 : 5));
  }
  REQUIRE(runner(folder, "run --kinds jump --jump 0.2 0.2 --simulator mujoco --out " + out.string()).status == 0);
  CHECK(report_of(out)["distance_m"].get<double>() > 20);
#endif
}

TEST_CASE("skills are shown on a page that needs no other file") {
  const fs::path folder = fresh("terrain_runner", "plot"), known = folder / "skills", out = folder / "out";
  const auto count = [](const std::string& text, const std::string& part) {
    int n = 0;
    for (std::size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) ++n;
    return n;
  };
  REQUIRE(runner(folder, "plot --quick --threads 1 --out " + out.string()).status == 0);
  CHECK(report_of(out)["plots"] == 4);
  const std::string page = text_of(out / "report.html");
  CHECK(count(page, "<svg ") == 4);
  CHECK(count(page, "</svg>") == 4);
  for (const char* reference : {"http", "src=", "href", "url(", "@import"}) CHECK(page.find(reference) == std::string::npos);
  // All nodes of running, under lesser disturbances.
  CHECK(page.find("28 nodes, 24 solved, 4 extrapolated") != std::string::npos);
  CHECK(page.find("28 nodes, 13 solved") != std::string::npos);
  CHECK(page.find("0.2 v + 0.17, the paper") != std::string::npos);
  CHECK(report_of(out)["step_length"]["residual_of_planned_m"].get<double>() < 0.1);

  fs::create_directories(known);
  for (const char* file : {"gait.json", "running.txt", "measured.json", "jump.txt"}) fs::copy_file(skills / file, known / file);
  std::ofstream(known / "report.json") << R"({"jump": {"heights": [{"height_m": 0.1, "trials": 16, "cleared": 15}]}})";
  REQUIRE(runner(folder, "plot " + known.string() + " --quick --threads 1 --out " + out.string()).status == 0);
  CHECK(count(text_of(out / "report.html"), "<svg ") == 4);
  fs::remove(known / "jump.txt");
  REQUIRE(runner(folder, "plot " + known.string() + " --quick --threads 1 --out " + out.string()).status == 0);
  CHECK(count(text_of(out / "report.html"), "<svg ") == 2);
  fs::copy_file(skills / "jump.txt", known / "jump.txt");
  std::ofstream(known / "report.json") << R"({"jump": {}})";
  const Outcome faulty = runner(folder, "plot " + known.string() + " --quick --threads 1 --out " + out.string());
  CHECK(faulty.status == 1);
  CHECK(faulty.out.find("report.json: field 'jump': field 'heights' is missing") != std::string::npos);
}

TEST_CASE("two ways to explore begin alike, and an interrupted comparison ends as another does") {
  const fs::path folder = fresh("terrain_runner", "compare"), out = folder / "out", cut = folder / "cut";
  const std::string job = "compare --quick --runs 100 --threads 1 ";
  REQUIRE(runner(folder, job + "--out " + out.string()).status == 0);
  const nlohmann::json whole = report_of(out);
  REQUIRE(whole["ways"].size() == 2);
  for (const nlohmann::json& way : whole["ways"]) {
    CHECK(way["coverage"].get<double>() > 0.15);
    const nlohmann::json rounds = nlohmann::json::parse(text_of(out / way["strategy"].get<std::string>() / "coverage.json"))["rounds"];
    CHECK(rounds.front()["evaluations"] == 0);
    CHECK(rounds.front()["coverage"].get<double>() == doctest::Approx(1.0 / 9));
    CHECK(rounds.back()["coverage"] == way["coverage"]);
    CHECK(rounds.back()["evaluations"] == way["evaluations"]);
  }
  CHECK(whole["ways"][1]["tests"] == 0);
  const std::string page = text_of(out / "compare.html");
  CHECK(page.find("Coverage over runs") != std::string::npos);
  CHECK(page.find("http") == std::string::npos);
  shell(folder, "timeout --foreground -s INT 1 " + program.string() + " " + job + "--out " + cut.string());
  REQUIRE(runner(folder, "compare --quick --runs 100 --threads 1 --resume " + cut.string()).status == 0);
  CHECK(report_of(cut)["ways"] == whole["ways"]);
}

TEST_CASE("an interrupted evaluation says no more than that") {
  const fs::path folder = fresh("terrain_runner", "interrupted"), out = folder / "out";
  shell(folder, "timeout --foreground -s INT 1 " + program.string() + " evaluate --courses 100000 --threads 1 --out " + out.string());
  const nlohmann::json report = report_of(out);
  CHECK(report["status"] == "interrupted");
  CHECK_FALSE(report.contains("why"));
}

TEST_CASE("a small job samples a jump on top of running, and learns around it") {
  const fs::path folder = fresh("terrain_runner", "train"), out = folder / "out";
  fs::create_directories(out);
  for (const char* file : {"gait.json", "running.txt", "measured.json"}) fs::copy_file(skills / file, out / file);
  REQUIRE(runner(folder, "train --quick --kinds jump --resume " + out.string()).status == 0);
  const nlohmann::json report = report_of(out);
  CHECK(report["status"] == "done");
  CHECK(report["jump"]["evaluations"].get<int>() > 0);
  CHECK(report["jump"]["heights"].size() == 2);
  CHECK(fs::exists(out / "jump.safetensors"));
  REQUIRE(runner(folder, "evaluate --courses 8 --obstacles 1 --kinds jump --jump 0.1 0.1 " + out.string() + " --out " + (folder / "courses").string()).status == 0);
  CHECK(report_of(folder / "courses")["obstacles_met"] == 8);
}

TEST_CASE("steps, boxes and cliffs are cleared, on courses of all of them as well") {
  const fs::path folder = fresh("terrain_runner", "kinds"), out = folder / "out";
  for (const std::string kind : {"jump", "vault", "drop"}) {
    CAPTURE(kind);
    const std::string range = kind == "jump" ? "0.1 0.7" : kind == "vault" ? "0.6 0.9" : "0.9 1.7";
    const std::string courses = "evaluate --kinds " + kind + " --" + kind + " " + range + " --obstacles 1 --out " + out.string();
    REQUIRE(runner(folder, courses + " --courses 32").status == 0);
    const nlohmann::json found = report_of(out)["by_kind"];
    CHECK(found.size() == 1);
    CHECK(found[kind]["met"] == 32);
    CHECK(found[kind]["cleared"].get<int>() >= 28);
    // Without its law the regulator is gone as well, and hardly anybody gets over.
    REQUIRE(runner(folder, courses + " --courses 8 --without feedback").status == 0);
    CHECK(report_of(out)["obstacles_cleared"].get<int>() <= 2);
  }
  REQUIRE(runner(folder, "evaluate --courses 16 --obstacles 3 --jump 0.1 0.6 --vault 0.6 0.8 --drop 0.9 1.8 --out " + out.string()).status == 0);
  const nlohmann::json mixed = report_of(out);
  for (const char* kind : {"jump", "vault", "drop"}) CHECK(mixed["by_kind"][kind]["met"].get<int>() > 0);
  CHECK(mixed["obstacles_cleared"].get<int>() >= 40);
}

TEST_CASE("runners fly, vault by hand and roll over") {
  const fs::path folder = fresh("terrain_runner", "labels"), out = folder / "out";
  const auto manoeuvre = [&](const std::string& arguments) {
    // One in twenty falls, and who does is another on every kind of processor.
    nlohmann::json report;
    for (int seed = 1; seed <= 4; ++seed) {
      REQUIRE(runner(folder, "run --obstacles 1 --seed " + std::to_string(seed) + " " + arguments + " --out " + out.string()).status == 0);
      report = report_of(out);
      if (report["completed"] == true) break;
    }
    REQUIRE(report["completed"] == true);
    // The clip is without a foot on the ground for a third of the time or so.
    CHECK(report["running_flight_s"].get<double>() > 0.15 * report["running_s"].get<double>());
    REQUIRE(report["manoeuvres"].size() == 1);
    return report["manoeuvres"][0];
  };
  const double full = 2 * 3.14159265;
  const nlohmann::json jump = manoeuvre("--kinds jump --jump 0.3 0.3");
  CHECK(jump["height_m"] == 0.3);
  CHECK(jump["flight_s"].get<double>() > 0.2);
  CHECK(jump["hand_s"] == 0);
  CHECK(std::abs(jump["turned_rad"].get<double>()) < 1);
  const nlohmann::json vault = manoeuvre("--kinds vault --vault 0.6 0.6");
  CHECK(vault["hand_s"].get<double>() > 0.1);
  CHECK(std::abs(vault["turned_rad"].get<double>()) < 1);
  const nlohmann::json drop = manoeuvre("--kinds drop --drop 1 1");
  CHECK(drop["flight_s"].get<double>() > 0.4);
  CHECK(drop["hand_s"] == 0);
  // Once over, its axis not being straight across.
  CHECK(drop["turned_rad"].get<double>() > 0.8 * full);
  CHECK(drop["turned_rad"].get<double>() < 1.2 * full);
}

TEST_CASE("a small job learns a vault around the motion that is there") {
  const fs::path folder = fresh("terrain_runner", "train_vault"), out = folder / "out";
  fs::create_directories(out);
  for (const char* file : {"gait.json", "running.txt", "measured.json", "vault.safetensors"}) fs::copy_file(skills / file, out / file);
  REQUIRE(runner(folder, "train --quick --kinds vault --resume " + out.string()).status == 0);
  const nlohmann::json report = report_of(out);
  CHECK(report["status"] == "done");
  CHECK_FALSE(report.contains("jump"));
  CHECK(report["vault"]["heights"].size() == 2);
  CHECK(report["vault"]["heights"][0]["survived"].get<int>() > 8);
}

TEST_CASE("terrain_runner refuses bad arguments and bad files with one line and leaves nothing behind") {
  const fs::path folder = fresh("terrain_runner", "refused"), out = folder / "out";
  fs::create_directories(folder / "empty");
  fs::create_directories(folder / "broken");
  fs::copy_file(skills / "gait.json", folder / "broken" / "gait.json");
  std::ofstream(folder / "broken" / "running.txt") << "not a continuation\n";
  const auto refused = [&](const std::string& arguments, const std::string& part) {
    examples_test::refused(program, folder, arguments, part);
  };
  refused("", "subcommand");
  refused("run", "expected --out DIR");
  refused("train /nowhere/controller.json --out " + out.string(), "/nowhere/controller.json");
  refused("run " + (folder / "empty").string() + " --out " + out.string(), "gait.json");
  refused("evaluate " + (folder / "broken").string() + " --out " + out.string(), "running.txt");
  fs::copy_file(skills / "running.txt", folder / "broken" / "running.txt", fs::copy_options::overwrite_existing);
  std::ofstream(folder / "broken" / "measured.json") << "{\"step_length\": {}}\n";
  refused("evaluate " + (folder / "broken").string() + " --out " + out.string(), "measured.json: field 'step_length': field 'slope_s' is missing");
  refused("evaluate --without luck --out " + out.string(), "--without");
  refused("evaluate --ablations --without planner --out " + out.string(), "--ablations");
  refused("evaluate --ablations --approach --out " + out.string(), "--ablations");
  refused("evaluate --running --approach --out " + out.string(), "--running");
  refused("evaluate --trials 20 --out " + out.string(), "--trials: expected with --approach");
  refused("compare --runs 0 --out " + out.string(), "--runs");
  refused("compare --resume " + (folder / "empty").string() + " --out " + out.string(), "--resume");
  refused("plot " + (folder / "empty").string() + " --out " + out.string(), "gait.json");
  refused("run --kinds hop --out " + out.string(), "--kinds");
  refused("run --simulator physix --out " + out.string(), "--simulator");
  refused("run --fresh --seed 3 --out " + out.string(), "--fresh");
  refused("run --kinds vault " + (folder / "nothing").string() + " --out " + out.string(), "nothing");
  fs::create_directories(folder / "half");
  for (const char* file : {"gait.json", "running.txt", "measured.json", "jump.txt", "vault.safetensors"}) fs::copy_file(skills / file, folder / "half" / file);
  refused("run --kinds vault " + (folder / "half").string() + " --out " + out.string(), "vault.txt");
  refused("run --kinds jump " + (folder / "half").string() + " --out " + out.string(), "jump.safetensors");
  fs::resize_file(folder / "half" / "vault.safetensors", 5000);
  refused("run " + (folder / "half").string() + " --out " + out.string(), "vault.safetensors");
  refused("run --jump 0.5 0.2 --out " + out.string(), "--jump");
}
