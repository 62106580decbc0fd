#include "wire/payload.h"

#include <algorithm>
#include <limits>

namespace pi_os_transport
{

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

std::string PayloadReader::getString()
{
  const uint16_t length = getU16();
  const uint8_t* const bytes = take(length);
  return bytes != nullptr ? std::string(reinterpret_cast<const char*>(bytes), length) : std::string();
}

}  // namespace pi_os_transport
