// SPDX-License-Identifier: MIT
#pragma once

#include <memory>

#include "traceur/core/executor.hpp"
#include "traceur/learn/group_executor.hpp"

namespace track {

/// The processes that mpirun started this program in, or this one alone where it was started without, or built without MPI.
std::unique_ptr<traceur::learn::ProcessGroup> find_processes();

/// Built where there is MPI.
std::unique_ptr<traceur::learn::ProcessGroup> make_mpi_group();

using Executor = traceur::learn::GroupExecutor<traceur::core::ThreadExecutor>;

}  // namespace track
