// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <locale>
#include <sstream>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <pugixml.hpp>

#include "traceur/core/error.hpp"
#include "traceur/core/vector3.hpp"

namespace traceur::io::detail {

/// An element of an MJCF file and the default class that fills in what it leaves out.
struct MjcfElement {
  pugi::xml_node node;
  int defaults = 0;
};

/// The XML of an MJCF file with its default classes. Every complaint is one line: file, line, element, what was
/// expected.
class MjcfDocument {
public:
  static constexpr std::size_t max_bytes = std::size_t{16} << 20;
  static constexpr int max_depth = 64;
  static constexpr std::size_t max_classes = 1024;
  /// Numbers beyond this are refused, as MuJoCo refuses them, so that no product of a few of them overflows.
  static constexpr double max_value = 1e10;

  MjcfDocument(std::string_view text, std::string name) : name_(std::move(name)), text_(text) {
    if (text.size() > max_bytes)
      throw Error(name_ + ": expected at most 16 MiB, found " + std::to_string(text.size()) + " bytes");
    const pugi::xml_parse_result result =
        document_.load_buffer(text.data(), text.size(), pugi::parse_default, pugi::encoding_utf8);
    if (!result)
      throw Error(name_ + ": line " + std::to_string(line_at(result.offset)) + ": not XML: " + result.description());
    root_ = document_.document_element();
    if (std::string_view(root_.name()) != "mujoco")
      throw Error(name_ + ": expected <mujoco>, found <" + printable(root_.name()) + ">");
    classes_.push_back({"main", -1, {}});
    for (const pugi::xml_node section : root_.children("default")) {
      // The outermost class may be renamed; it stays the one that everything inherits.
      if (section.attribute("class")) classes_[0].name = section.attribute("class").value();
      read_defaults(section, 0, 0);
    }
  }

  MjcfDocument(const MjcfDocument&) = delete;
  MjcfDocument& operator=(const MjcfDocument&) = delete;

  pugi::xml_node root() const { return root_; }
  const std::string& name() const { return name_; }

  [[noreturn]] void fail(pugi::xml_node node, const std::string& complaint) const {
    std::string element = node.name();
    const std::string_view own = node.attribute("name").value();
    if (!own.empty()) element += " '" + printable(own) + "'";
    throw Error(name_ + ": line " + std::to_string(line_at(node.offset_debug())) + ": " + element + ": " + complaint);
  }

  /// The class an element names, or else `inherited`.
  int class_of(pugi::xml_node node, int inherited, const char* attribute = "class") const {
    const pugi::xml_attribute named = node.attribute(attribute);
    if (!named) return inherited;
    for (std::size_t i = 0; i < classes_.size(); ++i)
      if (classes_[i].name == named.value()) return static_cast<int>(i);
    fail(node, "no default class '" + printable(named.value()) + "'");
  }

  /// The attribute of the element itself or of its class or of that class's parents; null where none has it.
  const char* value(const MjcfElement& e, const char* attribute) const {
    if (const pugi::xml_attribute own = e.node.attribute(attribute)) return own.value();
    const std::string_view kind = kind_of(e.node.name());
    if (kind.empty()) return nullptr;
    for (int c = e.defaults; c >= 0; c = classes_[static_cast<std::size_t>(c)].parent) {
      const std::vector<pugi::xml_node>& nodes = classes_[static_cast<std::size_t>(c)].elements;
      for (auto n = nodes.rbegin(); n != nodes.rend(); ++n)
        if (kind_of(n->name()) == kind)
          if (const pugi::xml_attribute found = n->attribute(attribute)) return found.value();
    }
    return nullptr;
  }

  std::string_view word(const MjcfElement& e, const char* attribute, std::string_view fallback) const {
    const char* text = value(e, attribute);
    return text ? std::string_view(text) : fallback;
  }

  bool flag(const MjcfElement& e, const char* attribute, bool fallback) const {
    const std::string_view text = word(e, attribute, fallback ? "true" : "false");
    if (text != "true" && text != "false")
      fail(e.node, std::string(attribute) + ": expected true or false, found '" + printable(text) + "'");
    return text == "true";
  }

  /// Reads between `least` and `most` numbers into `out`. Returns how many, 0 where the attribute is absent.
  int numbers(const MjcfElement& e, const char* attribute, double* out, int least, int most) const {
    const char* text = value(e, attribute);
    if (!text) return 0;
    std::istringstream in{std::string(text)};
    in.imbue(std::locale::classic());
    int count = 0;
    const std::string expected =
        std::string(attribute) + ": expected " +
        (least == most ? std::to_string(most) : std::to_string(least) + " to " + std::to_string(most)) +
        (most == 1 ? " number" : " numbers");
    while (!(in >> std::ws).eof()) {
      double x = 0;
      if (!(in >> x) || count == most) fail(e.node, expected + ", found '" + printable(text) + "'");
      if (!(std::abs(x) <= max_value)) fail(e.node, std::string(attribute) + ": a number beyond 1e10");
      out[count++] = x;
    }
    if (count < least) fail(e.node, expected + ", found '" + printable(text) + "'");
    return count;
  }

  double number(const MjcfElement& e, const char* attribute, double fallback) const {
    numbers(e, attribute, &fallback, 1, 1);
    return fallback;
  }

  core::Vector3<double> vector(const MjcfElement& e, const char* attribute,
                               const core::Vector3<double>& fallback) const {
    double v[3] = {fallback.x, fallback.y, fallback.z};
    numbers(e, attribute, v, 3, 3);
    return core::Vector3<double>::from(v);
  }

  /// The element's name, empty if it has none. Names go into messages and files of one line each.
  std::string name_of(pugi::xml_node node) const {
    const std::string name = node.attribute("name").value();
    if (name.size() > 256) fail(node, "a name of more than 256 bytes");
    if (printable(name) != name) fail(node, "a name with control characters");
    return name;
  }

  /// At most 256 bytes of a text, control characters replaced.
  static std::string printable(std::string_view text) {
    std::string out(text.substr(0, 256));
    for (char& c : out)
      if (static_cast<unsigned char>(c) < 32 || c == 127) c = '?';
    return out;
  }

private:
  struct Class {
    std::string name;
    int parent;
    std::vector<pugi::xml_node> elements;
  };

  /// Elements of one kind share their defaults: the actuators are shorthands of one another.
  static std::string_view kind_of(std::string_view tag) {
    if (tag == "geom" || tag == "joint") return tag;
    if (tag == "motor" || tag == "general" || tag == "position" || tag == "velocity" || tag == "intvelocity" ||
        tag == "damper" || tag == "cylinder" || tag == "muscle" || tag == "adhesion")
      return "actuator";
    return {};
  }

  void read_defaults(pugi::xml_node section, int index, int depth) {
    if (depth > max_depth) fail(section, "nested more than " + std::to_string(max_depth) + " deep");
    for (const pugi::xml_node child : section.children()) {
      if (std::string_view(child.name()) != "default") {
        classes_[static_cast<std::size_t>(index)].elements.push_back(child);
        continue;
      }
      const std::string name = child.attribute("class").value();
      if (name.empty()) fail(child, "expected class");
      for (const Class& c : classes_)
        if (c.name == name) fail(child, "a second class '" + printable(name) + "'");
      if (classes_.size() == max_classes) fail(child, "more than " + std::to_string(max_classes) + " classes");
      classes_.push_back({name, index, {}});
      read_defaults(child, static_cast<int>(classes_.size()) - 1, depth + 1);
    }
  }

  std::size_t line_at(std::ptrdiff_t offset) const {
    const auto end = std::min(text_.size(), static_cast<std::size_t>(std::max<std::ptrdiff_t>(offset, 0)));
    return 1 +
           static_cast<std::size_t>(std::count(text_.begin(), text_.begin() + static_cast<std::ptrdiff_t>(end), '\n'));
  }

  std::string name_;
  std::string_view text_;
  pugi::xml_document document_;
  pugi::xml_node root_;
  std::vector<Class> classes_;
};

}  // namespace traceur::io::detail
