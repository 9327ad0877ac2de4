// SPDX-License-Identifier: MIT
#include <traceur/io/terrain_file.hpp>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <random>
#include <string>

#include <doctest/doctest.h>

namespace {

namespace fs = std::filesystem;
using traceur::Error;
using traceur::io::parse_terrain;
using traceur::terrain::HeightGrid;

std::string message(const std::string& text) {
  try {
    parse_terrain(text, "t.json");
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

}  // namespace

TEST_CASE("terrain file: what is written is read, bit for bit") {
  std::mt19937 generator(1);
  std::normal_distribution<double> normal;
  Eigen::MatrixXd h(5, 3);
  for (int k = 0; k < 15; ++k) h.data()[k] = normal(generator);
  const HeightGrid grid(h, 0.1 + 1e-9, -1.0 / 3, 2e-7);
  std::random_device entropy;
  const fs::path path = fs::temp_directory_path() / ("traceur-terrain-" + std::to_string(entropy()) + ".json");
  traceur::io::write_terrain(path, grid);
  const HeightGrid read = traceur::io::read_terrain(path);
  fs::remove(path);
  CHECK(read.heights() == grid.heights());
  CHECK(read.cell() == grid.cell());
  CHECK(read.x0() == grid.x0());
  CHECK(read.y0() == grid.y0());
}

TEST_CASE("terrain file: PARC's minimum is the middle of a cell, its outer index runs along x") {
  const HeightGrid g = parse_terrain(
      R"({"fps":30,"terrain":{"hf":[[1,2,3],[4,5,6]],"min_point":[10,20],"dx":0.5,"hf_maxmin":[]}})", "t");
  CHECK(g.nx() == 2);
  CHECK(g.ny() == 3);
  CHECK(g.height(10, 20) == 1);
  CHECK(g.height(9.8, 19.8) == 1);
  CHECK(g.height(10.3, 20) == 4);
  CHECK(g.height(10, 20.3) == 2);
  CHECK(g.x0() == 9.75);
}

TEST_CASE("terrain file: PARC's own motions stand on their terrain") {
  const char* motions = std::getenv("TRACEUR_MOTIONS");
  const fs::path folder = fs::path(motions ? motions : TRACEUR_SOURCE_DIR "/../shared/motions") / "parc";
  if (!fs::exists(folder)) {
    MESSAGE("left out without " << folder.string());
    return;
  }
  const HeightGrid teaser = traceur::io::read_terrain(folder / "TEASER_TERRAIN.json");
  CHECK(teaser.nx() == 102);
  CHECK(teaser.cell() == doctest::Approx(0.4));
  const HeightGrid g = traceur::io::read_terrain(folder / "sfu.json");
  std::ifstream in(folder / "sfu.json");
  const nlohmann::json motion = nlohmann::json::parse(in);
  for (const auto& p : motion["root_pos"]) {
    const double above = p[2].get<double>() - g.height(p[0], p[1]);
    CHECK(above > 0.6);
    CHECK(above < 1);
  }
}

TEST_CASE("terrain file: every fault has a message of one line") {
  const std::string good = R"("cell_m":1,"corner_m":[0,0])";
  const char* const cases[][2] = {
      {"", "t.json:1: not JSON"},
      {"{\"cell_m\":\n\n1e999}", "t.json: not JSON"},
      {"[]", "t.json: expected an object"},
      {"{\"terrain\":5}", "t.json: terrain: expected an object"},
      {"{}", "t.json: expected field 'cell_m'"},
      {"{\"hf\":[[1]]}", "t.json: expected field 'dx'"},
      {"{\"cell_m\":\"1\"}", "t.json: cell_m: expected a number"},
      {"{\"cell_m\":1,\"corner_m\":[1]}", "t.json: corner_m: expected two numbers"},
      {"{\"cell_m\":1,\"corner_m\":[0,0],\"heights_m\":[]}", "t.json: heights_m: expected an array of arrays"},
      {"{\"cell_m\":1,\"corner_m\":[0,0],\"heights_m\":[[1,2],[3]]}", "t.json: heights_m[1]: expected 2 heights"},
      {"{\"cell_m\":1,\"corner_m\":[0,0],\"heights_m\":[[1,null]]}", "t.json: heights_m[0][1]: expected a number"},
      {"{\"cell_m\":0,\"corner_m\":[0,0],\"heights_m\":[[1]]}", "t.json: expected a cell size above zero"},
  };
  for (const auto& c : cases) {
    const std::string m = message(c[0]);
    CAPTURE(m);
    CHECK(m.rfind(c[1], 0) == 0);
    CHECK(m.find('\n') == std::string::npos);
  }
  CHECK(message("{" + good + ",\"heights_m\":[[1]]}").empty());
  CHECK(!message(std::string(200000, '[')).empty());
  CHECK(message("{" + good + ",\n\"heights_m\":[[1]]}" + std::string("\0more", 5)) ==
        "t.json:2: not JSON: did not expect a null byte");
  CHECK_THROWS_AS(traceur::io::read_terrain("/no/such/file.json"), Error);
  CHECK_THROWS_AS(traceur::io::read_terrain(fs::temp_directory_path()), Error);
}
