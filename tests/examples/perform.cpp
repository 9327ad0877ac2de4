// SPDX-License-Identifier: MIT
#include <cmath>
#include <string>

#include <doctest/doctest.h>

#include "support.hpp"
#include <traceur/io/clip_file.hpp>
#include <traceur/io/mjcf.hpp>

using namespace traceur;
using namespace examples_test;

namespace {

const fs::path program = fs::path(TRACEUR_BIN_DIR) / "perform";
const fs::path humanoid = fs::path(TRACEUR_SOURCE_DIR) / "examples" / "characters" / "humanoid.xml";

fs::path fresh(const std::string& name) { return examples_test::fresh("perform", name); }

void put(const fs::path& path, const std::string& text) { std::ofstream(path, std::ios::binary) << text; }

/// A person who stands, raises an arm to the side and lowers it again, in one second.
motion::Clip wave() {
  motion::Clip c;
  c.name = "wave";
  c.skeleton = io::read_mjcf(humanoid).skeleton;
  constexpr int keys = 31;
  c.times = Eigen::VectorXd::LinSpaced(keys, 0, 1);
  c.poses.resize(c.skeleton.nq(), keys);
  const int shoulder = c.skeleton.find("left_shoulder");
  REQUIRE(shoulder >= 0);
  for (int k = 0; k < keys; ++k) {
    Eigen::VectorXd q = c.skeleton.neutral_pose();
    q[2] = 0.89;
    const double angle = 0.6 * (1 - std::cos(2 * 3.14159265358979 * c.times[k]));
    core::about_axis(core::Vector3<double>{1, 0, 0}, angle).store(q.data() + c.skeleton[shoulder].q_index);
    c.poses.col(k) = q;
  }
  return c;
}

Outcome perform(const fs::path& folder, const std::string& arguments) {
  return shell(folder, program.string() + " " + arguments);
}

struct EngineName {
  const char *name, *package;
  bool built;
};
constexpr EngineName engines[] = {
    {"mujoco", "libmujoco-dev",
#ifdef EXAMPLES_WITH_MUJOCO
     true
#else
     false
#endif
    },
    {"dart", "libdart-dev",
#ifdef EXAMPLES_WITH_DART
     true
#else
     false
#endif
    },
    {"ode", "libode-dev",
#ifdef EXAMPLES_WITH_ODE
     true
#else
     false
#endif
    },
    {"bullet", "libbullet-dev",
#ifdef EXAMPLES_WITH_BULLET
     true
#else
     false
#endif
    },
};

}  // namespace

TEST_CASE(
    "perform: a clip is performed, the same on any number of threads, after an interruption, and from its controller") {
  REQUIRE(fs::exists(program));
  const fs::path folder = fresh("job");
  io::write_clip(folder / "wave.jsonl", wave());
  const std::string job = (folder / "wave.jsonl").string() + " --quick --perturb --seed 3 --out ";
  const fs::path one = folder / "one", two = folder / "two", three = folder / "three", four = folder / "four";

  const Outcome first = perform(folder, job + one.string() + " --threads 1");
  INFO(first.out, first.err);
  REQUIRE(first.status == 0);
  CHECK(first.err.empty());
  for (const char* name : {"controller.json", "open_loop.jsonl", "motion.jsonl", "replay.html", "report.json"})
    CHECK(fs::exists(one / name));
  const auto report = report_of(one);
  for (const char* key : {"program", "version", "arguments", "clip", "duration_s", "cyclic", "retarget", "open_loop",
                          "closed_loop", "push_Ns", "sole_slide_m_s", "simulated_s", "wall_s", "seed", "status"})
    CHECK_MESSAGE(report.contains(key), key);
  CHECK(report["program"] == "perform");
  CHECK(report["status"] == "done");
  CHECK(!report.contains("why"));
  CHECK(report["seed"] == 3);
  CHECK(report["cyclic"] == false);
  CHECK(report["duration_s"].get<double>() == doctest::Approx(1));
  CHECK(report["push_Ns"].size() == 8);
  for (const char* share : {"slip", "give", "drift", "moved"}) CHECK(report["sole_slide_m_s"][share].get<double>() >= 0);
  CHECK(report["open_loop"]["fell"] == false);
  CHECK(report["open_loop"]["mean_joint_error_m"].get<double>() < 0.1);
  CHECK(report["closed_loop"]["trials"] == 100);
  CHECK(report["closed_loop"]["law_numbers"] == 297);
  CHECK(2 * report["closed_loop"]["survived"].get<int>() >= 100);
  // The clip stands still, so starts are moved less.
  CHECK(report["closed_loop"]["start_root_velocity_m_s"] == 0.1);
  const motion::Clip motion = io::read_clip(one / "motion.jsonl").clip;
  CHECK(motion.skeleton.size() == wave().skeleton.size());
  CHECK(motion.duration() > 1);

  const Outcome second = perform(folder, job + two.string() + " --threads 2");
  CHECK(second.status == 0);
  CHECK(text_of(two / "controller.json") == text_of(one / "controller.json"));
  CHECK(text_of(two / "motion.jsonl") == text_of(one / "motion.jsonl"));
  CHECK(report_of(two)["push_Ns"] == report["push_Ns"]);

  // Stopped while learning: no results yet, and the rest leads to the same bytes.
  const std::string saved = (three / "state" / "open_loop.json").string();
  const Outcome stopped =
      shell(folder, program.string() + " " + job + three.string() + " --threads 2 & pid=$!; while [ ! -e " + saved +
                        " ] && kill -0 $pid; do sleep 0.05; done; sleep 0.3; kill -TERM $pid; wait $pid");
  INFO(stopped.out, stopped.err);
  CHECK(stopped.status == 1);
  CHECK(!fs::exists(three / "controller.json"));
  CHECK(report_of(three)["status"] == "interrupted");
  CHECK(report_of(three)["why"].get<std::string>().find("--resume") != std::string::npos);
  const Outcome other_seed = perform(folder, "--resume " + three.string() + " --seed 4");
  CHECK(other_seed.status == 2);
  const Outcome resumed = perform(folder, "--resume " + three.string() + " --threads 1");
  CHECK(resumed.status == 0);
  CHECK(resumed.out.find("goes on after generation") != std::string::npos);
  CHECK(text_of(three / "controller.json") == text_of(one / "controller.json"));

  // Learning that goes on because its law failed too often does so until it is to look again, however it is
  // interrupted. A law is validated every five generations and whenever learning stops to look: five and five are like
  // ten.
  CHECK(report["closed_loop"]["went_on"] == false);
  const auto going_on = [&](const std::string& name, int generations, const std::string& how) {
    const fs::path job_folder = folder / name, file = job_folder / "state" / "learning.json";
    if (!fs::exists(job_folder)) fs::copy(three, job_folder, fs::copy_options::recursive);
    auto state = nlohmann::ordered_json::parse(text_of(file));
    state["look_at"] = state["generation"].get<int>() + generations;
    put(file, state.dump());
    CHECK(perform(folder, "--resume " + job_folder.string() + how).status < 2);
    return report_of(job_folder)["closed_loop"];
  };
  const auto at_once = going_on("whole", 10, " --threads 1");
  CHECK(at_once["went_on"] == true);
  CHECK(at_once["generations"].get<int>() == report["closed_loop"]["generations"].get<int>() + 10);
  CHECK(going_on("halves", 5, " --threads 2")["went_on"] == true);
  CHECK(going_on("halves", 5, " --threads 2")["generations"] == at_once["generations"]);
  const auto learnt = [&](const std::string& name) {
    auto state = nlohmann::ordered_json::parse(text_of(folder / name / "state" / "learning.json"));
    state.erase("wall_s");
    return state.dump();
  };
  CHECK(learnt("halves") == learnt("whole"));

  const Outcome replayed = perform(folder, "--controller " + (one / "controller.json").string() +
                                               " --quick --perturb --seed 3 --out " + four.string());
  CHECK(replayed.status == 0);
  CHECK(report_of(four)["closed_loop"]["survived"] == report["closed_loop"]["survived"]);
  CHECK(text_of(four / "motion.jsonl") == text_of(one / "motion.jsonl"));
  CHECK(!fs::exists(four / "controller.json"));
  CHECK(report_of(four)["simulator"] == "bundled");
  CHECK(report_of(one)["arguments"]["robust"].is_null());
  CHECK(!report_of(four).contains("fine_tuning"));

  for (const EngineName& engine : engines) {
    if (!engine.built) continue;
    CAPTURE(engine.name);
    const fs::path five = folder / engine.name;
    const std::string again = "--controller " + (one / "controller.json").string() + " --quick --seed 3 --simulator " + engine.name;
    const Outcome elsewhere = perform(folder, again + " --out " + five.string());
    CAPTURE(elsewhere.err);
    REQUIRE(elsewhere.status >= 0);
    CHECK(elsewhere.status < 2);
    const auto there = report_of(five);
    CHECK(there["simulator"] == engine.name);
    CHECK(there["push_Ns"].size() == 8);
    // It is the same motion, but not the same simulation of it.
    CHECK(2 * there["closed_loop"]["survived"].get<int>() >= there["closed_loop"]["trials"].get<int>());
    CHECK(text_of(five / "motion.jsonl") != text_of(four / "motion.jsonl"));
    const motion::Clip moved = io::read_clip(five / "motion.jsonl").clip;
    CHECK(moved.duration() == doctest::Approx(motion.duration()).epsilon(0.1));
  }

  // Fine-tuning ends in time, and what it leaves is a controller like any other.
  for (const std::string name : {"bundled", "mujoco"}) {
    if (name == "mujoco" && !engines[0].built) continue;
    CAPTURE(name);
    const fs::path out = folder / (name + "-tuned");
    const Outcome o = perform(folder, "--controller " + (one / "controller.json").string() + " --quick --seed 3 --fine-tune 2 --simulator " + name +
                                          (name == "bundled" ? " --robust" : "") + " --out " + out.string());
    CAPTURE(o.err);
    CHECK(o.status < 2);
    const auto tuning = report_of(out)["fine_tuning"];
    CHECK(tuning["simulated_s"].get<double>() >= 0);
    CHECK(tuning["wall_s"].get<double>() < 3);
    if (name == "bundled") CHECK(tuning["generations"].get<int>() >= 1);
    CHECK(report_of(out).contains("robust") == (name == "bundled"));
    CHECK(fs::exists(out / "controller.json"));
    const Outcome again = perform(folder, "--controller " + (out / "controller.json").string() + " --quick --seed 3 --simulator " + name +
                                              " --out " + (folder / (name + "-again")).string());
    CHECK(again.status < 2);
    CHECK(report_of(folder / (name + "-again"))["closed_loop"]["survived"] == report_of(out)["closed_loop"]["survived"]);
  }
}

TEST_CASE("perform: bad input is refused in one line that names the fault, and nothing is written") {
  REQUIRE(fs::exists(program));
  const fs::path folder = fresh("refused"), out = folder / "out";
  const std::string clip = (folder / "wave.jsonl").string();
  io::write_clip(clip, wave());
  const std::string good = text_of(clip);

  const auto refused = [&](const std::string& arguments, const std::string& named) {
    examples_test::refused(program, folder, arguments, named);
  };
  const std::string to = " --quick --out " + out.string();

  refused((folder / "absent.bvh").string() + to, "absent.bvh");

  put(folder / "short.jsonl", good.substr(0, good.find('\n', good.find('\n') + 1) + 1));
  refused((folder / "short.jsonl").string() + to, "short.jsonl");

  std::string broken = good;
  const std::size_t number = broken.find("\"q\":[") + 5;
  broken.replace(number, broken.find(',', number) - number, "NaN");
  put(folder / "nan.jsonl", broken);
  refused((folder / "nan.jsonl").string() + to, "nan.jsonl");

  put(folder / "map.json", "{\"left_knee\": \"no_such_joint\"}");
  refused(clip + to + " --joint-map " + (folder / "map.json").string(), "no_such_joint");

  std::string weightless = text_of(humanoid);
  for (std::size_t at = 0; (at = weightless.find("density=\"1141\"", at)) != std::string::npos;)
    weightless.replace(at, 14, "density=\"0\"");
  put(folder / "weightless.xml", weightless);
  refused(clip + to + " --character " + (folder / "weightless.xml").string(), "mass");

  put(folder / "empty.json", "{\"cell_m\": 0.4, \"corner_m\": [0, 0], \"heights_m\": []}");
  refused(clip + to + " --terrain " + (folder / "empty.json").string(), "empty.json");

  put(folder / "controller.json", "{\"format\": \"traceur controller 1\"}");
  refused("--controller " + (folder / "controller.json").string() + to, "controller.json");

  put(folder / "file", "not a folder");
  refused(clip + " --quick --out " + (folder / "file" / "out").string(), "file");
  refused(clip + " --quick --out " + out.string() + " --report " + (folder / "file" / "report.json").string(), "file");
  fs::remove_all(out);

  refused(clip + to + " --sede 3", "--sede");
  refused(clip + to + " --motion sideways", "sideways");
  refused(clip + to + " --dt-hz 200", "--dt-hz");
  for (const char* named : {"'physix'", "bundled", "mujoco", "dart", "ode", "bullet"}) refused(clip + to + " --simulator physix", named);
  for (const EngineName& engine : engines)
    if (!engine.built) refused(clip + to + " --simulator " + engine.name, engine.package);
  refused(clip + to + " --fine-tune -1", "--fine-tune");
  refused(clip + to + " --unit 0.01", "unit");
  refused(clip + " --quick", "--out");
  refused("--out " + out.string(), "CLIP");
  refused("--resume " + folder.string(), "--resume");
}

TEST_CASE("perform: help and version are not errors") {
  REQUIRE(fs::exists(program));
  const fs::path folder = fresh("help");
  const Outcome help = perform(folder, "--help");
  CHECK(help.status == 0);
  for (const char* option : {"--character", "--terrain", "--perturb", "--out", "--report", "--resume", "--quick", "--simulator",
                             "--fine-tune"})
    CHECK_MESSAGE(help.out.find(option) != std::string::npos, option);
  CHECK(perform(folder, "--version").out == std::string(TRACEUR_PROJECT_VERSION) + "\n");
}
