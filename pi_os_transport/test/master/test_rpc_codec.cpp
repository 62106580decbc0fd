#include <gtest/gtest.h>

#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "master/rpc_decoder.h"
#include "master/rpc_encoder.h"

namespace pi_os_transport
{
namespace
{

/// A call with one parameter, written as `value`.
std::string callWith(const std::string& value)
{
  return "<?xml version='1.0'?><methodCall><methodName>m</methodName><params><param>" + value +
         "</param></params></methodCall>";
}

RpcValue decoded(const std::string& value)
{
  const RpcCall call = decodeRpcCall(callWith(value));
  EXPECT_EQ("m", call.method);
  EXPECT_EQ(1U, call.params.size());
  return call.params.at(0);
}

/// The text of the error.
std::string refusal(const std::string& xml, const RpcLimits& limits = RpcLimits())
{
  try
  {
    decodeRpcCall(xml, limits);
    return "accepted";
  }
  catch (const RpcDecodeError& error)
  {
    return error.what();
  }
}

TEST(RpcCodec, ReadsEveryType)
{
  EXPECT_EQ(RpcValue(7), decoded("<value><int>7</int></value>"));
  EXPECT_EQ(RpcValue(-7), decoded("<value><i4> -7\n</i4></value>"));
  EXPECT_EQ(RpcValue(7), decoded("<value><int>+7</int></value>"));
  EXPECT_EQ(RpcValue(true), decoded("<value><boolean>1</boolean></value>"));
  EXPECT_EQ(RpcValue(false), decoded("<value><boolean>0</boolean></value>"));
  EXPECT_EQ(RpcValue(-1.5e300), decoded("<value><double>-1.5e300</double></value>"));
  EXPECT_EQ(RpcValue(std::numeric_limits<double>::infinity()), decoded("<value><double>inf</double></value>"));
  EXPECT_EQ(RpcValue("text"), decoded("<value><string>text</string></value>"));
  EXPECT_EQ(RpcValue(" text "), decoded("<value> text </value>"));
  EXPECT_EQ(RpcValue(""), decoded("<value/>"));
  EXPECT_EQ(RpcValue(""), decoded("<value><string/></value>"));
  EXPECT_EQ(RpcValue(RpcValue::Binary{"AAEC"}), decoded("<value><base64>AAEC</base64></value>"));
  EXPECT_EQ(RpcValue(RpcValue::DateTime{"20261123T10:00:00"}),
            decoded("<value><dateTime.iso8601>20261123T10:00:00</dateTime.iso8601></value>"));
  EXPECT_EQ(RpcValue(), decoded("<value><nil/></value>"));
  EXPECT_EQ(RpcValue(RpcValue::Array()), decoded("<value><array><data/></array></value>"));
  EXPECT_EQ(RpcValue(RpcValue::Array{1, "a"}),
            decoded("<value><array><data>\n<value><int>1</int></value> <value>a</value></data></array></value>"));
  EXPECT_EQ(RpcValue(RpcValue::Struct{{"a", 2}}),
            decoded("<value><struct><member><name>a</name><value><int>1</int></value></member>"
                    "<member><name>a</name><value><int>2</int></value></member></struct></value>"));
}

TEST(RpcCodec, ReadsTextAsXmlMeansIt)
{
  EXPECT_EQ(RpcValue("<&>\"'"), decoded("<value>&lt;&amp;&gt;&quot;&apos;</value>"));
  EXPECT_EQ(RpcValue("\xC3\xA4\xE2\x82\xAC\xF0\x9F\x98\x80"), decoded("<value>&#228;&#x20ac;&#128512;</value>"));
  EXPECT_EQ(RpcValue("a\nb\nc"), decoded("<value>a\r\nb\rc</value>"));
  EXPECT_EQ(RpcValue("a<b>&amp;c"), decoded("<value>a<![CDATA[<b>&amp;]]>c</value>"));
  EXPECT_EQ(RpcValue("ab"), decoded("<value><string>a<!-- no --><!-- text -->b</string></value>"));
}

TEST(RpcCodec, ReadsBackWhatItWrites)
{
  const RpcValue::Array params{"<a&b>",
                               true,
                               std::numeric_limits<int32_t>::min(),
                               0.1,
                               1e22,
                               -std::numeric_limits<double>::denorm_min(),
                               RpcValue::Binary{"AA=="},
                               RpcValue::DateTime{"20261123T10:00:00"},
                               RpcValue::Array{RpcValue::Array(), RpcValue::Struct()},
                               RpcValue::Struct{{"<k>", RpcValue::Struct{{"", 1}}}}};
  const RpcCall call = decodeRpcCall(encodeRpcCall("name", params));
  EXPECT_EQ("name", call.method);
  EXPECT_EQ(params, call.params);
  for (const RpcValue& value : params)
  {
    const RpcResponse response = decodeRpcResponse(encodeRpcResponse(value));
    EXPECT_FALSE(response.is_fault);
    EXPECT_EQ(value, response.value);
  }
  RpcListEncoder list;
  list.add(1);
  list.add("b");
  EXPECT_EQ(RpcValue(RpcValue::Array{1, "b"}), decodeRpcResponse(list.finish()).value);
  const RpcResponse fault = decodeRpcResponse(encodeRpcFault(1, "bad <thing>"));
  EXPECT_TRUE(fault.is_fault);
  EXPECT_EQ(RpcValue("bad <thing>"), fault.value.as<RpcValue::Struct>().at("faultString"));
}

TEST(RpcCodec, AFaultMayQuoteAnyBytes)
{
  const RpcResponse fault = decodeRpcResponse(encodeRpcFault(1, "\xff<\x01 \xc3\xa4 \xc3"));
  EXPECT_EQ(RpcValue("?<? \xc3\xa4 ?"), fault.value.as<RpcValue::Struct>().at("faultString"));
}

TEST(RpcCodec, ReadsWhatXmlRpcPlusPlusWrites)
{
  const RpcCall call = decodeRpcCall(
      "<?xml version=\"1.0\"?>\r\n<methodCall><methodName>registerPublisher</methodName>\r\n"
      "<params><param><value>/node</value></param><param><value><i4>3</i4></value></param></params></methodCall>\r\n");
  EXPECT_EQ("registerPublisher", call.method);
  EXPECT_EQ((RpcValue::Array{"/node", 3}), call.params);
  EXPECT_TRUE(decodeRpcCall("<methodCall><methodName>m</methodName></methodCall>").params.empty());
  EXPECT_TRUE(decodeRpcCall("<methodCall><methodName>m</methodName><params/></methodCall>").params.empty());
}

TEST(RpcCodec, RefusesWhatIsNone)
{
  const std::vector<std::pair<std::string, std::string>> cases{
      {"", "ends too early"},
      {"hello", "text where a tag"},
      {"<methodCall>", "ends too early"},
      {"<methodResponse/>", "<methodResponse> in place of <methodCall>"},
      {callWith("<value><int>7</int>"), "in place of </value>"},
      {callWith("<value><int>7</value>"), "in place of </int>"},
      {callWith("<value><int></int></value>"), "integer"},
      {callWith("<value><int>+-7</int></value>"), "integer"},
      {callWith("<value><int>2147483648</int></value>"), "integer"},
      {callWith("<value><i8>99999999999999999999</i8></value>"), "integer"},
      {callWith("<value><double>1.0x</double></value>"), "double"},
      {callWith("<value><boolean>true</boolean></value>"), "boolean"},
      {callWith("<value><base64>&lt;</base64></value>"), "base64"},
      {callWith("<value><dateTime.iso8601>soon</dateTime.iso8601></value>"), "dateTime"},
      {callWith("<value><tuple>1</tuple></value>"), "unknown type \"tuple\""},
      {callWith("<value>&nothing;</value>"), "reference"},
      {callWith("<value>&#0;</value>"), "reference"},
      {callWith("<value>&#xD800;</value>"), "reference"},
      {callWith("<value>&#x110000;</value>"), "reference"},
      {callWith("<value>& alone</value>"), "without \";\""},
      {callWith("<value>\x01</value>"), "control character"},
      {callWith("<value>\xFF</value>"), "UTF-8"},
      {callWith("<value>\xC0\x80</value>"), "UTF-8"},
      {callWith("<value>\xE4\xB8</value>"), "UTF-8"},
      {callWith("<value>1</value>") + "more", "after the end"},
      {"<!DOCTYPE a [<!ENTITY b \"bb\">]>" + callWith("<value>&b;</value>"), "declaration"},
  };
  for (const auto& [xml, expected] : cases)
  {
    const std::string told = refusal(xml);
    EXPECT_NE(std::string::npos, told.find(expected)) << xml << "\n" << told;
  }
}

TEST(RpcCodec, RefusesEveryTruncation)
{
  const std::string whole = callWith(
      "<value><struct><member><name>a</name><value><array><data><value>x&amp;y</value></data></array></value>"
      "</member></struct></value>");
  ASSERT_EQ("accepted", refusal(whole));
  for (size_t size = 0; size < whole.size(); ++size)
  {
    EXPECT_NE("accepted", refusal(whole.substr(0, size))) << size;
  }
}

TEST(RpcCodec, LimitsDepthAndNumberOfValues)
{
  const auto nested = [](size_t depth)
  {
    std::string value = "<value>x</value>";
    for (size_t level = 1; level < depth; ++level)
    {
      value = "<value><array><data>" + value + "</data></array></value>";
    }
    return callWith(value);
  };
  RpcLimits limits;
  EXPECT_EQ("accepted", refusal(nested(limits.depth), limits));
  EXPECT_NE(std::string::npos, refusal(nested(limits.depth + 1), limits).find("deeper than 64"));
  limits.values = 3;
  const std::string two = "<value><array><data><value/><value/></data></array></value>";
  const std::string three = "<value><array><data><value/><value/><value/></data></array></value>";
  EXPECT_EQ("accepted", refusal(callWith(two), limits));
  EXPECT_NE(std::string::npos, refusal(callWith(three), limits).find("more than 3 values"));
}

}  // namespace
}  // namespace pi_os_transport
