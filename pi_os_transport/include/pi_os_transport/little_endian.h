#pragma once

#include <cstddef>
#include <cstdint>

namespace pi_os_transport
{

/// Writes an unsigned number as sizeof(Number) bytes, the lowest byte first.
template <typename Number>
void storeLittleEndian(uint8_t* out, Number value)
{
  for (size_t byte = 0; byte < sizeof(Number); ++byte)
  {
    out[byte] = static_cast<uint8_t>(value >> (8 * byte));
  }
}

/// Reads what storeLittleEndian() wrote.
template <typename Number>
Number loadLittleEndian(const uint8_t* in)
{
  Number value = 0;
  for (size_t byte = 0; byte < sizeof(Number); ++byte)
  {
    value = static_cast<Number>(value | static_cast<Number>(in[byte]) << (8 * byte));
  }
  return value;
}

}  // namespace pi_os_transport
