// SPDX-License-Identifier: MIT
#pragma once

#include <cstdlib>

#include "traceur/learn/process_group.hpp"

namespace traceur::learn {

/// One process alone.
class SingleProcess final : public ProcessGroup {
 public:
  int rank() const noexcept override { return 0; }
  int size() const noexcept override { return 1; }
  void broadcast(int, std::span<std::byte>) override {}
  [[noreturn]] void abort(int status) override { std::exit(status); }
};

}  // namespace traceur::learn
