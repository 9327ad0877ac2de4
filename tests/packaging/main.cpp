// SPDX-License-Identifier: MIT
#include <traceur/core/version.hpp>

int main() { return traceur::core::version_string == TRACEUR_EXPECTED_VERSION ? 0 : 1; }
