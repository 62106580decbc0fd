#include "wire/wire_frame.h"

#include "pi_os_transport/little_endian.h"

namespace pi_os_transport
{

FrameHeader FrameHeader::of(FrameType type, uint32_t id, uint32_t count, uint64_t offset)
{
  FrameHeader header;
  header.type = type;
  header.id = id;
  header.count = count;
  header.offset = offset;
  return header;
}

std::array<uint8_t, FrameHeader::BYTES> FrameHeader::encode() const
{
  std::array<uint8_t, BYTES> bytes{};
  storeLittleEndian<uint16_t>(&bytes[0], MAGIC);
  bytes[2] = version;
  bytes[3] = static_cast<uint8_t>(type);
  storeLittleEndian<uint32_t>(&bytes[4], id);
  storeLittleEndian<uint64_t>(&bytes[8], session);
  storeLittleEndian<uint32_t>(&bytes[16], count);
  storeLittleEndian<uint32_t>(&bytes[20], lane);
  storeLittleEndian<uint64_t>(&bytes[24], offset);
  return bytes;
}

bool FrameHeader::decode(const uint8_t* bytes, FrameHeader* header)
{
  if (loadLittleEndian<uint16_t>(bytes) != MAGIC)
  {
    return false;
  }
  header->version = bytes[2];
  if (header->version != WIRE_VERSION)
  {
    return true;
  }
  if (bytes[3] == 0 || bytes[3] > LAST_FRAME_TYPE)
  {
    return false;
  }
  header->type = static_cast<FrameType>(bytes[3]);
  header->id = loadLittleEndian<uint32_t>(bytes + 4);
  header->session = loadLittleEndian<uint64_t>(bytes + 8);
  header->count = loadLittleEndian<uint32_t>(bytes + 16);
  header->lane = loadLittleEndian<uint32_t>(bytes + 20);
  header->offset = loadLittleEndian<uint64_t>(bytes + 24);
  return true;
}

std::vector<uint8_t> encodeText(const std::string& text)
{
  PayloadWriter payload;
  payload.putString(text);
  return payload.take();
}

void LinkEntry::append(PayloadWriter* out) const
{
  out->putU32(link);
  out->putU32(sequence);
  out->putU32(after_tcp);
}

LinkEntry LinkEntry::read(PayloadReader* in)
{
  LinkEntry entry;
  entry.link = in->getU32();
  entry.sequence = in->getU32();
  entry.after_tcp = in->getU32();
  return entry;
}

std::vector<uint8_t> Hello::encode() const
{
  PayloadWriter out;
  out.putU64(instance);
  out.putU64(secret);
  out.putU64(echo);
  out.putU16(port);
  out.putU16(fixed ? 1 : 0);
  out.putU32(max_message_bytes);
  out.putString(address);
  out.putString(name);
  return out.take();
}

bool Hello::decode(const uint8_t* payload, size_t length, Hello* hello)
{
  PayloadReader in(payload, length);
  hello->instance = in.getU64();
  hello->secret = in.getU64();
  hello->echo = in.getU64();
  hello->port = in.getU16();
  const uint16_t fixed = in.getU16();
  hello->fixed = fixed == 1;
  hello->max_message_bytes = in.getU32();
  hello->address = in.getString();
  hello->name = in.getString();
  return in.ok() && in.restLength() == 0 && fixed <= 1 && hello->instance != 0 && hello->secret != 0;
}

std::vector<uint8_t> LinkOpen::encode() const
{
  PayloadWriter out;
  out.putString(socket_token);
  out.putString(link_token);
  out.putString(topic);
  out.putString(type);
  out.putString(publisher);
  out.putString(subscriber);
  return out.take();
}

bool LinkOpen::decode(const uint8_t* payload, size_t length, LinkOpen* open)
{
  PayloadReader in(payload, length);
  open->socket_token = in.getString();
  open->link_token = in.getString();
  open->topic = in.getString();
  open->type = in.getString();
  open->publisher = in.getString();
  open->subscriber = in.getString();
  return in.ok() && in.restLength() == 0;
}

}  // namespace pi_os_transport
