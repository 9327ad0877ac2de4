// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <numbers>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

#include "traceur/body/character.hpp"
#include "traceur/core/error.hpp"
#include "traceur/io/atomic_file.hpp"
#include "traceur/motion/clip.hpp"
#include "traceur/terrain/height_grid.hpp"

namespace traceur::io {

/// Who moves, and how. Of the character only skeleton and shapes are used; a body without shapes is drawn as a bone to
/// each of its children. Without a motion the character stands in its neutral pose.
struct GltfActor {
  std::string name;
  body::Character character;
  std::optional<motion::Clip> motion;             ///< its skeleton has the character's joints, in the same order
  std::array<double, 3> color{0.30, 0.55, 0.85};  ///< linear red, green, blue, each in [0, 1]
};

struct GltfScene {
  std::string title;
  std::vector<GltfActor> actors;
  std::optional<terrain::HeightGrid> terrain;
  double border = 2;  ///< metres by which the terrain's outermost cells are drawn wider, as they go on for ever
};

namespace detail {

/// The JSON document and the binary chunk of a glTF file under construction.
class GltfDocument {
public:
  using Json = nlohmann::json;

  Json json = {{"asset", {{"version", "2.0"}, {"generator", "traceur"}}}};

  enum Target { none = 0, vertices = 34962, indices = 34963 };

  /// Stores columns of floats; returns the accessor's number. `bounds` adds the smallest and largest of each row, as
  /// positions and key times need.
  int floats(const std::vector<float>& values, int rows, Target target, bool bounds) {
    static constexpr const char* types[] = {"", "SCALAR", "VEC2", "VEC3", "VEC4"};
    const std::size_t begin = binary_.size();
    for (const float v : values) append(std::bit_cast<std::uint32_t>(v));
    Json accessor = {{"bufferView", view(begin, target)},
                     {"componentType", 5126},
                     {"count", values.size() / static_cast<std::size_t>(rows)},
                     {"type", types[rows]}};
    if (bounds) {
      for (int r = 0; r < rows; ++r) {
        float low = std::numeric_limits<float>::max(), high = std::numeric_limits<float>::lowest();
        for (std::size_t i = static_cast<std::size_t>(r); i < values.size(); i += static_cast<std::size_t>(rows)) {
          low = std::min(low, values[i]);
          high = std::max(high, values[i]);
        }
        accessor["min"].push_back(low);
        accessor["max"].push_back(high);
      }
    }
    return push("accessors", std::move(accessor));
  }

  int whole_numbers(const std::vector<std::uint32_t>& values) {
    const std::size_t begin = binary_.size();
    for (const std::uint32_t v : values) append(v);
    return push(
        "accessors",
        {{"bufferView", view(begin, indices)}, {"componentType", 5125}, {"count", values.size()}, {"type", "SCALAR"}});
  }

  /// Appends to one of the document's lists and returns the number of the new entry.
  int push(const char* list, Json entry) {
    json[list].push_back(std::move(entry));
    return static_cast<int>(json[list].size()) - 1;
  }

  /// The file: a header, the JSON and the binary chunk, each chunk a multiple of four bytes long.
  std::string finish() {
    if (!binary_.empty()) json["buffers"] = Json::array({{{"byteLength", binary_.size()}}});
    std::string text = json.dump(-1, ' ', false, Json::error_handler_t::replace);
    text.resize((text.size() + 3) / 4 * 4, ' ');
    const std::size_t size = 12 + 8 + text.size() + (binary_.empty() ? 0 : 8 + binary_.size());
    if (size > std::numeric_limits<std::uint32_t>::max()) throw Error("glTF: the scene takes more than 4 GiB");
    std::string chunk = std::exchange(binary_, {});
    const auto length = static_cast<std::uint32_t>(chunk.size());
    append(0x46546C67);  // "glTF"
    append(2);
    append(static_cast<std::uint32_t>(size));
    append(static_cast<std::uint32_t>(text.size()));
    append(0x4E4F534A);  // "JSON"
    binary_ += text;
    if (length > 0) {
      append(length);
      append(0x004E4942);  // "BIN"
      binary_ += chunk;
    }
    return std::move(binary_);
  }

private:
  // Little-endian whatever the machine's order.
  void append(std::uint32_t word) {
    for (int k = 0; k < 4; ++k) binary_.push_back(static_cast<char>(word >> (8 * k) & 255U));
  }
  int view(std::size_t begin, Target target) {
    Json v = {{"buffer", 0}, {"byteOffset", begin}, {"byteLength", binary_.size() - begin}};
    if (target != none) v["target"] = static_cast<int>(target);
    return push("bufferViews", std::move(v));
  }

  std::string binary_;
};

/// Triangles with a normal at each corner.
class GltfMesh {
public:
  bool empty() const { return triangles_.empty(); }

  std::uint32_t corner(const core::Vector3<double>& p, const core::Vector3<double>& n) {
    for (const double e : {p.x, p.y, p.z}) positions_.push_back(static_cast<float>(e));
    for (const double e : {n.x, n.y, n.z}) normals_.push_back(static_cast<float>(e));
    return static_cast<std::uint32_t>(positions_.size() / 3 - 1);
  }
  void triangle(std::uint32_t a, std::uint32_t b, std::uint32_t c) {
    for (const std::uint32_t i : {a, b, c}) triangles_.push_back(i);
  }
  /// A parallelogram, seen from where its corners run counterclockwise: p, p + a, p + a + b, p + b.
  void quad(const core::Vector3<double>& p, const core::Vector3<double>& a, const core::Vector3<double>& b) {
    const core::Vector3<double> c = cross(a, b), n = (1 / norm(c)) * c;
    const std::uint32_t first = corner(p, n);
    corner(p + a, n);
    corner(p + a + b, n);
    corner(p + b, n);
    triangle(first, first + 1, first + 2);
    triangle(first, first + 2, first + 3);
  }

  void add(const body::Shape& s) {
    const auto place = [&](const core::Vector3<double>& p) { return s.position + s.rotation.rotate(p); };
    if (s.kind == body::Shape::Kind::box) {
      const core::Vector3<double> ex{2 * s.size.x, 0, 0}, ey{0, 2 * s.size.y, 0}, ez{0, 0, 2 * s.size.z};
      const core::Vector3<double> low = -1.0 * s.size, high = s.size;
      const auto side = [&](const core::Vector3<double>& p, const core::Vector3<double>& a,
                            const core::Vector3<double>& b) {
        quad(place(p), s.rotation.rotate(a), s.rotation.rotate(b));
      };
      side(low, ey, ex);
      side(low, ex, ez);
      side(low, ez, ey);
      side(high, -1.0 * ex, -1.0 * ey);
      side(high, -1.0 * ez, -1.0 * ex);
      side(high, -1.0 * ey, -1.0 * ez);
      return;
    }
    // Rings of equal latitude, pole to pole; a capsule's equator stands there twice, at either end of its axis.
    constexpr int around = 24, half = 6;
    const double radius = s.size.x, reach = s.kind == body::Shape::Kind::capsule ? s.size.y : 0.0;
    constexpr int rings = 2 * half + 2;
    std::uint32_t first = 0;
    for (int r = 0; r < rings; ++r) {
      const bool upper = r > half;
      const double latitude = std::numbers::pi / 2 * ((upper ? r - 1 : r) - half) / half;
      for (int k = 0; k <= around; ++k) {
        const double longitude = 2 * std::numbers::pi * (k % around) / around;
        const core::Vector3<double> n{std::cos(latitude) * std::cos(longitude),
                                      std::cos(latitude) * std::sin(longitude), std::sin(latitude)};
        const std::uint32_t at =
            corner(place(radius * n + core::Vector3<double>{0, 0, upper ? reach : -reach}), s.rotation.rotate(n));
        if (r == 0 && k == 0) first = at;
      }
    }
    for (int r = 0; r + 1 < rings; ++r) {
      if (r == half && reach == 0) continue;
      for (int k = 0; k < around; ++k) {
        const auto at = [&](int ring, int place_on_ring) {
          return first + static_cast<std::uint32_t>(ring * (around + 1) + place_on_ring);
        };
        // At a pole one of the two triangles has no area.
        if (r > 0) triangle(at(r, k), at(r, k + 1), at(r + 1, k + 1));
        if (r + 2 < rings) triangle(at(r, k), at(r + 1, k + 1), at(r + 1, k));
      }
    }
  }

  /// A slim double pyramid from the origin to `tip`.
  void add_bone(const core::Vector3<double>& tip) {
    const double length = norm(tip);
    if (!(length > 1e-6)) return;
    const core::Vector3<double> z = (1 / length) * tip;
    const core::Vector3<double> helper =
        std::abs(z.x) < 0.7 ? core::Vector3<double>{1, 0, 0} : core::Vector3<double>{0, 1, 0};
    const core::Vector3<double> across = cross(z, helper), x = (1 / norm(across)) * across, y = cross(z, x);
    const double width = std::min(0.1 * length, 0.03);
    const std::array<core::Vector3<double>, 4> ring{width * x, width * y, -width * x, -width * y};
    const core::Vector3<double> waist = 0.2 * tip;
    for (std::size_t k = 0; k < 4; ++k) {
      const core::Vector3<double> a = waist + ring[k], b = waist + ring[(k + 1) % 4];
      facet(a, b, tip);
      facet(b, a, core::Vector3<double>::zero());
    }
  }

  /// The number of the mesh in the document. Throws Error when a corner is not finite as a float.
  int store(GltfDocument& document, const std::string& name, int material) const {
    for (const float p : positions_)
      if (!std::isfinite(p)) throw Error("glTF: mesh '" + name + "': a coordinate is beyond what a float holds");
    const int position = document.floats(positions_, 3, GltfDocument::vertices, true);
    const int normal = document.floats(normals_, 3, GltfDocument::vertices, false);
    const int index = document.whole_numbers(triangles_);
    return document.push("meshes", {{"name", name},
                                    {"primitives",
                                     {{{"attributes", {{"POSITION", position}, {"NORMAL", normal}}},
                                       {"indices", index},
                                       {"material", material}}}}});
  }

private:
  void facet(const core::Vector3<double>& a, const core::Vector3<double>& b, const core::Vector3<double>& c) {
    const core::Vector3<double> area = cross(b - a, c - a), n = (1 / norm(area)) * area;
    const std::uint32_t first = corner(a, n);
    corner(b, n);
    corner(c, n);
    triangle(first, first + 1, first + 2);
  }

  std::vector<float> positions_, normals_;
  std::vector<std::uint32_t> triangles_;
};

inline int add_gltf_material(GltfDocument& document, const std::string& name, const std::array<double, 3>& color) {
  return document.push("materials", {{"name", name},
                                     {"pbrMetallicRoughness",
                                      {{"baseColorFactor", {color[0], color[1], color[2], 1.0}},
                                       {"metallicFactor", 0.0},
                                       {"roughnessFactor", 0.8}}}});
}

/// Tops of all columns and the walls between columns of different height.
inline GltfMesh terrain_mesh(const terrain::HeightGrid& grid, double border) {
  const int nx = grid.nx(), ny = grid.ny();
  const auto edge = [&](int i, int n, double origin) {
    return origin + i * grid.cell() + (i == 0 ? -border : i == n ? border : 0.0);
  };
  GltfMesh mesh;
  for (int j = 0; j < ny; ++j)
    for (int i = 0; i < nx; ++i) {
      const double x = edge(i, nx, grid.x0()), y = edge(j, ny, grid.y0()), h = grid(i, j);
      const double wide = edge(i + 1, nx, grid.x0()) - x, deep = edge(j + 1, ny, grid.y0()) - y;
      mesh.quad({x, y, h}, {wide, 0, 0}, {0, deep, 0});
      // The wall looks towards the lower column: both corners' order and rise change sign with the step.
      if (const double step = i + 1 < nx ? grid(i + 1, j) - h : 0.0; step > 0)
        mesh.quad({x + wide, y, h}, {0, 0, step}, {0, deep, 0});
      else if (step < 0)
        mesh.quad({x + wide, y, h + step}, {0, deep, 0}, {0, 0, -step});
      if (const double step = j + 1 < ny ? grid(i, j + 1) - h : 0.0; step > 0)
        mesh.quad({x, y + deep, h}, {wide, 0, 0}, {0, 0, step});
      else if (step < 0)
        mesh.quad({x, y + deep, h + step}, {0, 0, -step}, {wide, 0, 0});
    }
  return mesh;
}

inline void append_floats(std::vector<float>& out, const core::Vector3<double>& v) {
  for (const double e : {v.x, v.y, v.z}) out.push_back(static_cast<float>(e));
}

/// Of unit length as floats too, and in the half of quaternion space of the one before, so that whoever interpolates
/// the four numbers goes the short way.
inline void append_floats(std::vector<float>& out, core::Quaternion<double> q) {
  q = q.normalized();
  const std::size_t n = out.size();
  if (n >= 4 && q.x * out[n - 4] + q.y * out[n - 3] + q.z * out[n - 2] + q.w * out[n - 1] < 0)
    q = {-q.x, -q.y, -q.z, -q.w};
  for (const double e : {q.x, q.y, q.z, q.w}) out.push_back(static_cast<float>(e));
}

/// The actor's nodes, one a joint, its mesh and its part of the animation; returns the root's node.
inline int add_gltf_actor(GltfDocument& document, const GltfActor& actor, nlohmann::json& animation) {
  const body::Skeleton& s = actor.character.skeleton;
  const std::string where = "glTF: actor '" + actor.name + "'";
  if (s.size() == 0) throw Error(where + ": expected at least one body");
  for (const double c : actor.color)
    if (!(c >= 0 && c <= 1)) throw Error(where + ": expected a colour of numbers in [0, 1]");
  if (actor.motion) {
    actor.motion->check();
    bool same = actor.motion->skeleton.size() == s.size();
    for (int i = 0; same && i < s.size(); ++i)
      same = actor.motion->skeleton[i].name == s[i].name && actor.motion->skeleton[i].type == s[i].type &&
             actor.motion->skeleton[i].parent == s[i].parent;
    if (!same) throw Error(where + ": expected a motion of the character's own joints");
  }
  for (const body::Shape& shape : actor.character.shapes)
    if (shape.body < 0 || shape.body >= s.size())
      throw Error(where + ": shape '" + shape.name + "' names a body that does not exist");

  const int material = add_gltf_material(document, actor.name, actor.color);
  const Eigen::VectorXd first = actor.motion ? Eigen::VectorXd(actor.motion->poses.col(0)) : s.neutral_pose();
  const int base = static_cast<int>(document.json["nodes"].size());
  for (int i = 0; i < s.size(); ++i) {
    const body::Joint& j = s[i];
    GltfMesh mesh;
    for (const body::Shape& shape : actor.character.shapes)
      if (shape.body == i) mesh.add(shape);
    GltfDocument::Json node = {{"name", j.body}};
    for (int c = i + 1; c < s.size(); ++c)
      if (s[c].parent == i) {
        node["children"].push_back(base + c);
        if (actor.character.shapes.empty()) mesh.add_bone(s[c].offset);
      }
    if (!mesh.empty()) node["mesh"] = mesh.store(document, j.body, material);
    std::vector<float> place, turn;
    append_floats(place, j.type == body::JointType::free ? core::Vector3<double>::from(first.data()) : j.offset);
    append_floats(turn, j.rest * body::joint_rotation(j, first.data()));
    for (const float p : place)
      if (!std::isfinite(p)) throw Error(where + ": joint '" + j.name + "': its place is beyond what a float holds");
    node["translation"] = place;
    node["rotation"] = turn;
    document.push("nodes", std::move(node));
  }
  if (!actor.motion) return base;

  const motion::Clip& clip = *actor.motion;
  std::vector<float> times;
  for (int k = 0; k < clip.keys(); ++k) {
    times.push_back(static_cast<float>(clip.times[k]));
    if (k > 0 && !(times[times.size() - 1] > times[times.size() - 2] && std::isfinite(times.back())))
      throw Error(where + ", frame " + std::to_string(k) + ": as a float its time is not after the frame before");
  }
  const int input = document.floats(times, 1, GltfDocument::none, true);
  const auto channel = [&](int joint, const char* path, const std::vector<float>& values, int rows) {
    const int output = document.floats(values, rows, GltfDocument::none, false);
    animation["samplers"].push_back({{"input", input}, {"output", output}, {"interpolation", "LINEAR"}});
    animation["channels"].push_back(
        {{"sampler", animation["samplers"].size() - 1}, {"target", {{"node", base + joint}, {"path", path}}}});
  };
  for (int i = 0; i < s.size(); ++i) {
    const body::Joint& j = s[i];
    if (j.type == body::JointType::fixed) continue;
    std::vector<float> places, turns;
    for (int k = 0; k < clip.keys(); ++k) {
      const double* q = clip.poses.col(k).data();
      if (j.type == body::JointType::free) append_floats(places, core::Vector3<double>::from(q));
      append_floats(turns, j.rest * body::joint_rotation(j, q));
    }
    for (const float p : places)
      if (!std::isfinite(p)) throw Error(where + ": the root's place is beyond what a float holds");
    if (!places.empty()) channel(i, "translation", places, 3);
    channel(i, "rotation", turns, 4);
  }
  return base;
}

}  // namespace detail

/// The scene as a binary glTF 2.0 file (Khronos, ISO/IEC 12113:2022): a node for every joint under one node that turns
/// our axes (z up, x forward) into glTF's (y up, z forward), a mesh for every body and for the terrain, and one
/// animation of all motions, linear between keys. Lengths are metres, times seconds, numbers floats. Throws Error that
/// names the actor and what does not fit.
inline std::string format_gltf(const GltfScene& scene) {
  using Json = detail::GltfDocument::Json;
  if (!(scene.border >= 0 && scene.border <= 1e6)) throw Error("glTF: border: expected metres, 0 to 1e6");
  detail::GltfDocument document;
  // x y z to y z x is a third of a turn about the diagonal.
  document.push("nodes", {{"name", "world"}, {"rotation", {-0.5, -0.5, -0.5, 0.5}}});
  Json animation = {{"name", scene.title.empty() ? "motion" : scene.title}};
  Json children = Json::array();
  if (scene.terrain) {
    const int material = detail::add_gltf_material(document, "terrain", {0.35, 0.35, 0.33});
    const int mesh = detail::terrain_mesh(*scene.terrain, scene.border).store(document, "terrain", material);
    children.push_back(document.push("nodes", {{"name", "terrain"}, {"mesh", mesh}}));
  }
  for (const GltfActor& actor : scene.actors) children.push_back(detail::add_gltf_actor(document, actor, animation));
  if (!children.empty()) document.json["nodes"][0]["children"] = std::move(children);
  if (animation.contains("channels")) document.push("animations", std::move(animation));
  document.push("scenes", {{"name", scene.title}, {"nodes", {0}}});
  document.json["scene"] = 0;
  return document.finish();
}

/// Writes a .glb file whole or not at all; see format_gltf.
inline void write_gltf(const std::filesystem::path& path, const GltfScene& scene) {
  write_atomically(path, format_gltf(scene));
}

/// A scene of one clip, drawn by its bones.
inline GltfScene gltf_scene(const motion::Clip& clip) {
  GltfScene scene;
  scene.title = clip.name;
  body::Character bones;
  bones.name = clip.name;
  bones.skeleton = clip.skeleton;
  scene.actors.push_back({clip.name, std::move(bones), clip});
  return scene;
}

}  // namespace traceur::io
