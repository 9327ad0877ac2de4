// SPDX-License-Identifier: MIT
#include "traceur/learn/mpi_group.hpp"

#include "../processes.hpp"

std::unique_ptr<traceur::learn::ProcessGroup> track::make_mpi_group() { return std::make_unique<traceur::learn::MpiGroup>(); }
