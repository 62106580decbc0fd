#include "protocol/messages.h"

#include <cstring>
#include <utility>

namespace pi_web
{

uint32_t readUint32(const char* bytes)
{
  uint32_t value = 0;
  for (int i = 3; i >= 0; --i)
  {
    value = value << 8 | static_cast<uint8_t>(bytes[i]);
  }
  return value;
}

void appendUint32(uint32_t value, std::string* bytes)
{
  for (int i = 0; i < 4; ++i)
  {
    *bytes += static_cast<char>(value >> (8 * i) & 0xff);
  }
}

void appendUint64(uint64_t value, std::string* bytes)
{
  appendUint32(static_cast<uint32_t>(value), bytes);
  appendUint32(static_cast<uint32_t>(value >> 32), bytes);
}

OutMessage textMessage(const nlohmann::json& object)
{
  // Names from elsewhere may hold bytes that are not UTF-8: replaced, not refused.
  return {object.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace), nullptr, true};
}

OutMessage statusMessage(StatusLevel level, const std::string& text)
{
  return textMessage({{"op", "status"}, {"level", static_cast<int>(level)}, {"message", text}});
}

OutMessage dataMessage(uint32_t subscription, uint64_t stamp_ns, Payload body)
{
  OutMessage message{"\x01", std::move(body)};
  appendUint32(subscription, &message.head);
  appendUint64(stamp_ns, &message.head);
  return message;
}

OutMessage timeMessage(uint64_t stamp_ns)
{
  OutMessage message{"\x02", nullptr};
  appendUint64(stamp_ns, &message.head);
  return message;
}

OutMessage serviceResponse(uint32_t service, uint32_t call, const std::string& encoding, Payload body)
{
  OutMessage message{"\x03", std::move(body)};
  appendUint32(service, &message.head);
  appendUint32(call, &message.head);
  appendUint32(static_cast<uint32_t>(encoding.size()), &message.head);
  message.head += encoding;
  return message;
}

OutMessage serviceFailure(uint32_t service, uint32_t call, const std::string& why)
{
  return textMessage({{"op", "serviceCallFailure"}, {"serviceId", service}, {"callId", call}, {"message", why}});
}

OutMessage assetResponse(uint32_t request, const std::string& error, Payload body)
{
  OutMessage message{"\x04", std::move(body)};
  appendUint32(request, &message.head);
  message.head += error.empty() ? '\0' : '\1';
  appendUint32(static_cast<uint32_t>(error.size()), &message.head);
  message.head += error;
  return message;
}

}  // namespace pi_web
