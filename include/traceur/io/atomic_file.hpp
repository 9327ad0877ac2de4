// SPDX-License-Identifier: MIT
#pragma once

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <string>
#include <string_view>
#include <system_error>
#include <utility>

#include <traceur/core/error.hpp>

namespace traceur::io {

/// A file that is complete or absent. The bytes go to a temporary file in the folder of `path`; `commit()` flushes,
/// checks and renames it to `path`, which replaces an older file in one step. Until then, and for ever if anything
/// fails, `path` is what it was before; the temporary is removed by the destructor or before an error is thrown.
///
/// The data is handed to the operating system but not forced onto the disk: a reader never sees half a file, a power
/// cut may lose the newest one.
///
/// A symbolic link is followed. What exists and is neither a file nor a folder (a terminal, a pipe, a null device) is
/// written directly, since replacing it by a file would destroy it.
///
/// Every failure throws traceur::Error with the path and the system's reason.
class AtomicFile {
public:
  explicit AtomicFile(std::filesystem::path path) : path_(std::move(path)), target_(path_) {
    std::error_code failure;
    if (std::filesystem::is_symlink(path_, failure)) {
      target_ = std::filesystem::canonical(path_, failure);
      if (failure) fail(failure.message());
    }
    const auto status = std::filesystem::status(target_, failure);
    // Renaming onto a folder would fail too, but only after all was written.
    if (std::filesystem::is_directory(status)) fail(std::strerror(EISDIR));
    if (std::filesystem::exists(status) && !std::filesystem::is_regular_file(status)) {
      file_ = std::fopen(target_.string().c_str(), "wb");
      if (!file_) fail(std::strerror(errno));
      return;
    }
    // The name is short whatever the target's length, and exclusive creation keeps two writers apart.
    for (int attempt = 0; attempt < 1000 && !file_; ++attempt) {
      temporary_ = target_.parent_path() / (".traceur-" + std::to_string(attempt) + ".part");
      file_ = std::fopen(temporary_.string().c_str(), "wbx");
      if (!file_ && errno != EEXIST) {
        const int reason = errno;
        temporary_.clear();
        fail(std::strerror(reason));
      }
    }
    if (!file_) {
      temporary_.clear();
      fail("the folder is full of unfinished files named .traceur-*.part");
    }
  }

  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;
  ~AtomicFile() { discard(); }

  /// Appends bytes. Not to be called after `commit()`.
  void write(std::string_view bytes) {
    if (!file_) fail("written to after it was closed");
    if (std::fwrite(bytes.data(), 1, bytes.size(), file_) != bytes.size()) fail(std::strerror(errno));
  }

  /// Puts the file in its place. To be called once, last; without it the destructor drops all that was written.
  void commit() {
    if (!file_) fail("closed twice");
    if (std::fflush(file_) != 0) fail(std::strerror(errno));
    // The stream is gone after fclose even where it fails.
    if (std::fclose(std::exchange(file_, nullptr)) != 0) fail(std::strerror(errno));
    if (temporary_.empty()) return;
    std::error_code failure;
    std::filesystem::rename(temporary_, target_, failure);
    if (failure) fail(failure.message());
    temporary_.clear();
  }

private:
  void discard() noexcept {
    if (file_) std::fclose(std::exchange(file_, nullptr));
    if (temporary_.empty()) return;
    std::error_code ignored;
    std::filesystem::remove(temporary_, ignored);
    temporary_.clear();
  }

  [[noreturn]] void fail(const std::string& reason) {
    discard();
    throw Error(path_.string() + ": cannot write: " + reason);
  }

  std::filesystem::path path_;
  std::filesystem::path target_;
  std::filesystem::path temporary_;  // empty: nothing to rename or remove
  std::FILE* file_ = nullptr;
};

/// Writes all of `bytes` to `path`, or throws traceur::Error and leaves `path` as it was.
inline void write_atomically(const std::filesystem::path& path, std::string_view bytes) {
  AtomicFile file(path);
  file.write(bytes);
  file.commit();
}

}  // namespace traceur::io
