#pragma once

// What libpi_os_transport_zero_copy.so asks of the companion, by way of the preloaded library: nodes link the former,
// whether or not there is the latter.

#include <stddef.h>
#include <stdint.h>

#define PI_OS_ZERO_COPY_VERSION 1

/// All functions may be called from any thread, and in a forked child, where they do nothing.
struct PiOsZeroCopyApi
{
  uint32_t version;  ///< PI_OS_ZERO_COPY_VERSION

  /// Memory in the pool with one reference; null if no subscriber is in shared memory, or there is none.
  /// @param capacity  set to the bytes that may be used, at least `bytes` [B].
  uint8_t* (*allocate)(size_t bytes, size_t* capacity);
  /// Lets the message with its length in front start at `message`, which then stands for `memory`.
  void (*place)(uint8_t* memory, uint8_t* message);
  void (*release)(const uint8_t* memory);

  /// From now on hold() finds the messages that this process receives.
  void (*expect_holds)();
  /// Keeps the received message that starts at `message`, behind its length, until let_go(). Null if it is none.
  void* (*hold)(const uint8_t* message);
  void (*let_go)(void* hold);
};

/// The preloaded library's symbol. Null if the library stands aside in this process, or is of another version.
extern "C" const PiOsZeroCopyApi* pi_os_transport_zero_copy(uint32_t version);
