// SPDX-License-Identifier: MIT
// Running the example programs and looking at what they leave.
#pragma once

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

#include <nlohmann/json.hpp>
#include <sys/wait.h>

namespace examples_test {

namespace fs = std::filesystem;

/// A folder of its own for each test case of a program, empty at first.
inline fs::path fresh(const std::string& program, const std::string& name) {
  const fs::path folder = fs::temp_directory_path() / ("traceur-" + program) / name;
  fs::remove_all(folder);
  fs::create_directories(folder);
  return folder;
}

inline std::string text_of(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream out;
  out << in.rdbuf();
  return out.str();
}

struct Outcome {
  int status = -1;
  std::string out, err;
};

/// Runs a command; what it prints goes through files in the folder.
inline Outcome shell(const fs::path& folder, const std::string& command) {
  const fs::path out = folder / "stdout.txt", err = folder / "stderr.txt";
  const int raw = std::system(("{ " + command + "\n} > '" + out.string() + "' 2> '" + err.string() + "'").c_str());
  return {WIFEXITED(raw) ? WEXITSTATUS(raw) : -1, text_of(out), text_of(err)};
}

inline nlohmann::json report_of(const fs::path& out) { return nlohmann::json::parse(text_of(out / "report.json")); }

}  // namespace examples_test
