// SPDX-License-Identifier: MIT
#include <doctest/doctest.h>

#include <vector>

#include <traceur/io/safetensors.hpp>

#include "support.hpp"

using namespace examples_test;

namespace {

const fs::path program = fs::path(TRACEUR_BIN_DIR) / "track";
const fs::path clip = fs::path(TRACEUR_SOURCE_DIR) / "examples" / "clips" / "walk.jsonl";

Outcome track(const fs::path& folder, const std::string& arguments) { return shell(folder, program.string() + " " + arguments); }

/// Makes the value network of a saved run so large that what comes out of it is no number, and asks for more samples.
void spoil_values(const fs::path& checkpoint) {
  const traceur::io::Safetensors file = traceur::io::read_safetensors(checkpoint);
  traceur::io::Safetensors out(checkpoint.string());
  for (const auto& tensor : file.tensors()) {
    if (tensor.name != "ppo.value") {
      out.add(tensor);
      continue;
    }
    const std::vector<float> huge(static_cast<std::size_t>(tensor.size()), 3e38f);
    out.add<float>(tensor.name, tensor.shape, huge);
  }
  out.metadata = file.metadata;
  nlohmann::ordered_json arguments = nlohmann::ordered_json::parse(out.metadata.at("arguments"));
  arguments["samples"] = 2e6;
  out.metadata["arguments"] = arguments.dump();
  traceur::io::write_safetensors(checkpoint, out);
}

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
  const nlohmann::json &begun_trained = report["clips"][0]["from_begin"], &begun_idle = idle["clips"][0]["from_begin"];
  CHECK(begun_trained["episodes"].get<int>() > 0);
  CHECK(begun_trained["normalized_return"].get<double>() > begun_idle["normalized_return"].get<double>() + 0.2);
  CHECK(fs::file_size(one / "replay.html") > 10000);
  CHECK(text_of(one / "curves.html").find("<svg") != std::string::npos);

  // Killed at its first checkpoint and continued, on another number of threads: the same bytes, times being kept elsewhere.
  const std::string begun = program.string() + " " + job + "--threads 2 --out " + two.string();
  shell(folder, begun + " & pid=$!; for i in $(seq 3000); do [ -e " + (two / "timing.csv").string() +
                    " ] && break; sleep 0.1; done; kill -9 $pid; wait $pid");
  REQUIRE(fs::exists(two / "timing.csv"));
  CHECK_FALSE(fs::exists(two / "report.json"));
  CHECK(text_of(one / "checkpoint.safetensors") != text_of(two / "checkpoint.safetensors"));
  REQUIRE(track(folder, "--resume " + two.string() + " --threads 2").status == 0);
  CHECK((text_of(one / "policy.safetensors") == text_of(two / "policy.safetensors")));
  CHECK((text_of(one / "checkpoint.safetensors") == text_of(two / "checkpoint.safetensors")));
  nlohmann::json again = report_of(two);
  CHECK(again["normalized_return"] == report["normalized_return"]);

  // A gradient that is no number: the layer is named, and what was saved before stays.
  const fs::path checkpoint = two / "checkpoint.safetensors";
  spoil_values(checkpoint);
  const std::string before = text_of(checkpoint);
  CHECK(track(folder, "--resume " + two.string()).status == 1);
  const std::string why = report_of(two)["why"];
  CAPTURE(why);
  CHECK(why.find("gradient: layers.") != std::string::npos);
  CHECK((text_of(checkpoint) == before));

  // What is repeated is also followed for a minute.
  std::string repeated = text_of(clip);
  const std::string once = "\"cyclic\":false";
  REQUIRE(repeated.find(once) != std::string::npos);
  repeated.replace(repeated.find(once), once.size(), "\"cyclic\":true");
  std::ofstream(folder / "repeated.jsonl") << repeated;
  const fs::path minute = folder / "minute";
  track(folder, (folder / "repeated.jsonl").string() + " --play " + (one / "policy.safetensors").string() + " --out " + minute.string());
  const nlohmann::json lasting = report_of(minute)["clips"][0]["for_60_s"];
  CHECK(lasting["episodes"].get<int>() >= 100);
  CHECK(lasting["mean_episode_s"].get<double>() <= 60);
  CHECK_FALSE(report["clips"][0].contains("for_60_s"));

  const fs::path played = folder / "played";
  REQUIRE(track(folder, "--play " + (one / "policy.safetensors").string() + " --out " + played.string()).status == 0);
  CHECK(report_of(played)["normalized_return"] == report["normalized_return"]);
  CHECK_FALSE(fs::exists(played / "checkpoint.safetensors"));
}

TEST_CASE("track learns with every reward, and shows a policy on another simulator") {
  const fs::path folder = fresh("track", "rewards");
  for (const std::string reward : {"parc", "hil"}) {
    const fs::path out = folder / reward;
    // One update learns nothing yet: that is told as a failure.
    CHECK(track(folder, clip.string() + " --quick --samples 5000 --reward " + reward + " --out " + out.string()).status == 1);
    const nlohmann::json report = report_of(out);
    CAPTURE(report.dump());
    CHECK(report["arguments"]["reward"] == reward);
    CHECK(report["why"].get<std::string>().find("does not track") != std::string::npos);
    CHECK(report["normalized_return"].get<double>() > 0);
    CHECK(report["normalized_return"].get<double>() < 1);
  }
#ifdef EXAMPLES_WITH_MUJOCO
  const std::string play = "--quick --simulator mujoco --play " + (folder / "hil" / "policy.safetensors").string();
  CHECK(track(folder, play + " --out " + (folder / "mujoco").string()).status == 1);
  const nlohmann::json report = report_of(folder / "mujoco");
  CHECK(report["arguments"]["simulator"] == "mujoco");
  CHECK(report["arguments"]["reward"] == "hil");
  CHECK(report["normalized_return"].get<double>() > 0);
#endif
}

TEST_CASE("track learns to move as fast as asked, the same on any number of threads") {
  const fs::path folder = fresh("track", "speed"), one = folder / "one", two = folder / "two";
  const std::string job = clip.string() + " --task speed --slowest 1 --fastest 1.5 --quick --samples 20000 --seed 2 ";
  track(folder, job + "--threads 1 --out " + one.string());
  const nlohmann::json report = report_of(one);
  CAPTURE(report.dump());
  CHECK(report["bands"].size() == 3);
  CHECK(report["episodes"].get<int>() == report["completed"].get<int>() + report["fell"].get<int>() + report["failed"].get<int>());
  CHECK(report["failed"] == 0);
  REQUIRE(report["discriminator"].size() == 1);
  const double told_apart = report["discriminator"][0]["real_accuracy"].get<double>() + report["discriminator"][0]["fake_accuracy"].get<double>();
  CHECK(told_apart > 0.8);
  CHECK(told_apart < 2);
  CHECK(fs::file_size(one / "replay.html") > 10000);
  CHECK(text_of(one / "curves.html").find("accuracy") != std::string::npos);
  track(folder, job + "--threads 2 --out " + two.string());
  CHECK((text_of(one / "checkpoint.safetensors") == text_of(two / "checkpoint.safetensors")));
}

TEST_CASE("two processes learn what one learns, byte for byte") {
  const fs::path folder = fresh("track", "mpi"), one = folder / "one", two = folder / "two";
  const std::string mpirun = "ASAN_OPTIONS=detect_leaks=0 OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 timeout 300 mpirun -n 2 --oversubscribe ";
  if (shell(folder, "mpirun --version").status != 0) {
    MESSAGE("left out: there is no mpirun");
    return;
  }
  for (const std::string task : {"track", "speed"}) {
    const std::string job = clip.string() + " --quick --samples 12000 --threads 1 --task " + task + " --out ";
    const fs::path alone = one / task, both = two / task;
    const Outcome shared = shell(folder, mpirun + program.string() + " " + job + both.string());
    if (shared.err.find("built without MPI") != std::string::npos) {
      MESSAGE("left out: built without MPI");
      return;
    }
    CAPTURE(shared.err);
    track(folder, job + alone.string());
    REQUIRE(fs::exists(both / "report.json"));
    CHECK((text_of(alone / "checkpoint.safetensors") == text_of(both / "checkpoint.safetensors")));
    CHECK((text_of(alone / "policy.safetensors") == text_of(both / "policy.safetensors")));
    CHECK(report_of(alone)["normalized_return"] == report_of(both)["normalized_return"]);
  }
}

TEST_CASE("track refuses bad arguments and bad files with one line and leaves nothing behind") {
  const fs::path folder = fresh("track", "refused"), out = folder / "out";
  std::ofstream(folder / "broken.safetensors") << "not a policy";
  std::ofstream(folder / "short.jsonl") << "{}\n";
  const auto refused = [&](const std::string& arguments, const std::string& part) {
    examples_test::refused(program, folder, arguments, part);
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
  refused(clip.string() + " --task fly --out " + out.string(), "--task");
  for (const char* named : {"--simulator", "'dice'", "bundled", "mujoco", "dart", "ode", "bullet"})
    refused(clip.string() + " --simulator dice --out " + out.string(), named);
  refused(clip.string() + " --task speed --slowest 3 --fastest 2 --out " + out.string(), "--fastest");
}
