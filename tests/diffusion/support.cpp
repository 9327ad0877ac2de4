// SPDX-License-Identifier: MIT
// The counting of allocations that tests/nn has, in this program too.
#include "../nn/allocations.cpp"
