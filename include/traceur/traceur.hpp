// SPDX-License-Identifier: MIT
// Everything that needs no library but Eigen, in the order of the alphabet; a test keeps the list whole.
#pragma once

#include <traceur/body/character.hpp>
#include <traceur/body/kinematics.hpp>
#include <traceur/body/momentum.hpp>
#include <traceur/body/pose.hpp>
#include <traceur/body/skeleton.hpp>
#include <traceur/core/error.hpp>
#include <traceur/core/executor.hpp>
#include <traceur/core/matrix3.hpp>
#include <traceur/core/pack.hpp>
#include <traceur/core/random.hpp>
#include <traceur/core/rotation.hpp>
#include <traceur/core/scalar.hpp>
#include <traceur/core/vector3.hpp>
#include <traceur/core/version.hpp>
#include <traceur/io/atomic_file.hpp>
#include <traceur/io/replay.hpp>
#include <traceur/motion/clip.hpp>
#include <traceur/optimize/cma_es.hpp>
#include <traceur/optimize/objective.hpp>
#include <traceur/sim/dynamics.hpp>
#include <traceur/sim/model.hpp>
#include <traceur/sim/parameters.hpp>
