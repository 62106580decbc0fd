#pragma once

#include <nlohmann/json.hpp>

#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

namespace pi_web
{

/// What clients ask for, by the Foxglove WebSocket protocol.
namespace request
{

struct Subscribe
{
  std::vector<std::pair<uint32_t, uint32_t>> subscriptions;  ///< id of the client, channel of ours
};
struct Unsubscribe
{
  std::vector<uint32_t> subscriptions;
};
/// A channel that the client publishes on.
struct ClientChannel
{
  uint32_t id = 0;
  std::string topic;
  std::string encoding;
  std::string type;
};
struct Advertise
{
  std::vector<ClientChannel> channels;
};
struct Unadvertise
{
  std::vector<uint32_t> channels;
};
struct Publish
{
  uint32_t channel = 0;
  std::string_view payload;  ///< of the decoded message
};
struct GetParameters
{
  std::vector<std::string> names;  ///< none: all
  std::string id;
};
struct SetParameters
{
  std::vector<std::pair<std::string, nlohmann::json>> values;  ///< null: removes the parameter
  std::string id;
};
struct CallService
{
  uint32_t service = 0;
  uint32_t call = 0;
  std::string encoding;
  std::string_view payload;  ///< of the decoded message
};
struct WatchGraph
{
  bool on = false;
};
struct FetchAsset
{
  std::string uri;
  uint32_t id = 0;
};

}  // namespace request

using Request = std::variant<request::Subscribe, request::Unsubscribe, request::Advertise, request::Unadvertise,
                             request::Publish, request::GetParameters, request::SetParameters, request::CallService,
                             request::WatchGraph, request::FetchAsset>;

/// Most elements of a list in a request.
constexpr size_t MAX_ELEMENTS = 500;
/// Most characters of a name, an encoding or an id.
constexpr size_t MAX_NAME = 300;

/// @throws std::invalid_argument naming field, value and bound. Never anything else, whatever the bytes are.
Request decodeText(std::string_view text);
/// The same for a binary message. The payload of the result points into it.
Request decodeBinary(std::string_view message);

}  // namespace pi_web
