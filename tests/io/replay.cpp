// SPDX-License-Identifier: MIT
#include <traceur/io/replay.hpp>

#include <doctest/doctest.h>

#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <limits>
#include <locale>
#include <random>
#include <string>
#include <string_view>
#include <vector>

namespace {

namespace fs = std::filesystem;
namespace io = traceur::io;
using Bytes = std::vector<std::uint8_t>;

constexpr float not_a_number = std::numeric_limits<float>::quiet_NaN();
constexpr float infinity = std::numeric_limits<float>::infinity();

class Folder {
public:
  Folder() {
    std::random_device entropy;
    path_ = fs::temp_directory_path() / ("traceur-replay-" + std::to_string(entropy()) + std::to_string(entropy()));
    fs::create_directory(path_);
  }
  ~Folder() { fs::remove_all(path_); }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;

  fs::path operator/(const std::string& name) const { return path_ / name; }
  bool empty() const { return fs::is_empty(path_); }

private:
  fs::path path_;
};

std::string content(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

std::string message_of(const std::function<void()>& f) {
  try {
    f();
  } catch (const traceur::Error& error) {
    return error.what();
  }
  return "";
}

bool contains(std::string_view text, std::string_view part) { return text.find(part) != std::string_view::npos; }

int occurrences(std::string_view text, std::string_view part) {
  int count = 0;
  for (auto at = text.find(part); at != std::string_view::npos; at = text.find(part, at + 1)) ++count;
  return count;
}

Bytes decode(std::string_view text) {
  const std::string_view digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  REQUIRE(text.size() % 4 == 0);
  Bytes bytes;
  std::uint32_t bits = 0;
  int held = 0;
  for (const char c : text) {
    if (c == '=') break;
    const auto digit = digits.find(c);
    REQUIRE(digit != std::string_view::npos);
    bits = bits << 6U | static_cast<std::uint32_t>(digit);
    held += 6;
    if (held < 8) continue;
    held -= 8;
    bytes.push_back(static_cast<std::uint8_t>(bits >> held & 255U));
  }
  return bytes;
}

std::vector<double> float32(const Bytes& bytes) {
  std::vector<double> out;
  for (std::size_t i = 0; i + 3 < bytes.size(); i += 4) {
    std::uint32_t word = 0;
    for (std::size_t k = 0; k < 4; ++k) word |= static_cast<std::uint32_t>(bytes[i + k]) << (8 * k);
    out.push_back(double{std::bit_cast<float>(word)});
  }
  return out;
}

std::vector<double> int16(const Bytes& bytes) {
  std::vector<double> out;
  for (std::size_t i = 0; i + 1 < bytes.size(); i += 2) {
    const int word = bytes[i] | bytes[i + 1] << 8;
    out.push_back(word < 32768 ? word : word - 65536);
  }
  return out;
}

/// The page's data, read with no more JSON than the writer's own keys: the value behind the n-th `"key":`.
class Data {
public:
  explicit Data(const std::string& page) {
    const std::string open = "id=\"replay-data\">";
    const auto begin = page.find(open);
    REQUIRE(begin != std::string::npos);
    text_ = page.substr(begin + open.size(), page.find("</script>", begin) - begin - open.size());
  }
  const std::string& text() const { return text_; }
  std::string string(const std::string& key, int n = 0) const {
    const auto begin = after(key, n);
    REQUIRE(text_[begin] == '"');
    return text_.substr(begin + 1, text_.find('"', begin + 1) - begin - 1);
  }
  double number(const std::string& key, int n = 0) const { return std::strtod(text_.c_str() + after(key, n), nullptr); }
  bool wide(int n = 0) const { return text_.compare(after("wide", n), 4, "true") == 0; }
  std::vector<double> numbers(const std::string& key, int n, bool is_wide) const {
    const Bytes bytes = decode(string(key, n));
    return is_wide ? float32(bytes) : int16(bytes);
  }

private:
  std::size_t after(const std::string& key, int n) const {
    const std::string mark = "\"" + key + "\":";
    auto at = text_.find(mark);
    for (; n > 0 && at != std::string::npos; --n) at = text_.find(mark, at + 1);
    REQUIRE(at != std::string::npos);
    return at + mark.size();
  }
  std::string text_;
};

io::ReplayCharacter chain(int bodies) {
  io::ReplayCharacter character;
  for (int b = 0; b < bodies; ++b) {
    character.bodies.push_back({"body" + std::to_string(b), b - 1});
    character.shapes.push_back({.kind = io::ReplayShape::Kind::capsule, .body = b, .size = {0.05F, 0.1F, 0}});
  }
  return character;
}

/// Bodies within `reach` of a root that starts at `start` on every axis, all turned at random.
io::ReplayTrack random_track(int bodies, int frames, float reach, float start) {
  std::mt19937 bits(7);
  std::normal_distribution<float> normal;
  std::uniform_real_distribution<float> uniform(-reach, reach);
  io::ReplayTrack track;
  track.name = "random";
  for (int f = 0; f < frames; ++f) {
    float root[3];
    for (float& x : root) x = start + uniform(bits);
    for (int b = 0; b < bodies; ++b) {
      for (const float x : root) track.poses.push_back(b == 0 ? x : x + uniform(bits));
      float q[4], square = 0;
      for (float& x : q) {
        x = normal(bits);
        square += x * x;
      }
      for (const float x : q) track.poses.push_back(x / std::sqrt(square));
    }
  }
  return track;
}

io::Replay replay_of(int bodies, int frames, float reach = 1, float start = 0) {
  io::Replay replay;
  replay.title = "walk";
  replay.characters = {chain(bodies)};
  replay.tracks = {random_track(bodies, frames, reach, start)};
  return replay;
}

void check_round_trip(const io::Replay& replay, bool expect_wide) {
  const Data data(io::replay_page(replay));
  const std::size_t bodies = replay.characters[0].bodies.size();
  const std::vector<float>& poses = replay.tracks[0].poses;
  const bool wide = data.wide();
  CHECK(wide == expect_wide);
  const double step = data.number("step");
  const std::vector<double> roots = float32(decode(data.string("roots"))), values = data.numbers("poses", 0, wide);
  REQUIRE(values.size() == poses.size());
  REQUIRE(roots.size() * bodies * 7 == poses.size() * 3);
  double worst_position = 0, worst_angle = 0;
  for (std::size_t i = 0; i < poses.size(); i += 7) {
    for (std::size_t k = 0; k < 3; ++k) {
      const double position = roots[i / (7 * bodies) * 3 + k] + step * values[i + k];
      worst_position = std::max(worst_position, std::abs(position - double{poses[i + k]}));
      if (i % (7 * bodies) == 0) CHECK(position == double{poses[i + k]});
    }
    double a = 0, b = 0, apart = 0;
    for (std::size_t k = 3; k < 7; ++k) {
      a += double{poses[i + k]} * double{poses[i + k]};
      b += values[i + k] * values[i + k];
    }
    for (std::size_t k = 3; k < 7; ++k) {
      apart += std::pow(double{poses[i + k]} / std::sqrt(a) - values[i + k] / std::sqrt(b), 2);
    }
    worst_angle = std::max(worst_angle, 2 * std::sqrt(apart));
  }
  CHECK(worst_position <= 0.0005);
  CHECK(worst_angle < 1e-4);
}

}  // namespace

TEST_CASE("base64 agrees with the vectors of RFC 4648") {
  const std::vector<std::pair<std::string, std::string>> vectors{
      {"", ""},          {"f", "Zg=="},       {"fo", "Zm8="},       {"foo", "Zm9v"},
      {"foob", "Zm9vYg=="}, {"fooba", "Zm9vYmE="}, {"foobar", "Zm9vYmFy"}};
  for (const auto& [plain, coded] : vectors) {
    CHECK(io::detail::replay_base64(Bytes(plain.begin(), plain.end())) == coded);
  }
  CHECK(io::detail::replay_base64({0xFB, 0xFF, 0xBF}) == "+/+/");
}

TEST_CASE("poses come back to half a millimetre and a ten-thousandth of a radian") {
  check_round_trip(replay_of(15, 40), false);
  check_round_trip(replay_of(1, 3), false);
  // At the edge of what int16 resolves, and beyond it.
  check_round_trip(replay_of(4, 40, 30), false);
  check_round_trip(replay_of(4, 40, 300), true);
  // Far from the origin only the root's own float limits the place.
  check_round_trip(replay_of(5, 40, 1, 4000), false);
}

TEST_CASE("contacts, pushes and terrain come back") {
  for (const float far : {1.0F, 90.0F}) {
    io::Replay replay = replay_of(3, 4);
    io::ReplayTrack& track = replay.tracks[0];
    track.contacts = {{}, {{far, 2, 3, 400, -50, 900}, {0, 0, 0, 0, 0, 0}}, {{-1, 0.5F, 0, 1, 2, 3}}, {}};
    track.pushes.assign(24, 0.0F);
    track.pushes[14] = 1.5F;
    track.pushes[17] = -20.0F;
    replay.terrain = {.nx = 3, .ny = 2, .dx = 0.25F, .x0 = -1, .y0 = 2, .heights = {0, 0.1F, far, -0.7F, 0, 1.0F / 3}};
    const Data data(io::replay_page(replay));

    const bool wide = data.wide(1);
    CHECK(wide == (far > 33));
    CHECK(int16(decode(data.string("counts"))) == std::vector<double>{0, 2, 1, 0});
    const std::vector<double> values = data.numbers("values", 0, wide);
    REQUIRE(values.size() == 18);
    const double point_step = data.number("pointStep"), force_step = data.number("forceStep");
    std::size_t i = 0;
    for (std::size_t f = 0; f < 4; ++f) {
      for (const auto& contact : track.contacts[f]) {
        for (std::size_t k = 0; k < 3; ++k, ++i) {
          CHECK(std::abs(double{track.poses[f * 21 + k]} + point_step * values[i] - double{contact[k]}) <= 0.0005);
        }
        for (std::size_t k = 3; k < 6; ++k, ++i) {
          CHECK(std::abs(force_step * values[i] - double{contact[k]}) <= 900.0 / 65534 + 1e-6);
        }
      }
    }

    const std::vector<double> pushes = float32(decode(data.string("pushes")));
    CHECK(pushes == std::vector<double>(track.pushes.begin(), track.pushes.end()));

    CHECK(data.number("nx") == 3);
    CHECK(data.number("ny") == 2);
    CHECK(data.number("dx") == 0.25);
    CHECK(data.number("x0") == -1);
    CHECK(data.number("y0") == 2);
    const std::vector<double> heights = data.numbers("heights", 0, data.wide(2));
    REQUIRE(heights.size() == 6);
    for (std::size_t n = 0; n < 6; ++n) {
      CHECK(std::abs(data.number("step", 1) * heights[n] - double{replay.terrain.heights[n]}) <= 0.0005);
    }
  }
}

TEST_CASE("shapes and tracks keep their fields") {
  io::Replay replay = replay_of(2, 2);
  using Kind = io::ReplayShape::Kind;
  // What a kind does not use is not looked at.
  replay.characters[0].shapes = {{.kind = Kind::sphere, .body = 1, .position = {0.5F, -1, 2},
                                  .size = {0.25F, not_a_number, not_a_number}},
                                 {.kind = Kind::capsule, .rotation = {0, 0, 1, 0}, .size = {0.125F, 0, not_a_number}},
                                 {.kind = Kind::box, .body = 1, .size = {1, 2, 3}}};
  replay.tracks.push_back(replay.tracks[0]);
  replay.tracks[1].name = "plan";
  replay.tracks[1].ghost = true;
  replay.tracks[1].fps = 12.5F;
  replay.tracks[1].color = {1, 0.5F, 0};
  const Data data(io::replay_page(replay));
  CHECK(contains(data.text(), R"({"kind":"sphere","body":1,"position":[0.5,-1,2],"rotation":[0,0,0,1],"size":[0.25,0,0]})"));
  CHECK(contains(data.text(), R"({"kind":"capsule","body":0,"position":[0,0,0],"rotation":[0,0,1,0],"size":[0.125,0,0]})"));
  CHECK(contains(data.text(), R"("kind":"box","body":1,"position":[0,0,0],"rotation":[0,0,0,1],"size":[1,2,3])"));
  CHECK(contains(data.text(), R"({"name":"random","ghost":false,)"));
  CHECK(contains(data.text(), R"({"name":"plan","ghost":true,"color":[1,0.5,0],"fps":12.5,"character":0,"frames":2,)"));
  CHECK(contains(data.text(), R"({"name":"body1","parent":0})"));
  CHECK(contains(data.text(), R"("terrain":null)"));
}

TEST_CASE("twenty seconds of two figures stay under 1.5 MB") {
  io::Replay replay = replay_of(15, 1200);
  replay.tracks[0].contacts.assign(1200, std::vector<std::array<float, 6>>(8, {0, 0, 0, 10, 20, 300}));
  replay.tracks.push_back(replay.tracks[0]);
  replay.terrain = {.nx = 100, .ny = 100, .dx = 0.1F, .heights = std::vector<float>(10000, 0.3F)};
  CHECK(io::replay_page(replay).size() < 1500000);
}

TEST_CASE("hostile text stays text") {
  const std::string hostile = "</title></script><script>alert(\"1\")</script><!-- & 'q' \\ \n\x01 \xE2\x82\xAC \xFF\xC0\x80";
  io::Replay plain = replay_of(2, 2), evil = plain;
  evil.title = hostile;
  evil.facts = {{hostile, hostile}};
  evil.tracks[0].name = hostile;
  evil.characters[0].bodies[1].name = hostile;
  const std::string page = io::replay_page(evil), reference = io::replay_page(plain);
  for (const char* part : {"<script", "</script", "<!--", "</title", "alert", "\x01", "\xFF", "\xC0"}) {
    CAPTURE(part);
    CHECK(occurrences(page, part) == occurrences(reference, part) + (std::string_view(part) == "alert" ? 6 : 0));
  }
  const std::string json = Data(page).string("title");
  CHECK(json ==
        "\\u003c/title\\u003e\\u003c/script\\u003e\\u003cscript\\u003ealert(\\u00221\\u0022)\\u003c/script\\u003e\\u003c!-- "
        "\\u0026 'q' \\u005c \\u000a\\u0001 \xE2\x82\xAC \\ufffd\\ufffd\\ufffd");
  CHECK(contains(page, "<title>&lt;/title&gt;&lt;/script&gt;&lt;script&gt;alert(\"1\")&lt;/script&gt;&lt;!-- &amp; 'q' \\ "));
}

TEST_CASE("only well-formed UTF-8 passes") {
  using io::detail::replay_utf8_length;
  CHECK(replay_utf8_length("a", 0) == 1);
  CHECK(replay_utf8_length("\xC3\xA9", 0) == 2);
  CHECK(replay_utf8_length("\xE2\x82\xAC", 0) == 3);
  CHECK(replay_utf8_length("\xF0\x9F\x8F\x83", 0) == 4);
  CHECK(replay_utf8_length("\xF4\x8F\xBF\xBF", 0) == 4);
  for (const char* bad : {"\x80", "\xC1\x81", "\xE2\x82", "\xE0\x9F\xBF", "\xED\xA0\x80", "\xF0\x8F\xBF\xBF", "\xF4\x90\x80\x80",
                          "\xF5\x80\x80\x80", "\xC3" "a"}) {
    CHECK(replay_utf8_length(bad, 0) == 0);
  }
}

TEST_CASE("the page needs nothing but itself") {
  const std::string page = io::replay_page(replay_of(2, 2));
  for (const char* part : {"http:", "https:", "src=", "href=", "url(", "import ", "fetch(", "XMLHttpRequest"}) {
    CAPTURE(part);
    CHECK(!contains(page, part));
  }
  CHECK(contains(page, "default-src 'none'"));
  CHECK(page.substr(0, 15) == "<!doctype html>");
  CHECK(page.substr(page.size() - 8) == "</html>\n");
}

TEST_CASE("the page does not depend on the locale or on chance") {
  struct Comma : std::numpunct<char> {
    char do_decimal_point() const override { return ','; }
    char do_thousands_sep() const override { return '.'; }
    std::string do_grouping() const override { return "\3"; }
  };
  const io::Replay replay = replay_of(3, 1500);
  const std::string page = io::replay_page(replay);
  const std::locale before = std::locale::global(std::locale(std::locale::classic(), new Comma));
  const std::string same = io::replay_page(replay);
  std::locale::global(before);
  CHECK(page == same);
}

TEST_CASE("the file holds the page, or there is none") {
  Folder folder;
  const io::Replay replay = replay_of(2, 3);
  io::write_replay(folder / "walk.html", replay);
  CHECK(content(folder / "walk.html") == io::replay_page(replay));
  fs::remove(folder / "walk.html");

  const fs::path missing = folder / "missing/walk.html";
  CHECK(contains(message_of([&] { io::write_replay(missing, replay); }), missing.string()));
  io::Replay broken = replay;
  broken.tracks[0].poses[5] = not_a_number;
  CHECK_THROWS_AS(io::write_replay(folder / "walk.html", broken), traceur::Error);
  CHECK(folder.empty());
}

TEST_CASE("an error names the place") {
  struct Fault {
    std::function<void(io::Replay&)> make;
    std::vector<std::string> named;
  };
  const std::vector<Fault> faults{
      {[](io::Replay& r) { r.tracks.clear(); }, {"tracks"}},
      {[](io::Replay& r) { r.characters[0].bodies.clear(); }, {"character 0", "body"}},
      {[](io::Replay& r) { r.characters[0].bodies[1].parent = 1; }, {"character 0", "body 1 'body1'", "parent"}},
      {[](io::Replay& r) { r.characters[0].bodies[1].parent = -2; }, {"character 0", "body 1", "parent"}},
      {[](io::Replay& r) { r.characters[0].shapes[2].body = 3; }, {"character 0", "shape 2", "body is 3"}},
      {[](io::Replay& r) { r.characters[0].shapes[2].body = -1; }, {"character 0", "shape 2", "body is -1"}},
      {[](io::Replay& r) { r.characters[0].shapes[1].size[0] = 0; }, {"shape 1", "size[0]"}},
      {[](io::Replay& r) { r.characters[0].shapes[1].size[1] = -1; }, {"shape 1", "size[1]"}},
      {[](io::Replay& r) { r.characters[0].shapes[1].size[1] = infinity; }, {"shape 1", "size[1]"}},
      {[](io::Replay& r) { r.characters[0].shapes[1].position[2] = not_a_number; }, {"shape 1", "position"}},
      {[](io::Replay& r) { r.characters[0].shapes[1].rotation[0] = 1; }, {"shape 1", "rotation"}},
      {[](io::Replay& r) { r.characters[0].shapes[1].kind = static_cast<io::ReplayShape::Kind>(9); }, {"shape 1", "kind"}},
      {[](io::Replay& r) { r.tracks[0].character = 1; }, {"track 0 'random'", "character is 1"}},
      {[](io::Replay& r) { r.tracks[0].character = -1; }, {"track 0", "character is -1"}},
      {[](io::Replay& r) { r.tracks[0].fps = 0; }, {"track 0", "fps"}},
      {[](io::Replay& r) { r.tracks[0].fps = infinity; }, {"track 0", "fps"}},
      {[](io::Replay& r) { r.tracks[0].color[1] = 1.5F; }, {"track 0", "color"}},
      {[](io::Replay& r) { r.tracks[0].color[1] = not_a_number; }, {"track 0", "color"}},
      {[](io::Replay& r) { r.tracks[0].poses.pop_back(); }, {"track 0", "poses", "83", "3 bodies"}},
      {[](io::Replay& r) { r.tracks[0].poses.clear(); }, {"track 0", "poses"}},
      {[](io::Replay& r) { r.tracks[0].poses[2 * 21 + 7] = not_a_number; }, {"track 0", "frame 2", "body 1 'body1'", "finite"}},
      {[](io::Replay& r) { r.tracks[0].poses[3 * 21 + 6] += 1; }, {"track 0", "frame 3", "body 0", "unit quaternion"}},
      {[](io::Replay& r) { r.tracks[0].contacts.resize(3); }, {"track 0", "contacts", "3 frames", "4"}},
      {[](io::Replay& r) {
         r.tracks[0].contacts.resize(4);
         r.tracks[0].contacts[1] = {{0, 0, 0, 0, 0, 0}, {0, 0, 0, 0, infinity, 0}};
       },
       {"track 0", "frame 1", "contact 1", "finite"}},
      {[](io::Replay& r) { r.tracks[0].pushes.resize(23); }, {"track 0", "pushes", "23", "4 frames"}},
      {[](io::Replay& r) {
         r.tracks[0].pushes.resize(24);
         r.tracks[0].pushes[20] = not_a_number;
       },
       {"track 0", "frame 3", "push"}},
      {[](io::Replay& r) { r.terrain.nx = 3; }, {"terrain", "heights", "4", "3 x 2"}},
      {[](io::Replay& r) { r.terrain.nx = r.terrain.ny = -2; }, {"terrain", "-2 x -2"}},
      {[](io::Replay& r) { r.terrain.dx = 0; }, {"terrain", "dx"}},
      {[](io::Replay& r) { r.terrain.x0 = not_a_number; }, {"terrain", "x0"}},
      {[](io::Replay& r) { r.terrain.heights[3] = not_a_number; }, {"terrain", "column 1, 1"}},
  };
  for (std::size_t i = 0; i < faults.size(); ++i) {
    CAPTURE(i);
    io::Replay replay = replay_of(3, 4);
    replay.terrain = {.nx = 2, .ny = 2, .dx = 0.5F, .heights = {0, 1, 2, 3}};
    CHECK_NOTHROW(io::replay_page(replay));
    faults[i].make(replay);
    const std::string message = message_of([&] { io::replay_page(replay); });
    CAPTURE(message);
    for (const std::string& part : faults[i].named) CHECK(contains(message, part));
    CHECK(!contains(message, "\n"));
  }
}

TEST_CASE("no piece of the page is longer than compilers take") {
  CHECK(io::detail::replay_page_before_title.size() < 14000);
  for (const std::string_view piece : io::detail::replay_page_before_data) CHECK(piece.size() < 14000);
  for (const std::string_view piece : io::detail::replay_page_after_data) CHECK(piece.size() < 14000);
}
