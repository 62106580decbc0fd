#include "master/rpc_encoder.h"

#include <array>
#include <charconv>
#include <utility>
#include <variant>

#include "master/xml_reader.h"

namespace pi_os_transport
{
namespace
{

constexpr std::string_view PROLOG = "<?xml version='1.0'?>\n";

void appendText(std::string* out, std::string_view text)
{
  size_t start = 0;
  for (size_t at = text.find_first_of("&<>"); at != std::string_view::npos; at = text.find_first_of("&<>", start))
  {
    out->append(text, start, at - start);
    out->append(text[at] == '&' ? "&amp;" : text[at] == '<' ? "&lt;" : "&gt;");
    start = at + 1;
  }
  out->append(text, start);
}

/// @param content  of the element, as XML
void appendElement(std::string* out, std::string_view name, std::string_view content)
{
  out->append("<").append(name).append(">").append(content).append("</").append(name).append(">");
}

void append(std::string* out, const RpcValue& value);

struct Appender
{
  void operator()(RpcValue::Nil) const { out->append("<nil/>"); }
  void operator()(bool value) const { appendElement(out, "boolean", value ? "1" : "0"); }
  void operator()(int32_t value) const { appendElement(out, "int", std::to_string(value)); }
  void operator()(double value) const
  {
    std::array<char, 32> text;  // a double has at most 24 characters
    const char* const end = std::to_chars(text.data(), text.data() + text.size(), value).ptr;
    appendElement(out, "double", std::string_view(text.data(), static_cast<size_t>(end - text.data())));
  }
  void operator()(const std::string& value) const
  {
    out->append("<string>");
    appendText(out, value);
    out->append("</string>");
  }
  void operator()(const RpcValue::Binary& value) const { appendElement(out, "base64", value.base64); }
  void operator()(const RpcValue::DateTime& value) const { appendElement(out, "dateTime.iso8601", value.iso8601); }
  void operator()(const RpcValue::Array& value) const
  {
    out->append("<array><data>");
    for (const RpcValue& one : value)
    {
      append(out, one);
    }
    out->append("</data></array>");
  }
  void operator()(const RpcValue::Struct& value) const
  {
    out->append("<struct>");
    for (const auto& [name, member] : value)
    {
      out->append("<member><name>");
      appendText(out, name);
      out->append("</name>");
      append(out, member);
      out->append("</member>");
    }
    out->append("</struct>");
  }

  std::string* out;
};

void append(std::string* out, const RpcValue& value)
{
  out->append("<value>");
  std::visit(Appender{out}, value.data);
  out->append("</value>");
}

}  // namespace

std::string encodeRpcCall(std::string_view method, const RpcValue::Array& params)
{
  std::string out(PROLOG);
  out.append("<methodCall><methodName>");
  appendText(&out, method);
  out.append("</methodName><params>");
  for (const RpcValue& param : params)
  {
    out.append("<param>");
    append(&out, param);
    out.append("</param>");
  }
  return out.append("</params></methodCall>\n");
}

std::string encodeRpcResponse(const RpcValue& value)
{
  std::string out(PROLOG);
  out.append("<methodResponse><params><param>");
  append(&out, value);
  return out.append("</param></params></methodResponse>\n");
}

RpcListEncoder::RpcListEncoder() : xml_(PROLOG)
{
  xml_.append("<methodResponse><params><param><value><array><data>");
}

void RpcListEncoder::add(const RpcValue& value)
{
  append(&xml_, value);
}

std::string RpcListEncoder::finish()
{
  xml_.append("</data></array></value></param></params></methodResponse>\n");
  return std::move(xml_);
}

std::string encodeRpcFault(int code, std::string_view text)
{
  std::string out(PROLOG);
  out.append("<methodResponse><fault>");
  append(&out, RpcValue::Struct{{"faultCode", code}, {"faultString", allowedText(text)}});
  return out.append("</fault></methodResponse>\n");
}

}  // namespace pi_os_transport
