// SPDX-License-Identifier: MIT
#include <traceur/io/atomic_file.hpp>

#include <doctest/doctest.h>

#include <cerrno>
#include <csignal>
#include <cstddef>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <thread>
#include <vector>

#if defined(__unix__)
#include <sys/resource.h>
#endif

namespace {

namespace fs = std::filesystem;

class Folder {
public:
  Folder() {
    std::random_device entropy;
    path_ = fs::temp_directory_path() / ("traceur-atomic-file-" + std::to_string(entropy()) + std::to_string(entropy()));
    fs::create_directory(path_);
  }
  ~Folder() { fs::remove_all(path_); }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;

  fs::path operator/(const std::string& name) const { return path_ / name; }
  std::ptrdiff_t entries() const { return std::distance(fs::directory_iterator(path_), fs::directory_iterator()); }

private:
  fs::path path_;
};

std::string content(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

template <class F>
std::string message_of(F&& f) {
  try {
    f();
  } catch (const traceur::Error& error) {
    return error.what();
  }
  return "";
}

bool contains(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

}  // namespace

using traceur::io::AtomicFile;
using traceur::io::write_atomically;

TEST_CASE("every byte arrives and no temporary stays") {
  Folder folder;
  std::string all;
  for (int i = 0; i < 200000; ++i) all.push_back(static_cast<char>(i * 7 + i / 251));
  write_atomically(folder / "all.bin", all);
  CHECK(content(folder / "all.bin") == all);
  write_atomically(folder / "empty.bin", "");
  CHECK(fs::file_size(folder / "empty.bin") == 0);
  CHECK(folder.entries() == 2);
}

TEST_CASE("an older file stays until the new one is complete") {
  Folder folder;
  write_atomically(folder / "a.txt", "old");
  {
    AtomicFile file(folder / "a.txt");
    file.write("ne");
    CHECK(content(folder / "a.txt") == "old");
    file.write("w");
    file.commit();
  }
  CHECK(content(folder / "a.txt") == "new");
  CHECK(folder.entries() == 1);
}

TEST_CASE("a file that is never committed leaves no trace") {
  Folder folder;
  write_atomically(folder / "a.txt", "old");
  {
    AtomicFile replaced(folder / "a.txt");
    AtomicFile fresh(folder / "b.txt");
    replaced.write("dropped");
    fresh.write("dropped");
  }
  CHECK(content(folder / "a.txt") == "old");
  CHECK(folder.entries() == 1);
}

TEST_CASE("a relative path without a folder is written to the working folder") {
  Folder folder;
  const fs::path before = fs::current_path();
  fs::current_path(folder / "");
  write_atomically("plain.txt", "here");
  fs::current_path(before);
  CHECK(content(folder / "plain.txt") == "here");
}

TEST_CASE("writers of one folder do not meet") {
  Folder folder;
  std::vector<std::thread> writers;
  for (int k = 0; k < 8; ++k) {
    writers.emplace_back([&folder, k] {
      for (int i = 0; i < 50; ++i) {
        write_atomically(folder / ("own" + std::to_string(k)), std::string(3000, static_cast<char>('a' + k)));
        write_atomically(folder / "common", std::string(3000, static_cast<char>('a' + k)));
      }
    });
  }
  for (auto& writer : writers) writer.join();
  for (int k = 0; k < 8; ++k) {
    CHECK(content(folder / ("own" + std::to_string(k))) == std::string(3000, static_cast<char>('a' + k)));
  }
  const std::string common = content(folder / "common");
  REQUIRE(common.size() == 3000);
  CHECK(common == std::string(3000, common[0]));
  CHECK(folder.entries() == 9);
}

TEST_CASE("an error names the path and the reason") {
  Folder folder;
  const fs::path missing = folder / "no-such-folder/a.txt";
  const std::string no_folder = message_of([&] { write_atomically(missing, "x"); });
  CHECK(contains(no_folder, missing.string()));
  CHECK(contains(no_folder, std::strerror(ENOENT)));
  CHECK(!contains(no_folder, "\n"));

  fs::create_directory(folder / "taken");
  const std::string is_folder = message_of([&] { write_atomically(folder / "taken", "x"); });
  CHECK(contains(is_folder, (folder / "taken").string()));
  CHECK(contains(is_folder, std::strerror(EISDIR)));
  CHECK(folder.entries() == 1);
}

TEST_CASE("a committed file takes nothing more") {
  Folder folder;
  AtomicFile file(folder / "a.txt");
  file.write("done");
  file.commit();
  CHECK_THROWS_AS(file.write("more"), traceur::Error);
  CHECK_THROWS_AS(file.commit(), traceur::Error);
  CHECK(content(folder / "a.txt") == "done");
}

#if defined(__unix__)

TEST_CASE("a write that the system cuts short removes what there is") {
  Folder folder;
  write_atomically(folder / "a.txt", "old");
  rlimit before{};
  REQUIRE(getrlimit(RLIMIT_FSIZE, &before) == 0);
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);
  rlimit tight = before;
  tight.rlim_cur = 4096;
  REQUIRE(setrlimit(RLIMIT_FSIZE, &tight) == 0);
  const std::string message = message_of([&] { write_atomically(folder / "a.txt", std::string(1 << 20, 'x')); });
  setrlimit(RLIMIT_FSIZE, &before);
  std::signal(SIGXFSZ, handler);
  CHECK(contains(message, (folder / "a.txt").string()));
  CHECK(contains(message, std::strerror(EFBIG)));
  CHECK(content(folder / "a.txt") == "old");
  CHECK(folder.entries() == 1);
}

TEST_CASE("a link is followed and a device is not replaced") {
  Folder folder;
  write_atomically(folder / "real.txt", "old");
  fs::create_symlink("real.txt", folder / "link.txt");
  write_atomically(folder / "link.txt", "new");
  CHECK(fs::is_symlink(folder / "link.txt"));
  CHECK(content(folder / "real.txt") == "new");
  CHECK(folder.entries() == 2);

  fs::create_symlink("nowhere.txt", folder / "dangling.txt");
  CHECK_THROWS_AS(write_atomically(folder / "dangling.txt", "x"), traceur::Error);

  if (fs::is_character_file("/dev/null")) {
    write_atomically("/dev/null", "gone");
    CHECK(fs::is_character_file("/dev/null"));
  }
  if (fs::is_character_file("/dev/full")) {
    const std::string message = message_of([&] { write_atomically("/dev/full", "x"); });
    CHECK(contains(message, std::strerror(ENOSPC)));
    CHECK(fs::is_character_file("/dev/full"));
  }
}

#endif
