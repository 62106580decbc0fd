#include "payload_pattern.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <ctime>
#include <stdexcept>

namespace pi_os_transport_bench
{
namespace
{
constexpr std::size_t BLOCK_SIZE = 64 * 1024;
constexpr std::size_t OFFSETS = 4096;  // distinct windows into the table, one word apart
constexpr std::size_t SAMPLES = 64;
constexpr std::size_t FULL_HD_RGB_SIZE = 1920UL * 1080UL * 3UL;

std::uint64_t mix(std::uint64_t x)  // the output function of splitmix64
{
  x += 0x9e3779b97f4a7c15ULL;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ULL;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebULL;
  return x ^ (x >> 31);
}

void requireSize(std::size_t size)
{
  if (size < MIN_PAYLOAD_SIZE)
  {
    throw std::invalid_argument("payload of " + std::to_string(size) + " bytes, must be at least " +
                                std::to_string(MIN_PAYLOAD_SIZE));
  }
}

std::int64_t clockNs(clockid_t clock)
{
  timespec now{};
  clock_gettime(clock, &now);
  return now.tv_sec * 1000000000LL + now.tv_nsec;
}
}  // namespace

PayloadPattern::PayloadPattern() : table_(BLOCK_SIZE / sizeof(std::uint64_t) + OFFSETS)
{
  for (std::size_t i = 0; i < table_.size(); ++i)
  {
    table_[i] = mix(i);
  }
}

const std::uint8_t* PayloadPattern::blockSource(std::uint64_t key, std::size_t block) const
{
  return reinterpret_cast<const std::uint8_t*>(table_.data() + mix(key * 0x10001ULL + block) % OFFSETS);
}

void PayloadPattern::fillBody(std::uint8_t* payload, std::size_t size, std::uint64_t key) const
{
  requireSize(size);
  for (std::size_t begin = sizeof(PayloadHeader), block = 0; begin < size; begin += BLOCK_SIZE, ++block)
  {
    std::memcpy(payload + begin, blockSource(key, block), std::min(BLOCK_SIZE, size - begin));
  }
}

std::optional<std::size_t> PayloadPattern::findWrongByte(const std::uint8_t* payload, std::size_t size,
                                                         std::uint64_t key) const
{
  requireSize(size);
  for (std::size_t begin = sizeof(PayloadHeader), block = 0; begin < size; begin += BLOCK_SIZE, ++block)
  {
    const std::uint8_t* source = blockSource(key, block);
    const std::size_t length = std::min(BLOCK_SIZE, size - begin);
    if (std::memcmp(payload + begin, source, length) != 0)
    {
      const auto wrong = std::mismatch(source, source + length, payload + begin);
      return begin + static_cast<std::size_t>(wrong.first - source);
    }
  }
  return std::nullopt;
}

std::optional<std::size_t> PayloadPattern::findWrongSample(const std::uint8_t* payload, std::size_t size,
                                                           std::uint64_t key, std::uint64_t sequence) const
{
  requireSize(size);
  const std::size_t positions = size - sizeof(PayloadHeader) - sizeof(std::uint64_t) + 1;
  for (std::size_t i = 0; i < SAMPLES + 2; ++i)
  {
    // Position in the body; a word that would cross into the next block is moved back to the end of its own.
    std::size_t position = i == 0 ? 0 : i == 1 ? positions - 1 : mix(sequence * SAMPLES + i) % positions;
    const std::size_t block = position / BLOCK_SIZE;
    position = std::min(position, (block + 1) * BLOCK_SIZE - sizeof(std::uint64_t));
    const std::uint8_t* expected = blockSource(key, block) + (position - block * BLOCK_SIZE);
    if (std::memcmp(payload + sizeof(PayloadHeader) + position, expected, sizeof(std::uint64_t)) != 0)
    {
      return sizeof(PayloadHeader) + position;
    }
  }
  return std::nullopt;
}

void shapeImage(sensor_msgs::Image* image, std::size_t size)
{
  requireSize(size);
  const bool full_hd = size == FULL_HD_RGB_SIZE;
  image->header.frame_id = "camera_optical";
  image->encoding = full_hd ? "rgb8" : "mono8";
  image->height = full_hd ? 1080 : 1;
  image->width = full_hd ? 1920 : static_cast<std::uint32_t>(size);
  image->step = static_cast<std::uint32_t>(size / image->height);
  image->is_bigendian = 0;
  image->data.resize(size);
}

std::optional<std::string> findWrongField(const sensor_msgs::Image& image, std::size_t size)
{
  const bool full_hd = size == FULL_HD_RGB_SIZE;
  const auto differs = [](const std::string& field, const auto& is, const auto& expected)
  { return std::make_optional("field " + field + " is " + is + ", expected " + expected); };
  if (image.data.size() != size)
  {
    return differs("data.size", std::to_string(image.data.size()), std::to_string(size));
  }
  if (image.header.frame_id != "camera_optical")
  {
    return differs("header.frame_id", image.header.frame_id, "camera_optical");
  }
  if (image.encoding != (full_hd ? "rgb8" : "mono8"))
  {
    return differs("encoding", image.encoding, full_hd ? "rgb8" : "mono8");
  }
  if (image.height != (full_hd ? 1080U : 1U))
  {
    return differs("height", std::to_string(image.height), full_hd ? "1080" : "1");
  }
  if (static_cast<std::size_t>(image.step) * image.height != size)
  {
    return differs("step", std::to_string(image.step), std::to_string(size / image.height));
  }
  return std::nullopt;
}

std::int64_t monotonicNs()
{
  return clockNs(CLOCK_MONOTONIC);
}
std::int64_t threadCpuNs()
{
  return clockNs(CLOCK_THREAD_CPUTIME_ID);
}

void sleepUntil(std::int64_t monotonic_ns)
{
  const timespec wake{monotonic_ns / 1000000000LL, monotonic_ns % 1000000000LL};
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &wake, nullptr) == EINTR)
  {
  }
}

}  // namespace pi_os_transport_bench
