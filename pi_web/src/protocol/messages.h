#pragma once

#include <nlohmann/json.hpp>

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace pi_web
{

/// Sub-protocols of the same content, the newer name first.
constexpr const char* SUBPROTOCOLS[] = {"foxglove.sdk.v1", "foxglove.websocket.v1"};

using Bytes = std::vector<uint8_t>;
using Payload = std::shared_ptr<const Bytes>;

/// A message to a client: a short head of its own, and bytes that clients may share.
struct OutMessage
{
  std::string head;  ///< text: all of it
  Payload body;      ///< may be null
  bool text = false;

  size_t size() const { return head.size() + (body ? body->size() : 0); }
};

// Little-endian numbers.
uint32_t readUint32(const char* bytes);
void appendUint32(uint32_t value, std::string* bytes);
void appendUint64(uint64_t value, std::string* bytes);

enum class StatusLevel
{
  INFO,
  WARNING,
  ERROR
};

OutMessage textMessage(const nlohmann::json& object);
OutMessage statusMessage(StatusLevel level, const std::string& text);
OutMessage dataMessage(uint32_t subscription, uint64_t stamp_ns, Payload body);
OutMessage timeMessage(uint64_t stamp_ns);
OutMessage serviceResponse(uint32_t service, uint32_t call, const std::string& encoding, Payload body);
OutMessage serviceFailure(uint32_t service, uint32_t call, const std::string& why);
/// @param error  empty: body is the file.
OutMessage assetResponse(uint32_t request, const std::string& error, Payload body);

}  // namespace pi_web
