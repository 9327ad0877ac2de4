// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <string_view>
#include <vector>

#include <nlohmann/json.hpp>

#include "traceur/core/rotation.hpp"
#include "traceur/io/detail/text.hpp"

namespace traceur::io::detail {

using Json = nlohmann::json;

/// The text as JSON. Throws Error that names the line (`first_line` is the number of the text's first).
inline Json parse_json(std::string_view text, std::string_view where, int first_line = 1) {
  const auto line_of = [&](std::size_t at) {
    return first_line + static_cast<int>(std::count(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(at), '\n'));
  };
  // To the parser a null byte is the end of the text, whatever comes after it.
  if (const std::size_t null = text.find('\0'); null != std::string_view::npos)
    fail(where, line_of(null), "not JSON: did not expect a null byte");
  try {
    return Json::parse(text.begin(), text.end());
  } catch (const Json::parse_error& e) {
    const std::size_t at = std::min(e.byte == 0 ? 0 : e.byte - 1, text.size());
    if (at >= text.size())
      fail(where, line_of(at), "not JSON: expected more, found the end of the text; is the file truncated?");
    fail(where, line_of(at), "not JSON: did not expect " + shown(text.substr(at, 20)));
  } catch (const Json::exception&) {
    throw Error(std::string(where) + ": not JSON: a number is too large");
  }
}

/// Member of an object. Throws Error when it is missing.
inline const Json& member(const Json& object, const char* key, const std::string& where) {
  if (!object.is_object()) throw Error(where + ": expected an object with a field '" + key + "'");
  const auto found = object.find(key);
  if (found == object.end()) throw Error(where + ": expected a field '" + key + "'");
  return *found;
}

inline double to_number(const Json& value, const std::string& where) {
  if (!value.is_number()) throw Error(where + ": expected a number");
  const double number = value.get<double>();
  if (!(std::abs(number) <= largest_number)) throw Error(where + ": expected a finite number below 1e8");
  return number;
}

inline const Json::array_t& to_array(const Json& value, const std::string& where) {
  if (!value.is_array()) throw Error(where + ": expected a list");
  return value.get_ref<const Json::array_t&>();
}

inline const Json::array_t& to_array(const Json& value, std::size_t size, const std::string& where) {
  const Json::array_t& array = to_array(value, where);
  if (array.size() != size)
    throw Error(where + ": expected a list of " + std::to_string(size) + ", found " + std::to_string(array.size()));
  return array;
}

inline const std::string& to_text(const Json& value, const std::string& where) {
  if (!value.is_string()) throw Error(where + ": expected a text");
  return value.get_ref<const std::string&>();
}

inline core::Vector3<double> to_vector(const Json& value, const std::string& where) {
  const Json::array_t& a = to_array(value, 3, where);
  return {to_number(a[0], where), to_number(a[1], where), to_number(a[2], where)};
}

/// Scaled to unit length when it is that up to the digits a file rounds to; Error otherwise.
inline core::Quaternion<double> checked_unit(const core::Quaternion<double>& q, const std::string& where) {
  if (!(std::abs(dot(q, q) - 1) < 0.02)) throw Error(where + ": expected a unit quaternion");
  return q.normalized();
}

/// A unit quaternion given as x y z w.
inline core::Quaternion<double> to_quaternion(const Json& value, const std::string& where) {
  const Json::array_t& a = to_array(value, 4, where);
  return checked_unit({to_number(a[0], where), to_number(a[1], where), to_number(a[2], where), to_number(a[3], where)},
                      where);
}

}  // namespace traceur::io::detail
