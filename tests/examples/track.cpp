// SPDX-License-Identifier: MIT
#include <doctest/doctest.h>

#include "support.hpp"

using namespace examples_test;

namespace {

const fs::path program = fs::path(TRACEUR_BIN_DIR) / "track";
const fs::path clip = fs::path(TRACEUR_SOURCE_DIR) / "examples" / "clips" / "walk.jsonl";

Outcome track(const fs::path& folder, const std::string& arguments) { return shell(folder, program.string() + " " + arguments); }

}  // namespace

TEST_CASE("track learns to walk in seconds, on any number of threads, and goes on where it was stopped") {
  const fs::path folder = fresh("track", "learn"), one = folder / "one", two = folder / "two";
  // 204800 samples and the rollout before them are one block of updates.
  const std::string job = clip.string() + " --samples 420000 --seed 3 ";
  REQUIRE(track(folder, job + "--threads 1 --out " + one.string()).status == 0);
  const nlohmann::json report = report_of(one);
  CHECK(report["status"] == "done");
  // One update is no training: the motors are asked for little but the reference poses. That is told as a failure.
  CHECK(track(folder, clip.string() + " --samples 5000 --seed 3 --out " + (folder / "idle").string()).status == 1);
  const nlohmann::json idle = report_of(folder / "idle");
  CHECK(idle["status"] == "failed");
  CHECK(report["normalized_return"].get<double>() > idle["normalized_return"].get<double>() + 0.25);
  CHECK(report["normalized_return"].get<double>() <= 1);
  CHECK(report["episodes"].get<int>() >= 100);
  CHECK(2 * report["completed"].get<int>() > report["episodes"].get<int>());
  CHECK(report["samples"].get<double>() >= 420000);
  CHECK(report["samples_per_s"].get<double>() > 0);
  CHECK(report["clips"].size() == 1);
  CHECK(report["clips"][0]["from_begin"]["completed"].get<int>() > 0);
  CHECK(fs::file_size(one / "replay.html") > 10000);
  CHECK(text_of(one / "curves.html").find("<svg") != std::string::npos);

  // Stopped at the first checkpoint it comes to, by its clock, and continued on another number of threads.
  const Outcome begun = track(folder, job + "--threads 2 --minutes 0.0001 --out " + two.string());
  CHECK(report_of(two)["samples"].get<double>() < 300000);
  REQUIRE(track(folder, "--resume " + two.string() + " --threads 2").status == 0);
  CHECK(text_of(one / "policy.safetensors") == text_of(two / "policy.safetensors"));
  nlohmann::json again = report_of(two);
  CHECK(again["normalized_return"] == report["normalized_return"]);

  const fs::path played = folder / "played";
  REQUIRE(track(folder, "--play " + (one / "policy.safetensors").string() + " --out " + played.string()).status == 0);
  CHECK(report_of(played)["normalized_return"] == report["normalized_return"]);
  CHECK_FALSE(fs::exists(played / "checkpoint.safetensors"));
}

TEST_CASE("track refuses bad arguments and bad files with one line and leaves nothing behind") {
  const fs::path folder = fresh("track", "refused"), out = folder / "out";
  std::ofstream(folder / "broken.safetensors") << "not a policy";
  std::ofstream(folder / "short.jsonl") << "{}\n";
  const auto refused = [&](const std::string& arguments, const std::string& part) {
    const Outcome o = track(folder, arguments);
    CAPTURE(arguments);
    CAPTURE(o.err);
    CHECK(o.status == 2);
    CHECK(o.err.starts_with("track: "));
    CHECK(o.err.find(part) != std::string::npos);
    CHECK(o.err.find('\n') == o.err.size() - 1);
    CHECK_FALSE(fs::exists(out));
  };
  refused("", "expected a CLIP");
  refused(clip.string(), "expected --out DIR");
  refused("/nowhere/clip.bvh --out " + out.string(), "/nowhere/clip.bvh");
  refused((folder / "short.jsonl").string() + " --out " + out.string(), "short.jsonl");
  refused(clip.string() + " --samples -3 --out " + out.string(), "--samples");
  refused("--play " + (folder / "broken.safetensors").string() + " --out " + out.string(), "broken.safetensors");
  refused("--resume " + (folder / "nowhere").string(), "checkpoint.safetensors");
  refused("--resume " + folder.string() + " --seed 4", "leave them out");
}
