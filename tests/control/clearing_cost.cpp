// SPDX-License-Identifier: MIT
#include <traceur/control/clearing_cost.hpp>

#include <doctest/doctest.h>

using namespace traceur::control;
using Vector = traceur::core::Vector3<double>;

TEST_CASE("a foot below the step costs by how much it is, one above costs nothing") {
  CHECK(jump_contact_cost(0.4, 0.3) == doctest::Approx(0.1));
  CHECK(jump_contact_cost(0.4, 0.4) == 0);
  CHECK(jump_contact_cost(0.4, 0.9) == 0);
}

TEST_CASE("a vault as it should be costs nothing, and each term of Eq. 11 counts by its weight") {
  VaultRecord r;
  r.left_foot = r.right_foot = 1.0;
  r.hand = 0.8;
  r.landing = r.landing_reference = {0.1, 0.2, 0.9};
  r.support = r.support_reference = {0.3, 0.1, 0.2};
  const VaultWeights w{2, 3, 5, 7};
  CHECK(vault_contact_cost(r, 0.8, 0.95, w) == 0);
  VaultRecord x = r;
  x.left_foot = 0.85;
  CHECK(vault_contact_cost(x, 0.8, 0.95, w) == doctest::Approx(2 * 0.1));
  x.right_foot = 0.75;
  CHECK(vault_contact_cost(x, 0.8, 0.95, w) == doctest::Approx(2 * (0.1 + 0.2)));
  x = r;
  x.landing.x += 0.3;
  x.landing.z -= 0.4;
  CHECK(vault_contact_cost(x, 0.8, 0.95, w) == doctest::Approx(3 * 0.5));
  x = r;
  x.hand = 0.7;
  x.hand_off_middle = 0.2;
  CHECK(vault_contact_cost(x, 0.8, 0.95, w) == doctest::Approx(5 * 0.3));
  x = r;
  x.support.y += 0.1;
  CHECK(vault_contact_cost(x, 0.8, 0.95, w) == doctest::Approx(7 * 0.1));
}

TEST_CASE("a drop-roll's balance adds momentum and feet") {
  DropRollRecord r;
  CHECK(drop_roll_balance_cost(r) == 0);
  r.momentum = {3, 0, 4};
  r.left = {0, 0.1, 0};
  r.right = {0.2, 0, 0};
  r.stance = {0, 0, -0.3};
  CHECK(drop_roll_balance_cost(r, 0.1, 2) == doctest::Approx(0.5 + 2 * 0.6));
}

TEST_CASE("Eq. 10 weighs contact, balance and pose") {
  const ClearingWeights w{10, 2, 3, 0.5};
  CHECK(clearing_cost(0.1, 0.2, {0.4, 0.3, 0.2}, w) == doctest::Approx(1 + 0.4 + 3 * (0.2 + 0.5)));
  CHECK(balance_cost(Vector{0.3, 0, 0}, Vector{0, 0.4, 0}) == doctest::Approx(0.5));
}
