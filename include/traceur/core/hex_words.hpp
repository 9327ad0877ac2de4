// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <iomanip>
#include <istream>
#include <ostream>
#include <string>
#include <string_view>
#include <utility>

#include <traceur/core/error.hpp>

namespace traceur::core {

/// Writes names and 64-bit words as text, each word as its 16 hexadecimal digits: exact for every number, and the same
/// on every machine and in every locale.
class HexWordWriter {
public:
  explicit HexWordWriter(std::ostream& out) : out_(out) {}

  /// A name without blanks, at the start of a line.
  void name(std::string_view text) { out_.write(text.data(), static_cast<std::streamsize>(text.size())); }
  void word(std::uint64_t bits) {
    char text[17] = {' '};
    for (int i = 16; i > 0; --i, bits >>= 4) text[i] = "0123456789abcdef"[bits & 15u];
    out_.write(text, sizeof text);
  }
  void end_line() { out_.put('\n'); }

private:
  std::ostream& out_;
};

/// Reads what HexWordWriter wrote. Every fault throws Error, one line that begins with `where` and names the field.
class HexWordReader {
public:
  HexWordReader(std::istream& in, std::string where) : in_(in), where_(std::move(where)) {}

  /// The word that must come next.
  void expect(std::string_view text) {
    const std::string found = token(text);
    if (found != text) throw Error(where_ + ": expected '" + std::string(text) + "', got '" + printable(found) + "'");
  }
  std::uint64_t word(std::string_view field) {
    const std::string text = token(field);
    std::uint64_t bits = 0;
    bool good = text.size() == 16;
    for (const char c : text) {
      const bool digit = c >= '0' && c <= '9';
      good = good && (digit || (c >= 'a' && c <= 'f'));
      bits = bits << 4 | static_cast<std::uint64_t>(digit ? c - '0' : c - 'a' + 10);
    }
    if (!good) fail(field, "expected 16 hexadecimal digits, got '" + printable(text) + "'");
    return bits;
  }
  [[noreturn]] void fail(std::string_view field, const std::string& what) const {
    throw Error(where_ + ": field '" + std::string(field) + "': " + what);
  }

private:
  // Blanks end a token, and so does a length that no name or word has.
  std::string token(std::string_view field) {
    std::string text;
    if (!(in_ >> std::setw(64) >> text)) throw Error(where_ + ": the stream ends at '" + std::string(field) + "'");
    return text;
  }
  static std::string printable(std::string text) {
    for (char& c : text)
      if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = '?';
    return text;
  }

  std::istream& in_;
  std::string where_;
};

}  // namespace traceur::core
