// SPDX-License-Identifier: MIT
#include <doctest/doctest.h>

#include "support.hpp"

using namespace examples_test;

namespace {

const fs::path program = fs::path(TRACEUR_BIN_DIR) / "generate";
const fs::path clip = fs::path(TRACEUR_SOURCE_DIR) / "examples" / "clips" / "walk.jsonl";

Outcome generate(const fs::path& folder, const std::string& arguments) { return shell(folder, program.string() + " " + arguments); }

}  // namespace

TEST_CASE("generate trains, generates and corrects in seconds, on any number of threads, and goes on where it was stopped") {
  const fs::path folder = fresh("generate", "run"), one = folder / "one", two = folder / "two";
  const std::string job = clip.string() + " --quick --steps 100 --batch 2 --seconds 2 --seed 3 ";
  const Outcome first = generate(folder, job + "--threads 1 --out " + one.string());
  CAPTURE(first.err);
  REQUIRE(first.status == 0);
  const nlohmann::json report = report_of(one);
  CHECK(report["status"] == "done");
  CHECK(report["steps"] == 100);
  CHECK(report["motions"] == 2);
  CHECK(report["path_m"].size() > 5);
  CHECK(report["corrected"]["penetration_per_frame_m"].get<double>() <=
        0.5 * report["generated"]["penetration_per_frame_m"].get<double>() + 1e-3);
  CHECK(report["corrected"]["high_jerk_share"].get<double>() <= report["generated"]["high_jerk_share"].get<double>());
  CHECK(report["clips"]["duration_s"].get<double>() > 0.5);
  // What a clip's features say of its joints, its rotations do too; what so little training has made of them not quite.
  const nlohmann::json windows = report["windows"];
  CHECK(windows["count"] == 100);
  CHECK(windows["clips"]["fk_gap_m"].get<double>() < 1e-6);
  CHECK(windows["generated"]["fk_gap_m"].get<double>() > 1e-4);
  CHECK(windows["generated"]["fk_gap_m"].get<double>() < 0.2);
  CHECK(windows["generated"]["foot_slide_m_s"].get<double>() > windows["clips"]["foot_slide_m_s"].get<double>());
  for (const char* file : {"replay.html", "curves.html", "motion.jsonl", "terrain.json", "generator.safetensors"})
    CHECK(fs::file_size(one / file) > 500);

  // Stopped at the first checkpoint it comes to, by its clock, and continued.
  generate(folder, job + "--threads 2 --minutes 0.0001 --out " + two.string());
  CHECK(report_of(two)["steps"] == 50);
  REQUIRE(generate(folder, "--resume " + two.string() + " --threads 2").status == 0);
  CHECK(text_of(one / "checkpoint.safetensors") == text_of(two / "checkpoint.safetensors"));
  CHECK(text_of(one / "motion.jsonl") == text_of(two / "motion.jsonl"));

  const fs::path played = folder / "played";
  REQUIRE(generate(folder, "--play " + (one / "generator.safetensors").string() +
                               " --batch 2 --seconds 2 --seed 3 --out " + played.string()).status == 0);
  CHECK(text_of(one / "motion.jsonl") == text_of(played / "motion.jsonl"));
  CHECK_FALSE(fs::exists(played / "checkpoint.safetensors"));
}

TEST_CASE("generate refuses bad arguments and bad files with one line and leaves nothing behind") {
  const fs::path folder = fresh("generate", "refused"), out = folder / "out";
  std::ofstream(folder / "broken.safetensors") << "not a generator";
  const auto refused = [&](const std::string& arguments, const std::string& part) {
    examples_test::refused(program, folder, arguments, part);
    CHECK_FALSE(fs::exists(out));
  };
  refused("", "expected a CLIP");
  refused(clip.string(), "expected --out DIR");
  refused("/nowhere/clip.bvh --out " + out.string(), "/nowhere/clip.bvh");
  refused(clip.string() + " --steps -3 --out " + out.string(), "--steps");
  refused(clip.string() + " --terrain moon --out " + out.string(), "--terrain");
  refused("--play " + (folder / "broken.safetensors").string() + " --out " + out.string(), "broken.safetensors");
  refused("--resume " + (folder / "nowhere").string(), "checkpoint.safetensors");
  refused("--resume " + folder.string() + " --seed 4", "leave them out");
}
