// SPDX-License-Identifier: MIT
#include <traceur/motion/repeats.hpp>

#include <doctest/doctest.h>

#include "figure.hpp"

using namespace traceur;
using namespace figure;
using motion::Clip;

namespace {

/// The biped's root moves on by 0.1 m from key to key, 30 keys a second; each key is shown `times` times.
Clip stepping(int keys, int times) {
  Clip clip;
  clip.name = "stepping";
  clip.skeleton = biped();
  clip.times = Vec::LinSpaced(keys * times, 0, (keys * times - 1) / (30.0 * times));
  clip.poses.resize(clip.skeleton.nq(), keys * times);
  clip.contacts.resize(clip.skeleton.size(), keys * times);
  for (int k = 0; k < keys * times; ++k) {
    clip.poses.col(k) = clip.skeleton.neutral_pose();
    clip.poses(0, k) = 0.1 * (k / times);
    clip.contacts.col(k).setConstant(0.01 * (k / times));
  }
  clip.check();
  return clip;
}

}  // namespace

TEST_CASE("of keys shown twice one stays, at the time it was first shown") {
  for (const int times : {2, 3, 4}) {
    Clip clip = stepping(12, times);
    CHECK(motion::drop_repeats(clip) == 12 * (times - 1));
    REQUIRE(clip.keys() == 12);
    clip.check();
    for (int k = 0; k < 12; ++k) {
      CHECK(clip.times[k] == doctest::Approx(k / 30.0));
      CHECK(clip.poses(0, k) == 0.1 * k);
      CHECK(clip.contacts(2, k) == 0.01 * k);
    }
    // Between keys the motion now goes on evenly.
    CHECK(clip.velocity(0.1)[0] == doctest::Approx(3));
  }
}

TEST_CASE("a clip without labels, and one whose last key is alone, are mended too") {
  Clip clip = stepping(9, 2);
  clip.contacts.resize(0, 0);
  clip.times.conservativeResize(17);
  clip.poses.conservativeResize(Eigen::NoChange, 17);
  CHECK(motion::drop_repeats(clip) == 8);
  CHECK(clip.duration() == doctest::Approx(8 / 30.0));
  clip.check();
}

TEST_CASE("a motion that holds still now and then, or always, is left alone") {
  const auto unchanged = [](Clip clip) {
    const Clip before = clip;
    CHECK(motion::drop_repeats(clip) == 0);
    CHECK(clip.times == before.times);
    CHECK(clip.poses == before.poses);
  };
  unchanged(stepping(20, 1));
  unchanged(stepping(5, 5));   // held for five keys
  unchanged(stepping(1, 4));   // never moves
  Clip rare = stepping(20, 1);
  for (const int k : {3, 9, 14}) rare.poses.col(k) = rare.poses.col(k - 1);
  unchanged(rare);
}
