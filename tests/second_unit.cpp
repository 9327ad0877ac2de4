// SPDX-License-Identifier: MIT
// Linked into every test program: a function in a header that lacks `inline` is then defined twice, and does not link.
#include <traceur/traceur.hpp>
