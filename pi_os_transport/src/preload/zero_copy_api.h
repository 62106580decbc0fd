#pragma once

// What libpi_os_transport_zero_copy.so uses of the companion, through the preloaded library. Nodes link the former; the
// latter may be absent.

#include <stddef.h>
#include <stdint.h>

#define PI_OS_ZERO_COPY_VERSION 1

/// All functions may be called from any thread. In a forked child they do nothing.
struct PiOsZeroCopyApi
{
  uint32_t version;  ///< PI_OS_ZERO_COPY_VERSION

  /// Memory in the pool with one reference; null if no subscriber uses shared memory, or the pool is full.
  /// @param capacity  set to the usable size, at least `bytes` [B].
  uint8_t* (*allocate)(size_t bytes, size_t* capacity);
  /// Lets the message, with its length in front, start at `message`. From now on use `message` in place of `memory`.
  void (*place)(uint8_t* memory, uint8_t* message);
  void (*release)(const uint8_t* memory);

  /// From now on hold() finds received messages.
  void (*expect_holds)();
  /// Keeps the received message at `message` (behind its length) until let_go(). Null if there is no such message.
  void* (*hold)(const uint8_t* message);
  void (*let_go)(void* hold);
};

/// The preloaded library's symbol. Null if the library is inactive in this process, or of another version.
extern "C" const PiOsZeroCopyApi* pi_os_transport_zero_copy(uint32_t version);
