// SPDX-License-Identifier: MIT
#pragma once

#include <charconv>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>
#include <system_error>
#include <version>

#include "traceur/core/error.hpp"

namespace traceur::io::detail {

/// Larger files are refused: no clip is that long, and a wrong path (a device, a disk image) must not fill the memory.
inline constexpr std::size_t largest_file = std::size_t{512} << 20;
inline constexpr int most_joints = 2000;
inline constexpr int deepest_joint = 200;
/// Larger numbers are garbage in any motion file and would overflow when multiplied.
inline constexpr double largest_number = 1e8;

[[noreturn]] inline void fail(std::string_view where, int line, const std::string& message) {
  throw Error(std::string(where) + ":" + std::to_string(line) + ": " + message);
}

/// A piece of a file fit for a one-line message: quoted, shortened, unprintable bytes replaced.
inline std::string shown(std::string_view token) {
  std::string out = "'";
  for (const char c : token.substr(0, 40)) out += (c < ' ' || c == '\x7f') ? '?' : c;
  return out + (token.size() > 40 ? "...'" : "'");
}

/// The bytes of a file, less a byte order mark. Throws Error when it cannot be read or is unreasonably large.
inline std::string read_text(const std::filesystem::path& path) {
  std::error_code failure;
  const auto status = std::filesystem::status(path, failure);
  if (!std::filesystem::exists(status)) throw Error(path.string() + ": no such file");
  if (std::filesystem::is_directory(status)) throw Error(path.string() + ": expected a file, found a folder");
  std::ifstream file(path, std::ios::binary);
  if (!file) throw Error(path.string() + ": cannot be opened");
  std::string text;
  // By pieces, not by the size asked beforehand: a pipe has none.
  char piece[1 << 16];
  while (file.read(piece, sizeof piece) || file.gcount() > 0) {
    text.append(piece, static_cast<std::size_t>(file.gcount()));
    if (text.size() > largest_file) throw Error(path.string() + ": larger than 512 MiB; expected a motion file");
  }
  if (file.bad()) throw Error(path.string() + ": reading failed");
  if (text.starts_with("\xEF\xBB\xBF")) text.erase(0, 3);
  return text;
}

inline bool is_space(char c) { return c == ' ' || (c >= '\t' && c <= '\r'); }

inline std::string_view trimmed(std::string_view s) {
  while (!s.empty() && is_space(s.front())) s.remove_prefix(1);
  while (!s.empty() && is_space(s.back())) s.remove_suffix(1);
  return s;
}

inline char lower(char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; }
inline std::string lowered(std::string_view s) {
  std::string out(s);
  for (char& c : out) c = lower(c);
  return out;
}

/// Walks over the lines of a text, counting from one.
class Lines {
public:
  explicit Lines(std::string_view text) : rest_(text) {}
  /// The next line without its end and outer blanks; false at the end of the text.
  bool next(std::string_view& line) {
    if (rest_.empty()) return false;
    const std::size_t end = rest_.find('\n');
    line = trimmed(rest_.substr(0, end));
    rest_ = end == std::string_view::npos ? std::string_view() : rest_.substr(end + 1);
    ++number_;
    return true;
  }
  /// The next line that is not blank.
  bool next_filled(std::string_view& line) {
    while (next(line))
      if (!line.empty()) return true;
    return false;
  }
  int number() const { return number_; }
  std::string_view rest() const { return rest_; }

private:
  std::string_view rest_;
  int number_ = 0;
};

/// Cuts the next word off a line; empty when there is none.
inline std::string_view next_word(std::string_view& line) {
  std::size_t begin = 0;
  while (begin < line.size() && is_space(line[begin])) ++begin;
  std::size_t end = begin;
  while (end < line.size() && !is_space(line[end])) ++end;
  const std::string_view word = line.substr(begin, end - begin);
  line.remove_prefix(end);
  return word;
}

/// The word as a number, the same in every locale. False when it is not wholly a number.
inline bool to_double(std::string_view word, double& value) {
  if (word.size() > 1 && word.front() == '+' && word[1] != '-' && word[1] != '+') word.remove_prefix(1);
#if defined(__cpp_lib_to_chars)
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (error == std::errc::result_out_of_range && end == word.data() + word.size()) {
    // Too small or too large for a double; the sign of the exponent tells which.
    const std::size_t e = word.find_first_of("eE");
    value = e != std::string_view::npos && e + 1 < word.size() && word[e + 1] == '-' ? 0.0 : HUGE_VAL;
    return true;
  }
  return error == std::errc() && end == word.data() + word.size();
#else
  // Standard libraries without floating from_chars run where the locale is always "C".
  if (word.empty() || is_space(word.front())) return false;
  const std::string copy(word);
  char* end = nullptr;
  value = std::strtod(copy.c_str(), &end);
  return end == copy.c_str() + copy.size();
#endif
}

inline bool to_integer(std::string_view word, long long& value) {
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  return error == std::errc() && end == word.data() + word.size();
}

/// The next word of a line as a finite number; `field` names it in the message.
inline double next_number(std::string_view& line, std::string_view where, int number, const std::string& field) {
  const std::string_view word = next_word(line);
  if (word.empty()) fail(where, number, field + ": expected a number, found the end of the line");
  double value = 0;
  if (!to_double(word, value)) fail(where, number, field + ": expected a number, found " + shown(word));
  if (!(std::abs(value) <= largest_number))
    fail(where, number, field + ": expected a finite number below 1e8, found " + shown(word));
  return value;
}

inline void expect_end(std::string_view line, std::string_view where, int number, const std::string& field) {
  const std::string_view word = next_word(line);
  if (!word.empty()) fail(where, number, field + ": expected the end of the line, found " + shown(word));
}

/// Four digits, for messages.
inline std::string short_number(double v) {
  char buffer[32];
  std::snprintf(buffer, sizeof buffer, "%.4g", v);
  return buffer;
}

/// Appends a number so that reading it back gives the same bits (`digits` 0) or with that many significant digits.
inline void append_number(std::string& out, double value, int digits = 0) {
  char buffer[40];
#if defined(__cpp_lib_to_chars)
  const auto result = digits == 0
                          ? std::to_chars(buffer, buffer + sizeof buffer, value)
                          : std::to_chars(buffer, buffer + sizeof buffer, value, std::chars_format::general, digits);
  out.append(buffer, result.ptr);
#else
  out.append(buffer,
             static_cast<std::size_t>(std::snprintf(buffer, sizeof buffer, "%.*g", digits == 0 ? 17 : digits, value)));
#endif
}

}  // namespace traceur::io::detail
