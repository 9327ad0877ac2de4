// SPDX-License-Identifier: MIT
#include <traceur/io/safetensors.hpp>

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <random>
#include <string>
#include <string_view>
#include <vector>

#include <doctest/doctest.h>

#include <traceur/nn/layer_norm.hpp>

using namespace traceur;
using io::parse_safetensors;
using io::Safetensors;
using io::safetensors_bytes;

namespace {

namespace fs = std::filesystem;

template <class F>
std::string error_of(F&& call) {
  try {
    call();
  } catch (const Error& e) {
    return e.what();
  }
  return "no error";
}

bool contains(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

// A file put together by hand: the header as it stands, and the data.
std::string file_of(const std::string& header, const std::string& data) {
  std::string out;
  for (std::size_t i = 0, n = header.size(); i < 8; ++i, n >>= 8) out.push_back(static_cast<char>(n & 255));
  return out + header + data;
}

// The file is refused in one line that has `part` in it.
void refused(const std::string& part, const std::string& header, const std::string& data = "") {
  const std::string message = error_of([&] { parse_safetensors(file_of(header, data), "a.safetensors"); });
  CAPTURE(message);
  CHECK((message.starts_with("a.safetensors: ") && !contains(message, "\n") && contains(message, part)));
}

constexpr float floats[] = {1.0f, -2.5f, 0.0f, 3.0f, 1e-40f, 65504.0f};
constexpr double doubles[] = {0.1, -0.0};
constexpr std::int64_t integers[] = {-1, std::numeric_limits<std::int64_t>::max()};

Safetensors example() {
  Safetensors file;
  file.metadata = {{"format", "pt"}, {"seed", "7\n\"x\""}};
  file.add<float>("a \"b\"", {2, 3}, floats);
  file.add<double>("d", {2}, doubles);
  file.add<std::int64_t>("i", {1, 2, 1}, integers);
  file.add<float>("empty", {0, 4}, {});
  file.add<float>("scalar", {}, std::span(floats, 1));
  return file;
}

class Folder {
public:
  Folder() : path_(fs::temp_directory_path() / ("traceur-safetensors-" + std::to_string(std::random_device{}()))) {
    fs::create_directory(path_);
  }
  ~Folder() { fs::remove_all(path_); }
  fs::path operator/(const std::string& name) const { return path_ / name; }

private:
  fs::path path_;
};

// Two matrices and a vector, in the order of the slice.
struct Shapes {
  template <class S>
  struct Workspace {};
  Eigen::Index inputs() const noexcept { return 1; }
  Eigen::Index outputs() const noexcept { return 1; }
  Eigen::Index parameters() const noexcept { return 6 + 2 + 4; }
  template <class S>
  Workspace<S> workspace(Eigen::Index) const {
    return {};
  }
  template <class S>
  void forward(const S*, nn::ConstMatrix<S>, Workspace<S>&, nn::Matrix<S>) const noexcept {}
  template <class S>
  void infer(const S*, nn::ConstMatrix<S>, Workspace<S>&, nn::Matrix<S>) const noexcept {}
  template <class S>
  void backward(const S*, nn::ConstMatrix<S>, nn::ConstMatrix<S>, Workspace<S>&, S*, nn::Matrix<S>) const noexcept {}
  template <class S>
  void initialize(S*, core::RandomStream&) const {}
  template <class F>
  void for_each_parameter(F&& f) const {
    f("weight", Eigen::Index{0}, Eigen::Index{2}, Eigen::Index{3});
    f("bias", Eigen::Index{6}, Eigen::Index{2}, Eigen::Index{1});
    f("other.weight", Eigen::Index{8}, Eigen::Index{1}, Eigen::Index{4});
  }
};

// The same tensors in a network that is no module.
struct Network {
  Eigen::Index parameters() const noexcept { return 12; }
  template <class F>
  void for_each_parameter(F&& f) const {
    Shapes().for_each_parameter(f);
  }
};
static_assert(nn::Parameterized<Network> && !nn::Module<Network>);

const std::vector<float> counted = {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12};

Safetensors saved(const std::string& prefix) {
  Safetensors file("net.safetensors");
  io::add_module(file, Shapes{}, counted.data(), prefix);
  return file;
}

}  // namespace

TEST_CASE("bytes are those written by hand from the format's description") {
  Safetensors file;
  file.add<float>("w", {2, 1}, std::span(floats, 2));
  const std::string header = R"({"w":{"dtype":"F32","shape":[2,1],"data_offsets":[0,8]}})";
  const std::string data("\0\0\x80\x3F\0\0\x20\xC0", 8);  // 1 and -2.5
  REQUIRE(header.size() % 8 == 0);
  CHECK(safetensors_bytes(file) == file_of(header, data));
  // Blanks fill the header up to a multiple of eight.
  file.metadata["k"] = "v";
  const std::string longer =
      R"({"__metadata__":{"k":"v"},"w":{"dtype":"F32","shape":[2,1],"data_offsets":[0,8]}})";
  CHECK(safetensors_bytes(file) == file_of(longer + std::string(8 - longer.size() % 8, ' '), data));
  CHECK(safetensors_bytes(Safetensors()) == file_of("{}      ", ""));
}

TEST_CASE("what was written comes back bit for bit, wide elements first") {
  const Safetensors file = parse_safetensors(safetensors_bytes(example()), "again");
  CHECK(file.metadata == example().metadata);
  REQUIRE(file.tensors().size() == 5);
  CHECK(file.tensors()[0].name == "d");
  CHECK(file.tensors()[1].name == "i");
  CHECK(file.at("a \"b\"").shape == std::vector<std::uint64_t>{2, 3});
  CHECK(file.values<float>("a \"b\"") == std::vector<float>(floats, floats + 6));
  CHECK(file.values<double>("d") == std::vector<double>(doubles, doubles + 2));
  CHECK(std::signbit(file.values<double>("d")[1]));
  CHECK(file.values<std::int64_t>("i") == std::vector<std::int64_t>(integers, integers + 2));
  CHECK(file.at("i").shape == std::vector<std::uint64_t>{1, 2, 1});
  CHECK(file.values<float>("empty").empty());
  CHECK(file.at("scalar").shape.empty());
  CHECK(file.values<float>("scalar") == std::vector<float>{1});
  CHECK(safetensors_bytes(file) == safetensors_bytes(parse_safetensors(safetensors_bytes(file), "b")));
}

TEST_CASE("tensors of other types are kept, not read") {
  const std::string header = R"({"h":{"dtype":"BF16","shape":[2],"data_offsets":[0,4]},"m":{"dtype":"BOOL","shape":[1],"data_offsets":[4,5]}})";
  const Safetensors file = parse_safetensors(file_of(header, "abcde"), "f");
  CHECK(file.at("h").bytes == "abcd");
  CHECK(error_of([&] { file.values<float>("h"); }) == "f: tensor 'h': expected type F32, found BF16");
  CHECK(parse_safetensors(safetensors_bytes(file), "g").at("m").bytes == "e");
}

TEST_CASE("a tensor is read as what it is") {
  const Safetensors file = example();
  std::vector<float> five(5);
  CHECK(error_of([&] { file.read<float>("a \"b\"", five); }) ==
        "safetensors: tensor 'a \"b\"': expected 5 elements, found [2, 3]");
  CHECK(error_of([&] { file.values<float>("d"); }) == "safetensors: tensor 'd': expected type F32, found F64");
  CHECK(error_of([&] { file.values<std::int64_t>("d"); }) == "safetensors: tensor 'd': expected type I64, found F64");
  CHECK(error_of([&] { file.values<float>("x"); }) == "safetensors: tensor 'x': missing");
  CHECK(file.find("x") == nullptr);
  // Every float is a double.
  CHECK(file.values<double>("a \"b\"")[4] == static_cast<double>(1e-40f));
}

TEST_CASE("lengths that lie are refused") {
  const std::string good = safetensors_bytes(example());
  for (std::size_t n = 0; n < good.size(); ++n) {
    const std::string message = error_of([&] { parse_safetensors(std::string_view(good).substr(0, n), "cut"); });
    CAPTURE(n);
    CHECK(message.starts_with("cut: "));
  }
  CHECK(contains(error_of([&] { parse_safetensors(good + "x", "f"); }), "1 bytes at the end belong to no tensor"));
  std::string huge = good;
  huge[7] = '\x7F';
  CHECK(contains(error_of([&] { parse_safetensors(huge, "f"); }), "a header of at most 100 MB"));
  refused("expected a JSON object", "");
}

TEST_CASE("headers that are no header are refused") {
  refused("header: expected a JSON object", "[]");
  refused("header: expected a JSON object", " {}");
  refused("header: not JSON at byte", "{\"a\":");
  refused("header: not JSON at byte", "{} {}");
  refused("header: not JSON at byte", std::string("{}\0", 3));
  refused("header: not JSON at byte", "{\"\xFF\":1}");
  refused("header: not JSON", "{\"a\":1e999}");
  refused("objects too deep", "{\"a\":{\"b\":{\"c\":{}}}}");
  refused("__metadata__: expected an object of texts", "{\"__metadata__\":3}");
  refused("__metadata__ 'k': expected a text", "{\"__metadata__\":{\"k\":3}}");
  refused("tensor 'a': expected an object with a field 'dtype'", "{\"a\":3}");
  refused("tensor 'a': expected a field 'data_offsets'", R"({"a":{"dtype":"F32","shape":[0]}})");
  refused("tensor 'a': unknown dtype 'F31'", R"({"a":{"dtype":"F31","shape":[0],"data_offsets":[0,0]}})");
  refused("tensor 'a': dtype: expected a text", R"({"a":{"dtype":7,"shape":[0],"data_offsets":[0,0]}})");
  refused("tensor 'a': shape: expected a list", R"({"a":{"dtype":"F32","shape":0,"data_offsets":[0,0]}})");
  refused("shape: expected whole numbers", R"({"a":{"dtype":"F32","shape":[-1],"data_offsets":[0,0]}})");
  refused("shape: expected whole numbers", R"({"a":{"dtype":"F32","shape":[0.0],"data_offsets":[0,0]}})");
  refused("data_offsets: expected two numbers", R"({"a":{"dtype":"F32","shape":[0],"data_offsets":[0]}})");
  refused("data_offsets: expected two numbers", R"({"a":{"dtype":"F32","shape":[0],"data_offsets":[4,0]}})");
}

TEST_CASE("a name that stands there twice is refused, wherever") {
  const std::string entry = R"("a":{"dtype":"F32","shape":[0],"data_offsets":[0,0]})";
  refused("name 'a' stands there twice", "{" + entry + "," + entry + "}");
  refused("name 'k' stands there twice", R"({"__metadata__":{"k":"1","k":"2"}})");
  refused("name 'shape' stands there twice", R"({"a":{"dtype":"F32","shape":[0],"shape":[1],"data_offsets":[0,0]}})");
  // The same name in two objects is another name; a name may be escaped.
  refused("twice", R"({"a":{"dtype":"F32","shape":[0],"data_offsets":[0,0]},"\u0061":{}})");
  CHECK_NOTHROW(parse_safetensors(file_of(R"({"__metadata__":{"a":"1","shape":"2"},)" + entry + "}", ""), "f"));
}

TEST_CASE("tensors fill the data exactly") {
  const auto two = [](const std::string& first, const std::string& second, const std::string& shape = "[1]") {
    return R"({"a":{"dtype":"F32","shape":[1],"data_offsets":)" + first + R"(},"b":{"dtype":"F32","shape":)" + shape +
           R"(,"data_offsets":)" + second + "}}";
  };
  const std::string eight(8, '\0'), twelve(12, '\0');
  CHECK_NOTHROW(parse_safetensors(file_of(two("[4,8]", "[0,4]"), eight), "f"));
  CHECK_NOTHROW(parse_safetensors(file_of(two("[0,4]", "[4,8]") + " \n", eight), "f"));
  refused("expected to begin at 4, found 0: tensors overlap", two("[0,4]", "[0,4]"), eight);
  refused("tensor 'b': data_offsets: expected to begin at 4, found 2", two("[0,4]", "[2,6]"), eight);
  refused("expected to begin at 4, found 8: a hole in the file", two("[0,4]", "[8,12]"), twelve);
  refused("tensor 'a': data_offsets: expected to begin at 0, found 4", two("[4,8]", "[8,12]"), twelve);
  refused("4 bytes at the end belong to no tensor", two("[0,4]", "[4,8]"), twelve);
  refused("end at 8 of 7 bytes of data; is the file truncated?", two("[0,4]", "[4,8]"), "seven77");
  refused("tensor 'b': data_offsets: expected 4 bytes, found 8", two("[0,4]", "[4,12]"), twelve);
  refused("tensor 'b': data_offsets: expected 8 bytes, found 4", two("[0,4]", "[4,8]", "[2]"), eight);
  // Products that wrap around 2^64 do not pass for small ones.
  refused("tensor 'b': shape: too large", two("[0,4]", "[4,8]", "[4294967296,4294967296]"), eight);
  refused("tensor 'b': shape: too large", two("[0,4]", "[4,4]", "[4611686018427387904]"), eight);
  refused("shape: expected whole numbers", two("[0,4]", "[4,8]", "[18446744073709551616]"), eight);
}

TEST_CASE("what cannot be written is refused before") {
  Safetensors file;
  CHECK_THROWS_WITH_AS(file.add<float>("w", {3}, std::span(floats, 2)),
                       "safetensors: tensor 'w': expected as many bytes as F32 [3] takes, got 8", Error);
  file.add<float>("w", {2}, std::span(floats, 2));
  CHECK_THROWS_WITH_AS(file.add<float>("w", {1}, std::span(floats, 1)), "safetensors: tensor 'w': added twice", Error);
  CHECK_THROWS_AS(file.add<float>("__metadata__", {1}, std::span(floats, 1)), Error);
  CHECK_THROWS_AS(file.add(io::Tensor{"u", "F12", {1}, "a"}), Error);
  file.add<float>("\xFF", {1}, std::span(floats, 1));
  CHECK_THROWS_WITH_AS(safetensors_bytes(file), "safetensors: expected names and metadata in UTF-8", Error);
}

TEST_CASE("NaN may stand in a file; who cares can ask") {
  Safetensors file("f");
  const double numbers[] = {1.0, std::nan(""), 2.0};
  file.add<float>("fine", {6}, floats);
  file.add<std::int64_t>("whole", {2}, integers);
  CHECK_NOTHROW(file.check_finite());
  file.add<double>("odd", {3}, numbers);
  const Safetensors again = parse_safetensors(safetensors_bytes(file), "f");
  CHECK(std::isnan(again.values<double>("odd")[1]));
  CHECK(error_of([&] { again.check_finite(); }) == "f: tensor 'odd': expected finite numbers, element 1 is not");
}

TEST_CASE("files are read and written whole") {
  const Folder folder;
  io::write_safetensors(folder / "a.safetensors", example());
  CHECK(safetensors_bytes(io::read_safetensors(folder / "a.safetensors")) == safetensors_bytes(example()));
  const std::string missing = (folder / "b.safetensors").string();
  CHECK(error_of([&] { io::read_safetensors(missing); }) == missing + ": no such file");
  CHECK(contains(error_of([&] { io::read_safetensors(folder / ""); }), "expected a file, found a folder"));
  fs::resize_file(folder / "a.safetensors", 100);
  CHECK(error_of([&] { io::read_safetensors(folder / "a.safetensors"); })
            .starts_with((folder / "a.safetensors").string() + ": header of "));
}

TEST_CASE("a module's parameters are stored by rows and come back") {
  const Safetensors file = parse_safetensors(safetensors_bytes(saved("policy.")), "net.safetensors");
  CHECK(file.at("policy.weight").shape == std::vector<std::uint64_t>{2, 3});
  CHECK(file.values<float>("policy.weight") == std::vector<float>{1, 3, 5, 2, 4, 6});
  CHECK(file.at("policy.bias").shape == std::vector<std::uint64_t>{2});
  CHECK(file.at("policy.other.weight").shape == std::vector<std::uint64_t>{1, 4});
  std::vector<float> theta(12);
  io::read_module(file, Shapes{}, theta.data(), "policy.");
  CHECK(theta == counted);
  std::vector<double> wide(12);
  io::read_module(file, Shapes{}, wide.data(), "policy.");
  CHECK(wide == std::vector<double>(counted.begin(), counted.end()));
}

TEST_CASE("a network that is no module is stored as a module of the same tensors is") {
  Safetensors file("net.safetensors");
  io::add_module(file, Network{}, counted.data(), "policy.");
  CHECK(safetensors_bytes(file) == safetensors_bytes(saved("policy.")));
  std::vector<float> theta(12);
  io::read_module(file, Network{}, theta.data(), "policy.");
  CHECK(theta == counted);
}

TEST_CASE("vectors go in and come back, matrices as their memory lies") {
  Safetensors file("f");
  const Eigen::VectorXd d = Eigen::VectorXd::LinSpaced(5, -1, 1);
  Eigen::MatrixXf m(2, 3);
  m << 1, 3, 5, 2, 4, 6;
  io::add_vector(file, "d", d);
  io::add_vector(file, "m", m);
  io::add_vector(file, "none", Eigen::VectorXf());
  CHECK(file.at("d").shape == std::vector<std::uint64_t>{5});
  CHECK(file.at("d").type == "F64");
  CHECK(file.values<float>("m") == std::vector<float>{1, 2, 3, 4, 5, 6});
  CHECK((io::get_vector<double>(file, "d") == d));
  CHECK(io::get_vector<float>(file, "none").size() == 0);
  CHECK((io::get_vector<float>(file, "m", 6) == Eigen::Map<const Eigen::VectorXf>(m.data(), 6)));
  CHECK(error_of([&] { io::get_vector<float>(file, "m", 5); }) == "f: tensor 'm': expected 5 elements, found [6]");
  CHECK(error_of([&] { io::get_vector<float>(file, "d"); }) == "f: tensor 'd': expected type F32, found F64");
  CHECK(error_of([&] { io::get_vector<double>(file, "x"); }) == "f: tensor 'x': missing");
  CHECK(error_of([&] { io::get_vector<double>(file, "x", 2); }) == "f: tensor 'x': missing");
  // Only who says how many numbers there are has them looked at.
  io::add_vector(file, "odd", Eigen::VectorXf::Constant(2, std::numeric_limits<float>::infinity()).eval());
  CHECK(std::isinf(io::get_vector<float>(file, "odd")[1]));
  CHECK(error_of([&] { io::get_vector<float>(file, "odd", 2); }) == "f: tensor 'odd': expected finite numbers, element 0 is not");
}

TEST_CASE("two modules share a file under their prefixes") {
  Safetensors file = saved("a.");
  const std::vector<float> norm = {1, 2, 3, 4};
  io::add_module(file, nn::LayerNorm(2), norm.data(), "b.");
  std::vector<float> theta(12), back(4);
  io::read_module(file, Shapes{}, theta.data(), "a.");
  io::read_module(file, nn::LayerNorm(2), back.data(), "b.");
  CHECK(theta == counted);
  CHECK(back == norm);
}

TEST_CASE("parameters of another module are refused by name") {
  std::vector<float> theta(12);
  const auto message = [&](const Safetensors& file) {
    return error_of([&] { io::read_module(file, Shapes{}, theta.data()); });
  };
  Safetensors file("net.safetensors");
  file.add<float>("weight", {3, 2}, floats);
  CHECK(message(file) == "net.safetensors: tensor 'weight': expected shape [2, 3], found [3, 2]");
  file = Safetensors("net.safetensors");
  file.add<float>("weight", {2, 3}, floats);
  CHECK(message(file) == "net.safetensors: tensor 'bias': missing");
  file = saved("");
  file.add<float>("layers.9.weight", {1}, std::span(floats, 1));
  CHECK(message(file) == "net.safetensors: tensor 'layers.9.weight': the module has no such parameter");
  file = Safetensors("net.safetensors");
  const float bad[] = {1, 2, 3, std::numeric_limits<float>::infinity(), 5, 6};
  file.add<float>("weight", {2, 3}, bad);
  CHECK(message(file) == "net.safetensors: tensor 'weight': expected finite numbers, element 3 is not");
  file = Safetensors("net.safetensors");
  const std::vector<double> six(6);
  file.add<double>("weight", {2, 3}, six);
  CHECK(message(file) == "net.safetensors: tensor 'weight': expected type F32, found F64");
}

TEST_CASE("a tensor of more dimensions is a matrix of its first by the rest") {
  Safetensors file;
  file.add<float>("weight", {2, 1, 3, 1}, floats);
  file.add<float>("bias", {2, 1}, std::span(floats, 2));
  file.add<float>("other.weight", {1, 2, 2}, std::span(floats, 4));
  std::vector<float> theta(12);
  io::read_module(file, Shapes{}, theta.data());
  CHECK(theta[2] == floats[1]);
  CHECK(theta[1] == floats[3]);
}

// The snippet of docs/nn.md. Keep the two alike.
TEST_CASE("parameters saved and loaded") {
  const Folder folder;
  const fs::path path = folder / "policy.safetensors";
  const nn::LayerNorm policy(4);
  std::vector<float> theta(8, 0.5f), loaded(8);

  traceur::io::Safetensors file;
  file.metadata["seed"] = "7";
  traceur::io::add_module(file, policy, theta.data(), "policy.");
  traceur::io::write_safetensors(path, file);

  traceur::io::read_module(traceur::io::read_safetensors(path), policy, loaded.data(), "policy.");

  CHECK(loaded == theta);
}
