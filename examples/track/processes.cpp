// SPDX-License-Identifier: MIT
#include "processes.hpp"

#include <cstdlib>

#include "traceur/core/error.hpp"
#include "traceur/learn/single_process.hpp"

namespace track {

std::unique_ptr<traceur::learn::ProcessGroup> find_processes() {
  // What Open MPI, MPICH and Slurm tell the processes that they start.
  for (const char* name : {"OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "PMIX_RANK"}) {
    if (std::getenv(name) == nullptr) continue;
#ifdef TRACK_WITH_MPI
    return make_mpi_group();
#else
    throw traceur::Error("started by mpirun, but built without MPI; install libopenmpi-dev (Debian, Ubuntu) and build again");
#endif
  }
  return std::make_unique<traceur::learn::SingleProcess>();
}

}  // namespace track
