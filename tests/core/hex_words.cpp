// SPDX-License-Identifier: MIT
#include <traceur/core/hex_words.hpp>

#include <bit>
#include <cstdint>
#include <limits>
#include <sstream>
#include <string>
#include <vector>

#include <doctest/doctest.h>

using traceur::core::HexWordReader;
using traceur::core::HexWordWriter;

namespace {

template <class F>
std::string error_of(const std::string& text, F read) {
  std::istringstream in(text);
  HexWordReader reader(in, "state");
  try {
    read(reader);
  } catch (const traceur::Error& e) {
    return e.what();
  }
  return {};
}

}  // namespace

TEST_CASE("words come back to the bit, whatever they stand for") {
  const std::vector<std::uint64_t> words{0,
                                         1,
                                         std::numeric_limits<std::uint64_t>::max(),
                                         std::bit_cast<std::uint64_t>(-0.0),
                                         std::bit_cast<std::uint64_t>(std::numeric_limits<double>::quiet_NaN()),
                                         std::bit_cast<std::uint64_t>(0.1),
                                         static_cast<std::uint64_t>(std::int64_t{-5})};
  std::stringstream stream;
  HexWordWriter writer(stream);
  writer.name("numbers");
  for (const std::uint64_t w : words) writer.word(w);
  writer.end_line();
  writer.name("end");
  writer.end_line();
  CHECK(stream.str().substr(0, 41) == "numbers 0000000000000000 0000000000000001");

  HexWordReader reader(stream, "state");
  reader.expect("numbers");
  for (const std::uint64_t w : words) CHECK(reader.word("numbers") == w);
  reader.expect("end");
}

TEST_CASE("neither locale nor flags of the stream matter") {
  std::stringstream stream;
  stream << std::uppercase << std::showbase << std::oct << std::setfill('*');
  HexWordWriter writer(stream);
  writer.word(0xabcdef);
  CHECK(stream.str() == " 0000000000abcdef");
  CHECK(HexWordReader(stream, "state").word("x") == 0xabcdef);
}

TEST_CASE("every fault is one line that names the field") {
  const auto word = [](HexWordReader& r) { r.word("tempo"); };
  const auto name = [](HexWordReader& r) { r.expect("tempo"); };
  CHECK(error_of("", word) == "state: the stream ends at 'tempo'");
  CHECK(error_of("", name) == "state: the stream ends at 'tempo'");
  CHECK(error_of("0", word) == "state: field 'tempo': expected 16 hexadecimal digits, got '0'");
  CHECK(error_of("00000000000000000", word) ==
        "state: field 'tempo': expected 16 hexadecimal digits, got '00000000000000000'");
  CHECK(error_of("000000000000000G", word).find("16 hexadecimal digits") != std::string::npos);
  CHECK(error_of("000000000000000A", word).find("16 hexadecimal digits") != std::string::npos);
  CHECK(error_of("-000000000000001", word).find("16 hexadecimal digits") != std::string::npos);
  CHECK(error_of("time", name) == "state: expected 'tempo', got 'time'");
  // A text without blanks does not grow the message, and unprintable bytes do not break its line.
  CHECK(error_of(std::string(1000000, 'a'), word).size() < 200);
  CHECK(error_of(std::string("a\0b\x01", 4), name) == "state: expected 'tempo', got 'a?b?'");
}
