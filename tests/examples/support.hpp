// SPDX-License-Identifier: MIT
// Running the example programs and looking at what they leave.
#pragma once

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

#include <doctest/doctest.h>
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

/// Files in a folder, unfinished ones among them, but for what `shell` keeps.
inline int files_in(const fs::path& folder) {
  int count = 0;
  if (fs::exists(folder))
    for (const auto& entry : fs::recursive_directory_iterator(folder))
      count += entry.is_regular_file() && entry.path() != folder / "stdout.txt" && entry.path() != folder / "stderr.txt";
  return count;
}

/// A program, run in a folder, refuses its arguments: status 2, one line that begins with its name and has `part` in it, and
/// no file in the folder that was not there before.
inline void refused(const fs::path& program, const fs::path& folder, const std::string& arguments, const std::string& part) {
  CAPTURE(arguments);
  CAPTURE(part);
  const int before = files_in(folder);
  const Outcome o = shell(folder, program.string() + " " + arguments);
  CAPTURE(o.err);
  CHECK(o.status == 2);
  CHECK(o.err.starts_with(program.filename().string() + ": "));
  CHECK(o.err.find(part) != std::string::npos);
  CHECK(std::count(o.err.begin(), o.err.end(), '\n') == 1);
  CHECK(o.err.ends_with('\n'));
  CHECK(files_in(folder) == before);
}

inline nlohmann::json report_of(const fs::path& out) { return nlohmann::json::parse(text_of(out / "report.json")); }

}  // namespace examples_test
