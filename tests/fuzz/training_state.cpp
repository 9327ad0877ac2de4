// SPDX-License-Identifier: MIT
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string>
#include <string_view>

#include <traceur/io/adversarial_file.hpp>
#include <traceur/io/policy_file.hpp>
#include <traceur/io/ppo_file.hpp>

namespace {

namespace io = traceur::io;

/// What `get` accepts, `add` writes, and it is then the same. Any Error has one line.
template <class Get, class Add>
void round_trip(const io::Safetensors& file, Get&& get, Add&& add) {
  const auto bytes = [&](const io::Safetensors& from) {
    io::Safetensors to("again");
    add(to, get(from));
    return io::safetensors_bytes(to);
  };
  try {
    const std::string written = bytes(file);
    if (bytes(io::parse_safetensors(written, "again")) != written) std::abort();
  } catch (const traceur::Error& error) {
    if (std::string_view(error.what()).find('\n') != std::string_view::npos) std::abort();
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  try {
    const io::Safetensors file = io::parse_safetensors(std::string_view(reinterpret_cast<const char*>(data), size), "fuzz");
    round_trip(file, [](const io::Safetensors& f) { return io::get_ppo_state(f); },
               [](io::Safetensors& to, const auto& s) { io::add_ppo_state(to, s); });
    round_trip(file, [](const io::Safetensors& f) { return io::get_adversarial_state(f); },
               [](io::Safetensors& to, const auto& s) { io::add_adversarial_state(to, s); });
    round_trip(file, [](const io::Safetensors& f) { return io::get_policy(f); },
               [](io::Safetensors& to, const auto& s) { io::add_policy(to, s); });
  } catch (const traceur::Error&) {
  }
  return 0;
}
