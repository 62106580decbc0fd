#include "roscpp/topics/numbered_message.h"

#include <cstring>

#include "pi_os_transport/little_endian.h"
#include "shm/ring_sender.h"

namespace pi_os_transport
{
namespace
{

constexpr size_t TOKEN_BYTES = 2 * sizeof(uint64_t);
constexpr size_t HEAD_BYTES = TOKEN_BYTES + sizeof(uint32_t);

/// A buffer with `prefix` bytes of room for the length, which is written if there is room.
ros::SerializedMessage makeMessage(size_t prefix, size_t length)
{
  ros::SerializedMessage message(boost::shared_array<uint8_t>(new uint8_t[prefix + length]), prefix + length);
  message.message_start = message.buf.get() + prefix;
  if (prefix == LENGTH_PREFIX)
  {
    storeLittleEndian(message.buf.get(), static_cast<uint32_t>(length));
  }
  return message;
}

}  // namespace

ros::SerializedMessage numberedMessage(const Token& link, uint32_t number, const uint8_t* bytes, size_t length)
{
  ros::SerializedMessage message = makeMessage(LENGTH_PREFIX, HEAD_BYTES + length);
  storeLittleEndian(message.message_start, link.high);
  storeLittleEndian(message.message_start + sizeof(uint64_t), link.low);
  storeLittleEndian(message.message_start + TOKEN_BYTES, number);
  if (length > 0)
  {
    std::memcpy(message.message_start + HEAD_BYTES, bytes, length);
  }
  return message;
}

std::optional<uint32_t> takeNumber(const Token& link, size_t prefix, ros::SerializedMessage* message)
{
  const uint8_t* const start = message->buf.get() + prefix;
  if (link == Token() || message->num_bytes < prefix + HEAD_BYTES || loadLittleEndian<uint64_t>(start) != link.high ||
      loadLittleEndian<uint64_t>(start + sizeof(uint64_t)) != link.low)
  {
    return std::nullopt;
  }
  const auto number = loadLittleEndian<uint32_t>(start + TOKEN_BYTES);
  ros::SerializedMessage plain = makeMessage(prefix, message->num_bytes - prefix - HEAD_BYTES);
  std::memcpy(plain.message_start, start + HEAD_BYTES, plain.num_bytes - prefix);
  *message = plain;
  return number;
}

}  // namespace pi_os_transport
