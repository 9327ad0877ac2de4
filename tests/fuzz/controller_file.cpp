// SPDX-License-Identifier: MIT
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string>
#include <string_view>

#include "../control/biped.hpp"
#include <traceur/io/controller_file.hpp>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const traceur::sim::Model model = traceur::sim::make_model(figures::biped());
  static const traceur::control::Roles roles = traceur::control::find_roles(model);
  try {
    const auto c = traceur::io::parse_controller(std::string(reinterpret_cast<const char*>(data), size), "fuzz", model, roles);
    // What is accepted can be run: one entry for each tick, laws for each phase. It comes back bit for bit.
    const auto ticks = static_cast<std::size_t>(c.ticks());
    if (ticks == 0 || c.stance.size() != ticks || c.phase.size() != ticks || c.law.size() != c.shape.size()) std::abort();
    if (c.reference.ticks != c.ticks() || c.sensory.cols() != c.ticks()) std::abort();
    for (const int phase : c.phase)
      if (phase < 0 || phase >= c.shape.phases) std::abort();
    const std::string written = traceur::io::controller_text(c);
    if (traceur::io::controller_text(traceur::io::parse_controller(written, "again", model, roles)) != written) std::abort();
  } catch (const traceur::Error& error) {
    if (std::string_view(error.what()).find('\n') != std::string_view::npos) std::abort();
  }
  return 0;
}
