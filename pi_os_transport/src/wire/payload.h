#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace pi_os_transport
{

/// Appends numbers and strings to a payload.
class PayloadWriter
{
public:
  void putU16(uint16_t value);
  void putU32(uint32_t value);
  void putU64(uint64_t value);
  void putString(std::string_view text);  ///< truncated to 65535 bytes
  const std::vector<uint8_t>& bytes() const { return bytes_; }
  std::vector<uint8_t> take() { return std::move(bytes_); }

private:
  std::vector<uint8_t> bytes_;
};

/// Reads what a PayloadWriter wrote. Reading past the end returns zeroes and empty strings, and makes ok() false.
class PayloadReader
{
public:
  PayloadReader(const uint8_t* bytes, size_t length) : next_(bytes), end_(bytes + length) {}
  uint16_t getU16();
  uint32_t getU32();
  uint64_t getU64();
  std::string getString();
  void skip(size_t bytes) { take(bytes); }
  bool ok() const { return ok_; }
  const uint8_t* rest() const { return next_; }
  size_t restLength() const { return static_cast<size_t>(end_ - next_); }

private:
  const uint8_t* take(size_t bytes);

  const uint8_t* next_;
  const uint8_t* end_;
  bool ok_ = true;
};

}  // namespace pi_os_transport
