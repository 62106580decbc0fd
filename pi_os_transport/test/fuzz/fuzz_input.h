#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>
#include <vector>

/// What a fuzz target does with one input; libFuzzer calls it, and so does replay.cpp. Never throws.
extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size);

namespace pi_os_transport
{

/// Takes an input apart. Past the end come zeroes.
class FuzzInput
{
public:
  FuzzInput(const uint8_t* data, size_t size) : data_(data), size_(size) {}

  template <typename Number>
  Number take()
  {
    Number number{};
    const size_t count = std::min(sizeof(number), size_);
    if (count > 0)
    {
      std::memcpy(&number, data_, count);
    }
    skip(count);
    return number;
  }
  /// A number below `end`.
  uint32_t below(uint32_t end) { return take<uint8_t>() % end; }
  std::vector<uint8_t> bytes(size_t most)
  {
    const size_t count = std::min(most, size_);
    const std::vector<uint8_t> taken(data_, data_ + count);
    skip(count);
    return taken;
  }
  std::vector<uint8_t> rest() { return bytes(size_); }
  bool empty() const { return size_ == 0; }

private:
  void skip(size_t count)
  {
    data_ += count;
    size_ -= count;
  }

  const uint8_t* data_;
  size_t size_;
};

/// Ends the program: what must always hold does not.
inline void require(bool condition, const char* what)
{
  if (!condition)
  {
    std::fprintf(stderr, "violated: %s\n", what);
    std::abort();
  }
}

/// The sum of all bytes: each is read.
inline uint32_t sumOf(const uint8_t* bytes, size_t count)
{
  uint32_t sum = 0;
  for (size_t i = 0; i < count; ++i)
  {
    sum += bytes[i];
  }
  return sum;
}

}  // namespace pi_os_transport
