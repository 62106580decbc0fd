#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "pi_os_transport/little_endian.h"

namespace pi_os_transport
{

/// Appends numbers and strings to a payload.
class PayloadWriter
{
public:
  void putU16(uint16_t value) { put(value); }
  void putU32(uint32_t value) { put(value); }
  void putU64(uint64_t value) { put(value); }
  void putString(std::string_view text);  ///< truncated to 65535 bytes
  const std::vector<uint8_t>& bytes() const { return bytes_; }
  std::vector<uint8_t> take() { return std::move(bytes_); }

private:
  template <typename Number>
  void put(Number value)
  {
    bytes_.resize(bytes_.size() + sizeof(Number));
    storeLittleEndian(bytes_.data() + bytes_.size() - sizeof(Number), value);
  }

  std::vector<uint8_t> bytes_;
};

/// Reads what a PayloadWriter wrote. Reading past the end returns zeroes and empty strings, and makes ok() false.
class PayloadReader
{
public:
  PayloadReader(const uint8_t* bytes, size_t length) : next_(bytes), end_(bytes + length) {}
  uint16_t getU16() { return get<uint16_t>(); }
  uint32_t getU32() { return get<uint32_t>(); }
  uint64_t getU64() { return get<uint64_t>(); }
  std::string getString();
  void skip(size_t bytes) { take(bytes); }
  bool ok() const { return ok_; }
  const uint8_t* rest() const { return next_; }
  size_t restLength() const { return static_cast<size_t>(end_ - next_); }

private:
  const uint8_t* take(size_t bytes);
  template <typename Number>
  Number get()
  {
    const uint8_t* const bytes = take(sizeof(Number));
    return bytes != nullptr ? loadLittleEndian<Number>(bytes) : Number{0};
  }

  const uint8_t* next_;
  const uint8_t* end_;
  bool ok_ = true;
};

}  // namespace pi_os_transport
