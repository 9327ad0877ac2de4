// SPDX-License-Identifier: MIT
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string>
#include <string_view>

#include <traceur/io/safetensors.hpp>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  try {
    const traceur::io::Safetensors file =
        traceur::io::parse_safetensors(std::string_view(reinterpret_cast<const char*>(data), size), "fuzz");
    // Every tensor has the bytes its type and shape ask for, all of them together no more than there were.
    std::size_t bytes = 0;
    for (const traceur::io::Tensor& tensor : file.tensors()) {
      bytes += tensor.bytes.size();
      if (tensor.type == "F64" && file.values<double>(tensor.name).size() * 8 != tensor.bytes.size()) std::abort();
      if (tensor.type == "F32" && file.values<float>(tensor.name).size() * 4 != tensor.bytes.size()) std::abort();
    }
    if (bytes > size) std::abort();
    // What was read can be written, and is then the same.
    const std::string written = traceur::io::safetensors_bytes(file);
    if (traceur::io::safetensors_bytes(traceur::io::parse_safetensors(written, "again")) != written) std::abort();
    file.check_finite();
  } catch (const traceur::Error& error) {
    if (std::string_view(error.what()).find('\n') != std::string_view::npos) std::abort();
  }
  return 0;
}
