// SPDX-License-Identifier: MIT
#include <traceur/io/gltf.hpp>

#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <set>
#include <string>
#include <vector>

#include <doctest/doctest.h>
#include <nlohmann/json.hpp>

#include "glb.hpp"
#include "motions.hpp"
#include <traceur/io/bvh.hpp>
#include <traceur/io/csv.hpp>

namespace io = traceur::io;
namespace body = traceur::body;
using Json = nlohmann::json;
using glb::File;
using motions::contains;
using motions::error_of;
using traceur::core::Quaternion;
using Vector = traceur::core::Vector3<double>;

namespace {

body::Character figure() {
  body::Character c;
  c.name = "figure";
  const auto add = [&](const char* name, int parent, body::JointType type, Vector offset) {
    body::Joint j;
    j.name = name;
    j.body = std::string(name) + " body";
    j.parent = parent;
    j.type = type;
    j.offset = offset;
    if (type == body::JointType::hinge) {
      j.axis = {0, -1, 0};
      j.rest = traceur::core::about_axis(Vector{0, 0, 1}, 0.4);
    }
    c.skeleton.add(j);
  };
  add("root", -1, body::JointType::free, {0, 0, 0});
  add("spine", 0, body::JointType::ball, {0.02, 0, 0.3});
  add("elbow", 1, body::JointType::hinge, {0, 0.2, 0.1});
  add("tip", 2, body::JointType::fixed, {0.25, 0, 0});
  using Kind = body::Shape::Kind;
  const Quaternion<double> turned = traceur::core::exp_map(Vector{0.3, -0.5, 0.2});
  c.shapes.push_back({Kind::box, "pelvis", 0, {0.1, 0, 0}, turned, {0.1, 0.2, 0.05}});
  c.shapes.push_back({Kind::sphere, "chest", 1, {0, 0, 0.1}, Quaternion<double>::identity(), {0.15, 0, 0}});
  c.shapes.push_back({Kind::capsule, "arm", 2, {0.1, 0, 0}, turned, {0.04, 0.12, 0}});
  return c;
}

traceur::motion::Clip wave(const body::Skeleton& skeleton) {
  traceur::motion::Clip clip;
  clip.name = "wave";
  clip.skeleton = skeleton;
  const int keys = 9;
  clip.times = Eigen::VectorXd::LinSpaced(keys, 0, 1.6);
  clip.poses.resize(skeleton.nq(), keys);
  for (int k = 0; k < keys; ++k) {
    Eigen::VectorXd q = skeleton.neutral_pose();
    const double t = clip.times[k];
    q.head(3) << t, 0.2 * std::sin(3 * t), 1 + 0.1 * t;
    // More than a full turn, written with either sign.
    (k % 2 ? Quaternion<double>{0, 0, 1, 0} * Quaternion<double>{0, 0, 1, 0} : Quaternion<double>::identity())
        .store(q.data() + 3);
    Quaternion<double> turn =
        traceur::core::about_axis(Vector{0, 0, 1}, 5 * t) * Quaternion<double>::from(q.data() + 3);
    turn.store(q.data() + 3);
    traceur::core::exp_map(Vector{0.5 * t, -t, 0.3}).store(q.data() + 7);
    q[11] = -1.2 * t;
    clip.poses.col(k) = q;
  }
  return clip;
}

io::GltfScene whole_scene() {
  io::GltfScene scene;
  scene.title = "test";
  const body::Character c = figure();
  scene.actors.push_back({"first", c, wave(c.skeleton)});
  scene.actors.push_back({"second", c, {}, {1, 0, 0}});
  Eigen::MatrixXd h(3, 2);
  h << 0, 1, 0.5, 1, -2, 0;
  scene.terrain.emplace(h, 0.5, -1.0, 2.0);
  return scene;
}

/// House axes of a point in the file's: x of the file is left, y up, z forward.
Vector house(const Vector& file) { return {file.z, file.x, file.y}; }

}  // namespace

TEST_CASE("every file keeps the rules of the format") {
  glb::check(io::format_gltf({}));
  glb::check(io::format_gltf(whole_scene()));
  io::GltfScene bones = io::gltf_scene(wave(figure().skeleton));
  glb::check(io::format_gltf(bones));
  bones.title = "quote \" and \xFF and \n";
  glb::check(io::format_gltf(bones));
  io::GltfScene flat;
  flat.terrain = traceur::terrain::HeightGrid::flat(0.3);
  glb::check(io::format_gltf(flat));
}

TEST_CASE("the check of the rules sees what breaks them") {
  const std::string good = io::format_gltf(whole_scene());
  const auto broken = [&](std::size_t at, char value) {
    std::string text = good;
    text[at] = value;
    return glb::faults(text);
  };
  CHECK(glb::faults(good).empty());
  CHECK(broken(0, 'x') == "magic");
  CHECK(broken(4, 1) == "version");
  CHECK(broken(8, static_cast<char>(good[8] + 4)) == "length");
  CHECK(glb::faults(good.substr(0, good.size() - 4)) == "length");
  const auto change = [&](const char* pointer, const Json& value) {
    return glb::faults(glb::changed(good, pointer, value));
  };
  CHECK(change("/scene", 0) == "");
  CHECK(change("/asset/version", "1.0") == "asset");
  CHECK(change("/accessors/0/count", 1000000) == "accessor 0: beyond its view");
  CHECK(change("/accessors/0/min/0", -77.5) == "accessor 0: bounds");
  CHECK(change("/bufferViews/0/byteOffset", 2) == "view 0: alignment");
  CHECK(change("/nodes/1/children", Json::array({0})) == "node 0: a scene's root with a parent");
  CHECK(change("/nodes/0/rotation/0", 0.7) == "node 0: rotation");
  CHECK(change("/animations/0/channels/0/target/path", "scale") == "animation 0: path");
  CHECK(change("/animations/0/channels/1/target", {{"node", 2}, {"path", "translation"}}) ==
        "animation 0: target twice");
}

TEST_CASE("the nodes are where forward kinematics has the bodies, at every key") {
  const io::GltfScene scene = whole_scene();
  const File file(io::format_gltf(scene));
  const traceur::motion::Clip& clip = *scene.actors[0].motion;
  const body::Skeleton& s = clip.skeleton;
  body::Frames<double> frames(s);
  double worst = 0;
  for (int k = 0; k < clip.keys(); ++k) {
    const auto placed = file.animated(static_cast<std::size_t>(k));
    body::forward_kinematics(s, clip.poses.col(k).data(), frames);
    for (int i = 0; i < s.size(); ++i) {
      const std::size_t node = file.find_node(s[i].body);
      const auto b = static_cast<std::size_t>(i);
      const Vector probe{0.1, -0.2, 0.3};
      worst = std::max(worst, norm(house(placed[node].apply({0, 0, 0})) - frames.position[b]));
      worst = std::max(worst, norm(house(placed[node].apply(probe)) - frames.point(i, probe)));
    }
  }
  CHECK(worst < 1e-5);
  CHECK(file.json["animations"][0]["channels"].size() == 4);  // the root's two, the spine's, the elbow's
}

TEST_CASE("an actor without a motion stands in its neutral pose") {
  io::GltfScene scene = whole_scene();
  scene.actors.erase(scene.actors.begin());
  const File file(io::format_gltf(scene));
  CHECK(!file.json.contains("animations"));
  const body::Skeleton& s = scene.actors[0].character.skeleton;
  body::Frames<double> frames(s);
  const Eigen::VectorXd q = s.neutral_pose();
  body::forward_kinematics(s, q.data(), frames);
  const auto placed = file.animated(0);
  for (int i = 0; i < s.size(); ++i)
    CHECK(norm(house(placed[file.find_node(s[i].body)].apply({0, 0, 0})) -
               frames.position[static_cast<std::size_t>(i)]) < 1e-6);
}

TEST_CASE("neighbouring keys' quaternions are less than half a turn of their space apart") {
  const File file(io::format_gltf(whole_scene()));
  for (const Json& channel : file.json["animations"][0]["channels"]) {
    if (channel["target"]["path"] != "rotation") continue;
    const auto values =
        file.numbers(file.json["animations"][0]["samplers"][channel["sampler"].get<std::size_t>()]["output"]);
    for (std::size_t i = 4; i < values.size(); i += 4) {
      double along = 0;
      for (std::size_t k = 0; k < 4; ++k) along += values[i + k] * values[i + k - 4];
      CHECK(along >= 0);
    }
  }
}

TEST_CASE("shapes are closed surfaces that hold the shape's volume about its centre") {
  const body::Character c = figure();
  for (const body::Shape& shape : c.shapes) {
    CAPTURE(shape.name);
    body::Character one = c;
    one.shapes = {shape};
    io::GltfScene scene;
    scene.actors.push_back({"one", one, {}});
    const File file(io::format_gltf(scene));
    REQUIRE(file.json["meshes"].size() == 1);
    const glb::Solid solid = file.solid(0);
    CHECK(solid.closed);
    const double volume = body::solid(shape, 1.0).mass;
    // Flat facets lie inside the round ones.
    CHECK(solid.volume < volume * 1.00001);
    CHECK(solid.volume > volume * (shape.kind == body::Shape::Kind::box ? 0.99999 : 0.96));
    CHECK(norm(solid.center - shape.position) < 1e-6);
  }
}

TEST_CASE("bones reach from joint to joint") {
  const traceur::motion::Clip clip = wave(figure().skeleton);
  const File file(io::format_gltf(io::gltf_scene(clip)));
  CHECK(file.json["meshes"].size() == 3);
  for (std::size_t m = 0; m < 3; ++m) {
    const Vector tip = clip.skeleton[static_cast<int>(m) + 1].offset;
    double longest = 0;
    for (const Vector& p : file.corners(m)) longest = std::max(longest, dot(p, tip) / norm(tip));
    CHECK(longest == doctest::Approx(norm(tip)));
    CHECK(file.solid(m).closed);
    CHECK(file.solid(m).volume > 0);
  }
}

TEST_CASE("the terrain is the grid's surface: tops at its heights, walls between") {
  io::GltfScene scene = whole_scene();
  scene.actors.clear();
  scene.border = 0;
  const traceur::terrain::HeightGrid& grid = *scene.terrain;
  const File file(io::format_gltf(scene));
  // Looked at from above, every point has one top, at the grid's height.
  for (int i = 0; i < 32; ++i)
    for (int j = 0; j < 22; ++j) {
      const double x = -1 + 1.5 * (i + 0.5) / 32, y = 2 + 1.0 * (j + 0.5) / 22;
      const std::vector<double> hits = file.heights_above(0, x, y);
      REQUIRE(!hits.empty());
      for (const double h : hits) CHECK(h == doctest::Approx(grid.height(x, y)));
    }
  // Walls: |step| times the cell, over all neighbours; looking towards the lower side.
  double expected = 0;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 2; ++j) {
      if (i < 2) expected += 0.5 * std::abs(grid(i + 1, j) - grid(i, j));
      if (j < 1) expected += 0.5 * std::abs(grid(i, j + 1) - grid(i, j));
    }
  double walls = 0, tops = 0;
  for (const glb::Triangle& t : file.triangles(0)) {
    const Vector area = 0.5 * cross(t.b - t.a, t.c - t.a);
    const Vector middle = (1.0 / 3) * (t.a + t.b + t.c), n = (1 / norm(area)) * area;
    if (n.z > 0.5) {
      tops += norm(area);
    } else {
      walls += norm(area);
      const Vector before = middle + 0.01 * n, behind = middle - 0.01 * n;
      CHECK(grid.height(before.x, before.y) < middle.z);
      CHECK(grid.height(behind.x, behind.y) > middle.z);
    }
  }
  CHECK(walls == doctest::Approx(expected));
  CHECK(tops == doctest::Approx(6 * 0.25));
  // With a border the outermost cells are wider.
  scene.border = 3;
  const File wide(io::format_gltf(scene));
  CHECK(wide.heights_above(0, -3.9, 2.2).at(0) == doctest::Approx(0));
  CHECK(wide.heights_above(0, 3.4, 5.9).at(0) == doctest::Approx(0));
}

TEST_CASE("docs/io.md") {
  const body::Character character = figure();
  const traceur::motion::Clip clip = wave(character.skeleton);
  const auto grid = traceur::terrain::HeightGrid::flat();
  const auto folder = std::filesystem::temp_directory_path() / "traceur-test-gltf-docs";
  std::filesystem::create_directory(folder);

  traceur::io::GltfScene scene = traceur::io::gltf_scene(clip);  // drawn by its bones
  scene.actors[0].character = character;                         // drawn by its shapes
  scene.terrain = grid;
  traceur::io::write_gltf(folder / "walk.glb", scene);
  traceur::io::write_csv(folder / "walk.csv", traceur::io::clip_table(clip));
  traceur::io::write_bvh(folder / "walk.bvh", clip);
  std::ifstream in(folder / "walk.glb", std::ios::binary);
  glb::check({std::istreambuf_iterator<char>(in), {}});
  CHECK(std::filesystem::file_size(folder / "walk.csv") > 1000);
  CHECK(std::filesystem::file_size(folder / "walk.bvh") > 1000);
  std::filesystem::remove_all(folder);
}

TEST_CASE("a file is written whole") {
  const auto path = std::filesystem::temp_directory_path() / "traceur-test-scene.glb";
  const io::GltfScene scene = whole_scene();
  io::write_gltf(path, scene);
  std::ifstream in(path, std::ios::binary);
  const std::string bytes{std::istreambuf_iterator<char>(in), {}};
  CHECK(bytes == io::format_gltf(scene));
  std::filesystem::remove(path);
}

TEST_CASE("what does not fit is refused by the actor's name") {
  const auto refused = [](auto change, const char* expected) {
    io::GltfScene scene = whole_scene();
    change(scene);
    const std::string message = error_of([&] { io::format_gltf(scene); });
    CAPTURE(message);
    CHECK(contains(message, expected));
    CHECK(!contains(message, "\n"));
  };
  using Scene = io::GltfScene;
  refused([](Scene& s) { s.actors[1].character = {}; }, "actor 'second': expected at least one body");
  refused([](Scene& s) { s.actors[0].color[1] = 2; }, "actor 'first': expected a colour");
  refused([](Scene& s) { s.actors[0].character.shapes[0].body = 9; },
          "shape 'pelvis' names a body that does not exist");
  refused([](Scene& s) { s.actors[0].motion->poses(0, 3) = std::nan(""); }, "frame 3");
  refused([](Scene& s) { s.actors[0].motion->poses(0, 3) = 1e200; }, "the root's place is beyond what a float holds");
  refused([](Scene& s) { s.actors[0].motion->times[8] = std::nextafter(s.actors[0].motion->times[7], 9.0); },
          "frame 8: as a float its time is not after");
  refused(
      [](Scene& s) {
        body::Joint lone;
        lone.name = lone.body = "lone";
        lone.type = body::JointType::free;
        s.actors[0].character = {};
        s.actors[0].character.skeleton.add(lone);
      },
      "expected a motion of the character's own joints");
  refused([](Scene& s) { s.border = -1; }, "border: expected metres");
}
