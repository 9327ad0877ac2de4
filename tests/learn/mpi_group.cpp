// SPDX-License-Identifier: MIT
#include <traceur/learn/mpi_group.hpp>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include <doctest/doctest.h>
#include <unistd.h>

#include "group_support.hpp"
#include <traceur/learn/single_process.hpp>

using namespace traceur::learn;
using namespace learn_test;
namespace fs = std::filesystem;

namespace {

// Where the ranks that a test starts write what they came to; set in them only.
constexpr const char* folder_variable = "TRACEUR_TEST_MPI_FOLDER";

fs::path results_of(const fs::path& folder, int rank, bool with_style) {
  return folder / ((with_style ? "style_" : "plain_") + std::to_string(rank));
}

}  // namespace

// What `mpirun` runs: this program, of which this case alone. MPI itself leaves memory behind.
TEST_CASE("a rank of an MPI run" * doctest::skip(std::getenv(folder_variable) == nullptr)) {
  const fs::path folder = std::getenv(folder_variable);
  MpiGroup group;
  for (const bool with_style : {false, true}) {
    const std::vector<float> came_to = shared_run(group, with_style);
    std::ofstream(results_of(folder, group.rank(), with_style), std::ios::binary)
        .write(reinterpret_cast<const char*>(came_to.data()), static_cast<std::streamsize>(came_to.size() * sizeof(float)));
  }
  CHECK(group.size() == 2);
}

TEST_CASE("two MPI ranks come to what one process comes to, to the bit") {
  if (std::getenv(folder_variable) != nullptr) return;
  if (std::system("mpirun --version > /dev/null 2>&1") != 0) {
    MESSAGE("left out: there is no mpirun");
    return;
  }
  const fs::path folder = fs::temp_directory_path() / ("traceur-mpi-" + std::to_string(getpid()));
  fs::create_directories(folder);
  const std::string self = fs::read_symlink("/proc/self/exe").string();
  const std::string command = std::string("ASAN_OPTIONS=detect_leaks=0 OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 ") + folder_variable + "=" +
                              folder.string() + " timeout 120 mpirun -n 2 --oversubscribe '" + self +
                              "' --test-case='a rank of an MPI run' > '" + (folder / "log").string() + "' 2>&1";
  const int status = std::system(command.c_str());
  std::string log;
  std::getline(std::ifstream(folder / "log"), log, '\0');
  CAPTURE(log);
  REQUIRE(status == 0);
  for (const bool with_style : {false, true}) {
    SingleProcess alone;
    const std::vector<float> whole = shared_run(alone, with_style);
    for (const int rank : {0, 1}) {
      std::ifstream in(results_of(folder, rank, with_style), std::ios::binary);
      std::vector<float> part(whole.size() + 1);
      in.read(reinterpret_cast<char*>(part.data()), static_cast<std::streamsize>(part.size() * sizeof(float)));
      part.resize(static_cast<std::size_t>(in.gcount()) / sizeof(float));
      CHECK(part == whole);
    }
  }
  fs::remove_all(folder);
}
