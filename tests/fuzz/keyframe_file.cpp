// SPDX-License-Identifier: MIT
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include <traceur/io/keyframe_file.hpp>

namespace {

/// A trunk that moves freely, a thigh on a ball joint and a shin on a hinge.
traceur::body::Skeleton leg() {
  traceur::body::Joint trunk, thigh, shin;
  trunk.name = trunk.body = "trunk";
  trunk.type = traceur::body::JointType::free;
  thigh.name = thigh.body = "thigh";
  thigh.type = traceur::body::JointType::ball;
  thigh.parent = 0;
  shin.name = shin.body = "shin";
  shin.type = traceur::body::JointType::hinge;
  shin.parent = 1;
  shin.offset = {0, 0, -0.4};
  shin.axis = {0, 1, 0};
  traceur::body::Skeleton s;
  for (const traceur::body::Joint& j : {trunk, thigh, shin}) s.add(j);
  return s;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const traceur::body::Skeleton skeleton = leg();
  try {
    traceur::io::keyframes_from_text(std::string_view(reinterpret_cast<const char*>(data), size), skeleton, "fuzz").check();
  } catch (const traceur::Error& error) {
    if (std::string_view(error.what()).find('\n') != std::string_view::npos) std::abort();
  }
  return 0;
}
