// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <map>
#include <set>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include <doctest/doctest.h>
#include <nlohmann/json.hpp>

#include <traceur/core/rotation.hpp>

/// A reader of binary glTF written from the specification, for tests: it knows nothing of how files are written here.
namespace glb {

using Json = nlohmann::json;
using Vector = traceur::core::Vector3<double>;
using Rotation = traceur::core::Quaternion<double>;

struct Triangle {
  Vector a, b, c, normal;  // normal: of the first corner, as stored
};

struct Solid {
  bool closed = true;
  double volume = 0;
  Vector center{0, 0, 0};
};

struct Place {
  Vector position{0, 0, 0};
  Rotation rotation = Rotation::identity();
  Vector apply(const Vector& p) const { return position + rotation.rotate(p); }
};

inline std::uint32_t word(const std::string& bytes, std::size_t at) {
  std::uint32_t w = 0;
  for (std::size_t k = 0; k < 4; ++k)
    w |= static_cast<std::uint32_t>(static_cast<unsigned char>(bytes[at + k])) << (8 * k);
  return w;
}

inline std::string bytes_of(std::size_t value) {
  std::string out;
  for (std::size_t k = 0; k < 4; ++k) out.push_back(static_cast<char>(value >> (8 * k) & 255U));
  return out;
}

/// The same file with one value of its JSON changed.
inline std::string changed(const std::string& glb, const std::string& pointer, const Json& value) {
  const std::size_t length = word(glb, 12);
  Json json = Json::parse(glb.substr(20, length));
  json[Json::json_pointer(pointer)] = value;
  std::string text = json.dump();
  text.resize((text.size() + 3) / 4 * 4, ' ');
  const std::string rest = glb.substr(20 + length);
  return glb.substr(0, 8) + bytes_of(20 + text.size() + rest.size()) + bytes_of(text.size()) + glb.substr(16, 4) +
         text + rest;
}

/// What the file breaks of the rules it must keep (glTF 2.0, sections 3 to 5), the first found; empty when all is well.
inline std::string faults(const std::string& file) {
  if (file.size() < 20 || file.substr(0, 4) != "glTF") return "magic";
  if (word(file, 4) != 2) return "version";
  if (word(file, 8) != file.size() || file.size() % 4 != 0) return "length";
  const std::size_t text_size = word(file, 12);
  if (file.substr(16, 4) != "JSON" || text_size % 4 != 0 || 20 + text_size > file.size()) return "JSON chunk";
  const Json json = Json::parse(file.substr(20, text_size), nullptr, false);
  if (json.is_discarded()) return "JSON";
  std::string binary;
  if (20 + text_size < file.size()) {
    const std::size_t at = 20 + text_size;
    if (file.substr(at + 4, 4) != std::string("BIN\0", 4) || at + 8 + word(file, at) != file.size())
      return "binary chunk";
    binary = file.substr(at + 8);
  }
  if (json.at("asset").at("version") != "2.0") return "asset";
  const auto list = [&](const char* name) { return json.value(name, Json::array()); };
  for (const char* name :
       {"buffers", "bufferViews", "accessors", "meshes", "materials", "nodes", "animations", "scenes"})
    if (json.contains(name) && json[name].empty()) return std::string(name) + ": empty lists are not allowed";

  const Json buffers = list("buffers"), views = list("bufferViews"), accessors = list("accessors"),
             nodes = list("nodes");
  if (buffers.size() != (binary.empty() ? 0 : 1)) return "buffers";
  if (!binary.empty()) {
    const std::size_t size = buffers[0].at("byteLength");
    if (buffers[0].contains("uri") || size > binary.size() || binary.size() - size > 3) return "buffer";
  }
  for (std::size_t v = 0; v < views.size(); ++v) {
    const std::string name = "view " + std::to_string(v);
    const std::size_t offset = views[v].value("byteOffset", 0U), length = views[v].at("byteLength");
    if (views[v].at("buffer") != 0 || length < 1) return name;
    if (offset % 4 != 0) return name + ": alignment";
    if (offset + length > binary.size()) return name + ": beyond the buffer";
  }
  const std::map<std::string, std::size_t> rows{{"SCALAR", 1}, {"VEC2", 2}, {"VEC3", 3}, {"VEC4", 4}};
  for (std::size_t a = 0; a < accessors.size(); ++a) {
    const std::string name = "accessor " + std::to_string(a);
    const Json& accessor = accessors[a];
    const Json& view = views.at(accessor.at("bufferView").get<std::size_t>());
    const int type = accessor.at("componentType");
    if (type != 5126 && type != 5125) return name + ": type";
    const std::size_t count = accessor.at("count"), n = rows.at(accessor.at("type"));
    if (count < 1 || 4 * n * count > view.at("byteLength").get<std::size_t>()) return name + ": beyond its view";
    if (type != 5126) continue;
    std::vector<float> low(n, HUGE_VALF), high(n, -HUGE_VALF);
    for (std::size_t i = 0; i < n * count; ++i) {
      const std::uint32_t bits = word(binary, view.value("byteOffset", std::size_t{0}) + 4 * i);
      float value = 0;
      std::memcpy(&value, &bits, 4);
      if (!std::isfinite(value)) return name + ": not finite";
      low[i % n] = std::min(low[i % n], value);
      high[i % n] = std::max(high[i % n], value);
    }
    if (accessor.contains("min") != accessor.contains("max")) return name + ": bounds";
    if (accessor.contains("min") &&
        (accessor["min"].get<std::vector<float>>() != low || accessor["max"].get<std::vector<float>>() != high))
      return name + ": bounds";
  }
  const auto is = [&](std::size_t a, int type, const char* shape) {
    return accessors.at(a).at("componentType") == type && accessors.at(a).at("type") == shape;
  };
  const auto target = [&](std::size_t a) {
    return views.at(accessors.at(a).at("bufferView").get<std::size_t>()).value("target", 0);
  };
  std::size_t m = 0;
  for (const Json& mesh : list("meshes")) {
    const std::string name = "mesh " + std::to_string(m++);
    if (mesh.at("primitives").empty()) return name + ": no primitives";
    for (const Json& p : mesh.at("primitives")) {
      const std::size_t position = p.at("attributes").at("POSITION"), normal = p.at("attributes").at("NORMAL"),
                        index = p.at("indices");
      if (!is(position, 5126, "VEC3") || !accessors[position].contains("min") || target(position) != 34962)
        return name + ": positions";
      if (!is(normal, 5126, "VEC3") || target(normal) != 34962) return name + ": normals";
      if (!is(index, 5125, "SCALAR") || target(index) != 34963) return name + ": indices";
      if (accessors[position]["count"] != accessors[normal]["count"]) return name + ": counts";
      if (accessors[index]["count"].get<std::size_t>() % 3 != 0) return name + ": triangles";
      if (p.at("material").get<std::size_t>() >= list("materials").size()) return name + ": material";
    }
  }
  std::vector<int> parents(nodes.size(), 0);
  for (std::size_t n = 0; n < nodes.size(); ++n) {
    const std::string name = "node " + std::to_string(n);
    std::set<std::size_t> children;
    if (nodes[n].contains("children") && nodes[n]["children"].empty()) return name + ": no children";
    for (const std::size_t c : nodes[n].value("children", std::vector<std::size_t>())) {
      if (c >= nodes.size() || !children.insert(c).second) return name + ": child";
      ++parents[c];
    }
    if (nodes[n].contains("mesh") && nodes[n]["mesh"].get<std::size_t>() >= list("meshes").size())
      return name + ": mesh";
    if (nodes[n].contains("rotation")) {
      double square = 0;
      for (const double e : nodes[n]["rotation"].get<std::vector<double>>()) square += e * e;
      if (nodes[n]["rotation"].size() != 4 || std::abs(square - 1) > 1e-5) return name + ": rotation";
    }
    if (nodes[n].contains("translation") && nodes[n]["translation"].size() != 3) return name + ": translation";
  }
  for (const Json& scene : list("scenes"))
    for (const std::size_t n : scene.value("nodes", std::vector<std::size_t>()))
      if (n >= nodes.size() || parents[n] != 0) return "node " + std::to_string(n) + ": a scene's root with a parent";
  // With one parent at most for each, walking down from those without meets every node once unless there is a loop.
  std::vector<std::size_t> open;
  for (std::size_t n = 0; n < nodes.size(); ++n) {
    if (parents[n] > 1) return "node " + std::to_string(n) + ": two parents";
    if (parents[n] == 0) open.push_back(n);
  }
  std::size_t met = 0;
  for (; !open.empty(); ++met) {
    const Json node = nodes[open.back()];
    open.pop_back();
    for (const std::size_t c : node.value("children", std::vector<std::size_t>())) open.push_back(c);
  }
  if (met != nodes.size()) return "nodes: a loop";
  if (json.contains("scene") && json["scene"].get<std::size_t>() >= list("scenes").size()) return "scene";

  std::size_t count = 0;
  for (const Json& animation : list("animations")) {
    const std::string name = "animation " + std::to_string(count++);
    std::set<std::pair<std::size_t, std::string>> targets;
    if (animation.at("channels").empty()) return name + ": no channels";
    for (const Json& channel : animation.at("channels")) {
      const std::string path = channel.at("target").at("path");
      const std::size_t node = channel.at("target").at("node");
      if (path != "translation" && path != "rotation") return name + ": path";
      if (node >= nodes.size() || nodes[node].contains("matrix")) return name + ": node";
      if (!targets.insert({node, path}).second) return name + ": target twice";
      const Json& sampler = animation.at("samplers").at(channel.at("sampler").get<std::size_t>());
      const std::size_t input = sampler.at("input"), output = sampler.at("output");
      if (!is(input, 5126, "SCALAR") || !accessors[input].contains("min") || accessors[input]["min"][0] < 0)
        return name + ": times";
      if (!is(output, 5126, path == "rotation" ? "VEC4" : "VEC3")) return name + ": values";
      if (sampler.value("interpolation", "LINEAR") != "LINEAR" ||
          accessors[input]["count"] != accessors[output]["count"])
        return name + ": keys";
    }
  }
  return "";
}

/// A file that keeps the rules, taken apart.
class File {
public:
  explicit File(const std::string& bytes) {
    REQUIRE(faults(bytes) == "");
    const std::size_t length = word(bytes, 12);
    json = Json::parse(bytes.substr(20, length));
    if (bytes.size() > 20 + length) binary_ = bytes.substr(28 + length);
  }

  Json json;

  /// The floats of an accessor, in order.
  std::vector<double> numbers(std::size_t accessor) const {
    std::vector<double> out;
    for (const std::uint32_t bits : words(accessor)) {
      float value = 0;
      std::memcpy(&value, &bits, 4);
      out.push_back(double{value});
    }
    return out;
  }

  std::size_t find_node(const std::string& name) const {
    for (std::size_t n = 0; n < json["nodes"].size(); ++n)
      if (json["nodes"][n].value("name", "") == name) return n;
    FAIL("no node " << name);
    return 0;
  }

  /// Every node's place in the scene with the first animation, if there is one, at its key k.
  std::vector<Place> animated(std::size_t k) const {
    Json nodes = json["nodes"];
    if (json.contains("animations"))
      for (const Json& channel : json["animations"][0]["channels"]) {
        const Json& sampler = json["animations"][0]["samplers"][channel["sampler"].get<std::size_t>()];
        const std::vector<double> values = numbers(sampler["output"]);
        const std::size_t n = channel["target"]["path"] == "rotation" ? 4 : 3;
        Json& value = nodes[channel["target"]["node"].get<std::size_t>()][channel["target"]["path"].get<std::string>()];
        for (std::size_t i = 0; i < n; ++i) value[i] = values[n * k + i];
      }
    std::vector<Place> out(nodes.size());
    std::vector<std::pair<std::size_t, Place>> open;
    for (const std::size_t n : json["scenes"][0]["nodes"]) open.push_back({n, Place()});
    while (!open.empty()) {
      const auto [n, above] = open.back();
      open.pop_back();
      const auto t = nodes[n].value("translation", std::vector<double>{0, 0, 0});
      const auto r = nodes[n].value("rotation", std::vector<double>{0, 0, 0, 1});
      out[n] = {above.apply({t[0], t[1], t[2]}), above.rotation * Rotation{r[0], r[1], r[2], r[3]}};
      for (const std::size_t c : nodes[n].value("children", std::vector<std::size_t>())) open.push_back({c, out[n]});
    }
    return out;
  }

  std::vector<Vector> corners(std::size_t mesh, const char* attribute = "POSITION") const {
    const auto values = numbers(json["meshes"][mesh]["primitives"][0]["attributes"][attribute]);
    std::vector<Vector> out;
    for (std::size_t i = 0; i < values.size(); i += 3) out.push_back({values[i], values[i + 1], values[i + 2]});
    return out;
  }

  std::vector<Triangle> triangles(std::size_t mesh) const {
    const std::vector<Vector> p = corners(mesh), n = corners(mesh, "NORMAL");
    const auto index = words(json["meshes"][mesh]["primitives"][0]["indices"]);
    std::vector<Triangle> out;
    for (std::size_t i = 0; i < index.size(); i += 3) {
      for (std::size_t k = 0; k < 3; ++k) REQUIRE(index[i + k] < p.size());
      out.push_back({p[index[i]], p[index[i + 1]], p[index[i + 2]], n[index[i]]});
      const Vector area = cross(out.back().b - out.back().a, out.back().c - out.back().a);
      CHECK(norm(area) > 0);
      CHECK(dot(area, out.back().normal) > 0);
      CHECK(std::abs(norm(out.back().normal) - 1) < 1e-5);
    }
    return out;
  }

  /// Volume and centre by the divergence theorem; closed when every edge is met once in either direction.
  Solid solid(std::size_t mesh) const {
    Solid out;
    std::map<std::pair<std::array<double, 3>, std::array<double, 3>>, int> edges;
    const auto key = [](const Vector& v) {
      const auto snap = [](double e) { return std::round(e * 1e6) + 0.0; };
      return std::array<double, 3>{snap(v.x), snap(v.y), snap(v.z)};
    };
    for (const Triangle& t : triangles(mesh)) {
      const double v = dot(t.a, cross(t.b, t.c)) / 6;
      out.volume += v;
      out.center = out.center + (v / 4) * (t.a + t.b + t.c);
      const std::array<const Vector*, 4> corner{&t.a, &t.b, &t.c, &t.a};
      for (std::size_t e = 0; e < 3; ++e) {
        const auto a = key(*corner[e]), b = key(*corner[e + 1]);
        if (a != b) edges[a < b ? std::pair(a, b) : std::pair(b, a)] += a < b ? 1 : -1;
      }
    }
    out.center = (1 / out.volume) * out.center;
    for (const auto& [edge, balance] : edges) out.closed = out.closed && balance == 0;
    return out;
  }

  /// Heights of the upward triangles over (x, y).
  std::vector<double> heights_above(std::size_t mesh, double x, double y) const {
    std::vector<double> out;
    for (const Triangle& t : triangles(mesh)) {
      const Vector n = cross(t.b - t.a, t.c - t.a);
      if (!(n.z > 1e-9)) continue;
      const auto side = [&](const Vector& a, const Vector& b) {
        return (b.x - a.x) * (y - a.y) - (b.y - a.y) * (x - a.x);
      };
      if (side(t.a, t.b) < 0 || side(t.b, t.c) < 0 || side(t.c, t.a) < 0) continue;
      out.push_back(t.a.z - (n.x * (x - t.a.x) + n.y * (y - t.a.y)) / n.z);
    }
    return out;
  }

private:
  std::vector<std::uint32_t> words(std::size_t accessor) const {
    const Json& a = json["accessors"][accessor];
    const Json& view = json["bufferViews"][a["bufferView"].get<std::size_t>()];
    const std::map<std::string, std::size_t> rows{{"SCALAR", 1}, {"VEC2", 2}, {"VEC3", 3}, {"VEC4", 4}};
    std::vector<std::uint32_t> out;
    const std::size_t begin = view.value("byteOffset", std::size_t{0}) + a.value("byteOffset", std::size_t{0});
    for (std::size_t i = 0; i < a["count"].get<std::size_t>() * rows.at(a["type"]); ++i)
      out.push_back(word(binary_, begin + 4 * i));
    return out;
  }

  std::string binary_;
};

inline void check(const std::string& bytes) { CHECK(faults(bytes) == ""); }

}  // namespace glb
