#include "bridge/bridge_request.h"

#include <unistd.h>

#include "wire/payload.h"

namespace pi_os_transport
{

std::vector<uint8_t> BridgeRequest::encode() const
{
  PayloadWriter out;
  out.putU32(MAGIC);
  out.putU16(VERSION);
  out.putU16(kind);
  switch (kind)
  {
    case LINK:
      for (const std::string* text : {&address, &socket_token, &link_token, &topic, &type, &publisher, &subscriber})
      {
        out.putString(*text);
      }
      out.putU32(link);
      break;
    case TUNNEL:
      out.putString(address);
      out.putU16(port);
      out.putString(service);
      break;
    case STATUS:
    case PING:
      break;
  }
  return out.take();
}

bool BridgeRequest::decode(const std::vector<uint8_t>& packet, BridgeRequest* request, std::string* error)
{
  PayloadReader in(packet.data(), packet.size());
  const uint32_t magic = in.getU32();
  const uint16_t version = in.getU16();
  const uint16_t kind = in.getU16();
  if (!in.ok() || magic != MAGIC || version != VERSION)
  {
    *error = in.ok() && magic == MAGIC ? "request of version " + std::to_string(version) : "no request";
    return false;
  }
  request->kind = static_cast<Kind>(kind);
  switch (request->kind)
  {
    case LINK:
      for (std::string* text : {&request->address, &request->socket_token, &request->link_token, &request->topic,
                                &request->type, &request->publisher, &request->subscriber})
      {
        *text = in.getString();
      }
      request->link = in.getU32();
      break;
    case TUNNEL:
      request->address = in.getString();
      request->port = in.getU16();
      request->service = in.getString();
      break;
    case STATUS:
    case PING:
      break;
    default:
      *error = "request of unknown kind " + std::to_string(kind);
      return false;
  }
  if (!in.ok() || in.restLength() != 0)
  {
    *error = "truncated request";
    return false;
  }
  return true;
}

std::string BridgeRequest::socketName(const std::string& bridge)
{
  return "pi_os_bridge/" + std::to_string(geteuid()) + "/" + bridge;
}

}  // namespace pi_os_transport
