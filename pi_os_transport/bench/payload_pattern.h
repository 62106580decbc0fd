#pragma once

#include <sensor_msgs/Image.h>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace pi_os_transport_bench
{
/// First bytes of every payload; the rest is the pattern that `key` selects. Fields in the byte order of the machine.
struct PayloadHeader
{
  std::uint64_t sequence;   ///< 0 for the first message of the process, then strictly + 1
  std::int64_t publish_ns;  ///< CLOCK_MONOTONIC immediately before publish() [ns]
  std::uint64_t size;       ///< bytes of the whole payload, this header included
  std::uint64_t key;        ///< sequence modulo the period that both sides were told
};

/// Queue size of every data topic: above every window, so that nothing may be dropped [messages].
constexpr std::uint32_t QUEUE_SIZE = 1024;

/// Smallest payload that can be filled and checked [bytes].
constexpr std::size_t MIN_PAYLOAD_SIZE = sizeof(PayloadHeader) + sizeof(std::uint64_t);

/// Contents that depend on the position and on the message, at the cost of one memcpy to fill and one memcmp to check.
///
/// The body is cut into blocks; each block is a window into one table of random words, at an offset derived from key
/// and block number. A stale, shifted, torn or mixed-up block therefore differs from what is expected there, and the
/// table stays in the second-level cache. Immutable after construction, so it may be shared by threads.
class PayloadPattern
{
public:
  PayloadPattern();

  /// Writes the body for `key` behind the header of a payload of `size` bytes; the header is left untouched.
  /// @throws std::invalid_argument if size < MIN_PAYLOAD_SIZE.
  void fillBody(std::uint8_t* payload, std::size_t size, std::uint64_t key) const;

  /// Compares every byte of the body.
  /// @return position in the payload of the first byte of the first wrong 64-bit word, or nothing if all is right.
  std::optional<std::size_t> findWrongByte(const std::uint8_t* payload, std::size_t size, std::uint64_t key) const;

  /// Compares the first, the last and up to 64 words at positions that depend on `sequence`.
  /// @return as findWrongByte().
  std::optional<std::size_t> findWrongSample(const std::uint8_t* payload, std::size_t size, std::uint64_t key,
                                             std::uint64_t sequence) const;

private:
  const std::uint8_t* blockSource(std::uint64_t key, std::size_t block) const;

  std::vector<std::uint64_t> table_;
};

/// Gives `image` the shape that stands for `size` bytes: 1920x1080 rgb8 where that fits, else one row of mono8.
/// The data is resized, its contents are unspecified.
void shapeImage(sensor_msgs::Image* image, std::size_t size);

/// @return what differs from shapeImage(size) in the fields around the data, or nothing.
std::optional<std::string> findWrongField(const sensor_msgs::Image& image, std::size_t size);

std::int64_t monotonicNs();                  ///< CLOCK_MONOTONIC [ns]
std::int64_t threadCpuNs();                  ///< CPU time of the calling thread [ns]
void sleepUntil(std::int64_t monotonic_ns);  ///< returns at once if that time has passed

}  // namespace pi_os_transport_bench
