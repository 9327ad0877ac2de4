// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <climits>
#include <cstdlib>
#include <string>

#include <mpi.h>

#include "traceur/core/error.hpp"
#include "traceur/learn/process_group.hpp"

namespace traceur::learn {

/// The processes that `mpirun` started, as a group. One object a process, made and used on its main thread; the first begins
/// MPI and its end is MPI's, unless the program has begun it before.
class MpiGroup final : public ProcessGroup {
 public:
  /// Throws Error when MPI cannot begin.
  MpiGroup() {
    int begun = 0;
    check(MPI_Initialized(&begun), "MPI_Initialized");
    if (begun == 0) {
      int provided = 0;
      check(MPI_Init_thread(nullptr, nullptr, MPI_THREAD_FUNNELED, &provided), "MPI_Init_thread");
      owner_ = true;
    }
    check(MPI_Comm_dup(MPI_COMM_WORLD, &all_), "MPI_Comm_dup");
    check(MPI_Comm_set_errhandler(all_, MPI_ERRORS_RETURN), "MPI_Comm_set_errhandler");
    check(MPI_Comm_rank(all_, &rank_), "MPI_Comm_rank");
    check(MPI_Comm_size(all_, &size_), "MPI_Comm_size");
  }
  ~MpiGroup() override {
    MPI_Comm_free(&all_);
    if (owner_) MPI_Finalize();
  }

  int rank() const noexcept override { return rank_; }
  int size() const noexcept override { return size_; }
  void broadcast(int root, std::span<std::byte> memory) override {
    constexpr std::size_t most = INT_MAX;
    for (std::size_t from = 0; from < memory.size(); from += most)
      check(MPI_Bcast(memory.data() + from, static_cast<int>(std::min(most, memory.size() - from)), MPI_BYTE, root, all_), "MPI_Bcast");
  }
  [[noreturn]] void abort(int status) override {
    MPI_Abort(all_, status);
    std::abort();
  }

 private:
  static void check(int status, const char* call) {
    if (status != MPI_SUCCESS) throw Error(std::string("mpi: ") + call + " failed with code " + std::to_string(status));
  }

  MPI_Comm all_ = MPI_COMM_NULL;
  int rank_ = 0, size_ = 1;
  bool owner_ = false;
};

}  // namespace traceur::learn
