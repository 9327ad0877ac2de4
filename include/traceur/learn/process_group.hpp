// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstring>
#include <span>
#include <type_traits>

namespace traceur::learn {

/// Processes that do the same work side by side and tell each other what they found: MPI ranks, or one process alone. All
/// of them make the same calls in the same order.
class ProcessGroup {
 public:
  ProcessGroup() = default;
  ProcessGroup(const ProcessGroup&) = delete;
  ProcessGroup& operator=(const ProcessGroup&) = delete;
  virtual ~ProcessGroup() = default;

  /// Which of them this is, 0 <= rank < size.
  virtual int rank() const noexcept = 0;
  virtual int size() const noexcept = 0;
  /// Copies the memory of process `root` to all others. Throws Error when that fails.
  virtual void broadcast(int root, std::span<std::byte> memory) = 0;
  /// Ends all processes at once: for a fault that the others do not know of.
  [[noreturn]] virtual void abort(int status) = 0;
};

/// What process 0 says.
template <class T>
  requires std::is_trivially_copyable_v<T>
T agreed(ProcessGroup& group, T mine) {
  group.broadcast(0, std::as_writable_bytes(std::span<T>(&mine, 1)));
  return mine;
}

}  // namespace traceur::learn
