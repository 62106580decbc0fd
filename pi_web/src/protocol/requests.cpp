#include "protocol/requests.h"

#include "protocol/messages.h"

#include <limits>
#include <stdexcept>

namespace pi_web
{
namespace
{

using nlohmann::json;

constexpr size_t MAX_SHOWN = 60;  // characters of a client's text in an error

[[noreturn]] void refuse(const std::string& text)
{
  throw std::invalid_argument(text);
}

/// A client's text for a log: short, and printable.
std::string shown(std::string_view text)
{
  std::string result;
  for (const char c : text.substr(0, MAX_SHOWN))
  {
    result += c >= ' ' && c <= '~' ? c : '?';
  }
  return "\"" + result + (text.size() > MAX_SHOWN ? "...\"" : "\"");
}

const json& member(const json& object, const char* name)
{
  const auto found = object.find(name);
  if (found == object.end())
  {
    refuse(std::string("no field ") + name);
  }
  return *found;
}

uint32_t number(const json& value, const char* name)
{
  if (!value.is_number_unsigned() || value.get<uint64_t>() > std::numeric_limits<uint32_t>::max())
  {
    refuse(std::string(name) + " must be an integer in [0, 4294967295]");
  }
  return value.get<uint32_t>();
}

std::string text(const json& value, const char* name)
{
  if (!value.is_string() || value.get_ref<const std::string&>().size() > MAX_NAME)
  {
    refuse(std::string(name) + " must be a text of at most " + std::to_string(MAX_NAME) + " characters");
  }
  return value.get<std::string>();
}

std::string optionalText(const json& object, const char* name)
{
  const auto found = object.find(name);
  return found == object.end() || found->is_null() ? std::string() : text(*found, name);
}

const json& list(const json& object, const char* name)
{
  const json& value = member(object, name);
  if (!value.is_array() || value.size() > MAX_ELEMENTS)
  {
    refuse(std::string(name) + " must be a list of at most " + std::to_string(MAX_ELEMENTS));
  }
  return value;
}

/// The elements of a list of objects.
const json& objects(const json& object, const char* name)
{
  const json& elements = list(object, name);
  for (const json& element : elements)
  {
    if (!element.is_object())
    {
      refuse(std::string(name) + " must hold objects");
    }
  }
  return elements;
}

std::vector<uint32_t> numbers(const json& object, const char* name)
{
  std::vector<uint32_t> result;
  for (const json& element : list(object, name))
  {
    result.push_back(number(element, name));
  }
  return result;
}

request::Subscribe subscribe(const json& object)
{
  request::Subscribe result;
  for (const json& element : objects(object, "subscriptions"))
  {
    result.subscriptions.emplace_back(number(member(element, "id"), "id"),
                                      number(member(element, "channelId"), "channelId"));
  }
  return result;
}

request::Advertise advertise(const json& object)
{
  request::Advertise result;
  for (const json& element : objects(object, "channels"))
  {
    result.channels.push_back({number(member(element, "id"), "id"), text(member(element, "topic"), "topic"),
                               text(member(element, "encoding"), "encoding"),
                               text(member(element, "schemaName"), "schemaName")});
  }
  return result;
}

request::GetParameters getParameters(const json& object)
{
  request::GetParameters result;
  for (const json& element : list(object, "parameterNames"))
  {
    result.names.push_back(text(element, "parameterNames"));
  }
  result.id = optionalText(object, "id");
  return result;
}

request::SetParameters setParameters(const json& object)
{
  request::SetParameters result;
  for (const json& element : objects(object, "parameters"))
  {
    const auto value = element.find("value");
    result.values.emplace_back(text(member(element, "name"), "name"), value == element.end() ? json() : *value);
  }
  result.id = optionalText(object, "id");
  return result;
}

}  // namespace

Request decodeText(std::string_view message)
{
  const json object = json::parse(message.begin(), message.end(), nullptr, false);
  if (!object.is_object())
  {
    refuse("a text message must be a JSON object");
  }
  const std::string op = text(member(object, "op"), "op");
  if (op == "subscribe")
  {
    return subscribe(object);
  }
  if (op == "unsubscribe")
  {
    return request::Unsubscribe{numbers(object, "subscriptionIds")};
  }
  if (op == "advertise")
  {
    return advertise(object);
  }
  if (op == "unadvertise")
  {
    return request::Unadvertise{numbers(object, "channelIds")};
  }
  if (op == "getParameters")
  {
    return getParameters(object);
  }
  if (op == "setParameters")
  {
    return setParameters(object);
  }
  if (op == "subscribeConnectionGraph" || op == "unsubscribeConnectionGraph")
  {
    return request::WatchGraph{op[0] == 's'};
  }
  if (op == "fetchAsset")
  {
    return request::FetchAsset{text(member(object, "uri"), "uri"), number(member(object, "requestId"), "requestId")};
  }
  refuse("op " + shown(op) + " is unknown here");
}

Request decodeBinary(std::string_view message)
{
  const auto need = [&message](size_t bytes)
  {
    if (message.size() < bytes)
    {
      refuse("a binary message of " + std::to_string(message.size()) + " bytes ends too early");
    }
  };
  need(1);
  const auto opcode = static_cast<uint8_t>(message[0]);
  if (opcode == 1)
  {
    need(5);
    return request::Publish{readUint32(message.data() + 1), message.substr(5)};
  }
  if (opcode == 2)
  {
    need(13);
    const size_t length = readUint32(message.data() + 9);
    if (length > MAX_NAME)
    {
      refuse("encoding has " + std::to_string(length) + " characters, must be at most " + std::to_string(MAX_NAME));
    }
    need(13 + length);
    return request::CallService{readUint32(message.data() + 1), readUint32(message.data() + 5),
                                std::string(message.substr(13, length)), message.substr(13 + length)};
  }
  refuse("binary opcode " + std::to_string(opcode) + " is unknown here");
}

}  // namespace pi_web
