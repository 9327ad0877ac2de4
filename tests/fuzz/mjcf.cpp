// SPDX-License-Identifier: MIT
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string>
#include <string_view>

#include <traceur/io/mjcf.hpp>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  try {
    const traceur::body::Character c =
        traceur::io::parse_mjcf(std::string_view(reinterpret_cast<const char*>(data), size), "fuzz");
    // What is accepted can be moved: finite frames at rest.
    traceur::body::Frames<double> frames(c.skeleton);
    const Eigen::VectorXd q = c.skeleton.neutral_pose();
    traceur::body::forward_kinematics(c.skeleton, q.data(), frames);
    for (const auto& p : frames.position)
      if (!std::isfinite(p.x + p.y + p.z)) std::abort();
  } catch (const traceur::Error& error) {
    if (std::string_view(error.what()).find('\n') != std::string_view::npos) std::abort();
  }
  return 0;
}
