#pragma once

#include <algorithm>
#include <cstdint>
#include <cstring>

// Content of a message is a function of (publisher id, sequence number), so a receiver judges it without a copy.

inline uint64_t patternWord(uint32_t id, uint64_t seq, uint64_t index)
{
  return ((static_cast<uint64_t>(id) << 40) + (seq << 20) + index + 1) * 0x9E3779B97F4A7C15ull;
}

inline void fillPattern(uint32_t id, uint64_t seq, uint8_t* data, size_t bytes)
{
  const size_t words = bytes / 8;
  for (size_t i = 0; i < words; ++i)
  {
    const uint64_t word = patternWord(id, seq, i);
    std::memcpy(data + 8 * i, &word, 8);
  }
  const uint64_t tail = patternWord(id, seq, words);
  std::copy_n(reinterpret_cast<const uint8_t*>(&tail), bytes % 8, data + 8 * words);
}

inline bool checkPattern(uint32_t id, uint64_t seq, const uint8_t* data, size_t bytes)
{
  const size_t words = bytes / 8;
  uint64_t difference = 0;
  for (size_t i = 0; i < words; ++i)
  {
    uint64_t word;
    std::memcpy(&word, data + 8 * i, 8);
    difference |= word ^ patternWord(id, seq, i);
  }
  const uint64_t tail = patternWord(id, seq, words);
  return difference == 0 && std::equal(data + 8 * words, data + bytes, reinterpret_cast<const uint8_t*>(&tail));
}

/// An image, of either API, of the publisher `id` with the number `seq`.
template <class Image>
void fillImage(uint32_t id, uint64_t seq, size_t bytes, Image* image)
{
  image->header.frame_id = "pi_os_test";
  image->height = id;
  image->width = static_cast<uint32_t>(seq);
  image->step = static_cast<uint32_t>(bytes);
  image->encoding = "8UC1";
  image->data.resize(bytes);
  fillPattern(id, seq, image->data.data(), bytes);
}

/// True if `image` is as fillImage made it, with the id and the number that it names.
template <class Image>
bool isIntact(const Image& image)
{
  return image.step == image.data.size() && image.encoding == "8UC1" && image.header.frame_id == "pi_os_test" &&
         checkPattern(image.height, image.width, image.data.data(), image.data.size());
}
