#include "wire/payload.h"

#include <algorithm>
#include <limits>

#include "pi_os_transport/little_endian.h"

namespace pi_os_transport
{
namespace
{

template <typename Number>
void append(std::vector<uint8_t>* out, Number value)
{
  out->resize(out->size() + sizeof(Number));
  storeLittleEndian(out->data() + out->size() - sizeof(Number), value);
}

}  // namespace

void PayloadWriter::putU16(uint16_t value)
{
  append(&bytes_, value);
}

void PayloadWriter::putU32(uint32_t value)
{
  append(&bytes_, value);
}

void PayloadWriter::putU64(uint64_t value)
{
  append(&bytes_, value);
}

void PayloadWriter::putString(std::string_view text)
{
  const size_t length = std::min<size_t>(text.size(), std::numeric_limits<uint16_t>::max());
  putU16(static_cast<uint16_t>(length));
  bytes_.insert(bytes_.end(), text.begin(), text.begin() + static_cast<std::ptrdiff_t>(length));
}

const uint8_t* PayloadReader::take(size_t bytes)
{
  if (!ok_ || restLength() < bytes)
  {
    ok_ = false;
    return nullptr;
  }
  const uint8_t* const taken = next_;
  next_ += bytes;
  return taken;
}

uint16_t PayloadReader::getU16()
{
  const uint8_t* const bytes = take(2);
  return bytes != nullptr ? loadLittleEndian<uint16_t>(bytes) : uint16_t{0};
}

uint32_t PayloadReader::getU32()
{
  const uint8_t* const bytes = take(4);
  return bytes != nullptr ? loadLittleEndian<uint32_t>(bytes) : 0;
}

uint64_t PayloadReader::getU64()
{
  const uint8_t* const bytes = take(8);
  return bytes != nullptr ? loadLittleEndian<uint64_t>(bytes) : 0;
}

std::string PayloadReader::getString()
{
  const uint16_t length = getU16();
  const uint8_t* const bytes = take(length);
  return bytes != nullptr ? std::string(reinterpret_cast<const char*>(bytes), length) : std::string();
}

}  // namespace pi_os_transport
