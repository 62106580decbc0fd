#include "master/rpc_decoder.h"

#include <charconv>
#include <cstdint>
#include <system_error>
#include <utility>

#include "master/xml_reader.h"
#include "text_parsing.h"

namespace pi_os_transport
{
namespace
{

/// @return true if all of `text` is a number, with or without sign, that fits `number`.
template <typename Number>
bool parse(std::string_view text, Number* number)
{
  text = trimmed(text);
  if (!text.empty() && text[0] == '+')
  {
    text.remove_prefix(1);
    if (!text.empty() && text[0] == '-')
    {
      return false;
    }
  }
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), *number);
  return error == std::errc() && end == text.data() + text.size() && !text.empty();
}

class Decoder
{
public:
  Decoder(std::string_view xml, const RpcLimits& limits) : xml_(xml), limits_(limits) {}

  RpcCall call()
  {
    RpcCall result;
    if (xml_.start("methodCall") || xml_.start("methodName"))
    {
      xml_.fail("no name of a method");
    }
    result.method = xml_.text();
    xml_.end("methodName");
    const XmlReader::Tag tag = xml_.nextTag();
    if (tag.is_end && tag.name == "methodCall")
    {
      xml_.finish();
      return result;
    }
    if (tag.is_end || tag.name != "params")
    {
      xml_.fail("no <params>");
    }
    if (!tag.is_empty)
    {
      result.params = params();
    }
    xml_.end("methodCall");
    xml_.finish();
    return result;
  }

  RpcResponse response()
  {
    RpcResponse result;
    if (xml_.start("methodResponse"))
    {
      xml_.fail("an empty response");
    }
    const XmlReader::Tag tag = xml_.nextTag();
    result.is_fault = tag.name == "fault";
    if (tag.is_end || tag.is_empty || (tag.name != "params" && tag.name != "fault"))
    {
      xml_.fail("neither <params> nor <fault>");
    }
    if (result.is_fault)
    {
      result.value = value(0, xml_.start("value"));
      xml_.end("fault");
    }
    else
    {
      RpcValue::Array values = params();
      if (values.size() != 1)
      {
        xml_.fail("a response of " + std::to_string(values.size()) + " values");
      }
      result.value = std::move(values[0]);
    }
    xml_.end("methodResponse");
    xml_.finish();
    return result;
  }

private:
  /// After <params>, including </params>.
  RpcValue::Array params()
  {
    RpcValue::Array result;
    for (XmlReader::Tag tag = xml_.nextTag(); !(tag.is_end && tag.name == "params"); tag = xml_.nextTag())
    {
      if (tag.is_end || tag.is_empty || tag.name != "param")
      {
        xml_.fail("no <param>");
      }
      result.push_back(value(0, xml_.start("value")));
      xml_.end("param");
    }
    return result;
  }

  /// After <value>, including </value>.
  RpcValue value(size_t depth, bool is_empty)
  {
    if (++values_ > limits_.values)
    {
      xml_.fail("more than " + std::to_string(limits_.values) + " values");
    }
    if (depth >= limits_.depth)
    {
      xml_.fail("values nested deeper than " + std::to_string(limits_.depth));
    }
    if (is_empty)
    {
      return std::string();
    }
    std::string text = xml_.text();
    const XmlReader::Tag tag = xml_.nextTag();
    if (tag.is_end)
    {
      if (tag.name != "value")
      {
        xml_.fail("no </value>");
      }
      return text;
    }
    RpcValue result;
    if (tag.name == "array")
    {
      result = array(depth, tag.is_empty);
    }
    else if (tag.name == "struct")
    {
      result = structure(depth, tag.is_empty);
    }
    else
    {
      text = tag.is_empty ? std::string() : xml_.text();
      result = scalar(tag.name, std::move(text));
      if (!tag.is_empty)
      {
        xml_.end(tag.name);
      }
    }
    xml_.end("value");
    return result;
  }

  RpcValue scalar(std::string_view type, std::string text)
  {
    if (type == "string")
    {
      return text;
    }
    if (type == "int" || type == "i4" || type == "i8" || type == "i2" || type == "i1")
    {
      int32_t number = 0;
      if (!parse(text, &number))
      {
        xml_.fail("\"" + text.substr(0, 40) + "\" as an integer of 32 bits");
      }
      return number;
    }
    if (type == "double" || type == "float")
    {
      double number = 0.0;
      if (!parse(text, &number))
      {
        xml_.fail("\"" + text.substr(0, 40) + "\" as a double");
      }
      return number;
    }
    if (type == "boolean")
    {
      const std::string_view word = trimmed(text);
      if (word != "0" && word != "1")
      {
        xml_.fail("\"" + text.substr(0, 40) + "\" as a boolean");
      }
      return word == "1";
    }
    if (type == "base64")
    {
      constexpr std::string_view ALPHABET = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/= \t\r\n";
      if (text.find_first_not_of(ALPHABET) != std::string::npos)
      {
        xml_.fail("what is not base64 as base64");
      }
      return RpcValue::Binary{std::move(text)};
    }
    if (type == "dateTime.iso8601")
    {
      constexpr std::string_view ALPHABET = "0123456789TZ:-+. \t\r\n";
      if (text.find_first_not_of(ALPHABET) != std::string::npos)
      {
        xml_.fail("what is no time as dateTime.iso8601");
      }
      return RpcValue::DateTime{std::move(text)};
    }
    if (type == "nil" || type == "ex:nil")
    {
      return RpcValue();
    }
    xml_.fail("a value of the unknown type \"" + std::string(type.substr(0, 40)) + "\"");
  }

  RpcValue array(size_t depth, bool is_empty)
  {
    RpcValue::Array result;
    if (is_empty)
    {
      return result;
    }
    if (!xml_.start("data"))
    {
      for (XmlReader::Tag tag = xml_.nextTag(); !(tag.is_end && tag.name == "data"); tag = xml_.nextTag())
      {
        if (tag.is_end || tag.name != "value")
        {
          xml_.fail("no <value> in <data>");
        }
        result.push_back(value(depth + 1, tag.is_empty));
      }
    }
    xml_.end("array");
    return result;
  }

  RpcValue structure(size_t depth, bool is_empty)
  {
    RpcValue::Struct result;
    if (is_empty)
    {
      return result;
    }
    for (XmlReader::Tag tag = xml_.nextTag(); !(tag.is_end && tag.name == "struct"); tag = xml_.nextTag())
    {
      if (tag.is_end || tag.is_empty || tag.name != "member")
      {
        xml_.fail("no <member> in <struct>");
      }
      std::string name;
      if (!xml_.start("name"))
      {
        name = xml_.text();
        xml_.end("name");
      }
      result.insert_or_assign(std::move(name), value(depth + 1, xml_.start("value")));
      xml_.end("member");
    }
    return result;
  }

  XmlReader xml_;
  RpcLimits limits_;
  size_t values_ = 0;
};

}  // namespace

RpcCall decodeRpcCall(std::string_view xml, const RpcLimits& limits)
{
  return Decoder(xml, limits).call();
}

RpcResponse decodeRpcResponse(std::string_view xml, const RpcLimits& limits)
{
  return Decoder(xml, limits).response();
}

}  // namespace pi_os_transport
