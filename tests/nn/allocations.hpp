// SPDX-License-Identifier: MIT
#pragma once

/// How often memory was taken from the heap so far. Counted in allocations.cpp where the C library lets us: elsewhere,
/// and under sanitizers, it stays 0.
long allocations() noexcept;
/// Whether `allocations` counts.
bool counts_allocations() noexcept;
