// What anybody may ask of the master, as XML or as any values in a well-formed call, and what nodes answer it.

#include <sstream>

#include "fuzz_input.h"
#include "master/master_api.h"
#include "master/network_address.h"
#include "master/rpc_decoder.h"
#include "master/rpc_encoder.h"

namespace pi_os_transport
{
namespace
{

constexpr const char* METHODS[] = {"getSystemState",
                                   "registerPublisher",
                                   "unregisterPublisher",
                                   "registerSubscriber",
                                   "unregisterSubscriber",
                                   "registerService",
                                   "unregisterService",
                                   "lookupService",
                                   "lookupNode",
                                   "getPublishedTopics",
                                   "getTopicTypes",
                                   "setParam",
                                   "getParam",
                                   "deleteParam",
                                   "hasParam",
                                   "searchParam",
                                   "subscribeParam",
                                   "unsubscribeParam",
                                   "getParamNames",
                                   "getUri",
                                   "getPid",
                                   "shutdown",
                                   "system.multicall",
                                   "nonsense"};
constexpr const char* TEXTS[] = {"/a",
                                 "/b",
                                 "a",
                                 "~a",
                                 "/a/b",
                                 "/a/b/c/",
                                 "b/c",
                                 "/",
                                 "",
                                 "*",
                                 "std_msgs/String",
                                 "http://localhost:1/",
                                 "http://h:2/",
                                 "rosrpc://h:3",
                                 "http://[::1]:4/x",
                                 "//a//b"};

/// Parameters may be nested deeper than what one call may bring.
constexpr RpcLimits READER{1000, 1000000};

/// Keeps the calls of nodes; each is answered once at most, as the interface says, or never.
class Calls : public NodeCalls
{
public:
  void call(const std::string& api, NodeCall call) override
  {
    try
    {
      const HostAndPort at = parseHttpUri(api);
      require(!at.host.empty() && at.port != 0, "an address has host and port");
    }
    catch (const std::invalid_argument&)
    {
    }
    decodeRpcCall(*call.body, READER);  // throws if a node could not read it
    waiting.push_back(std::move(call));
  }

  std::vector<NodeCall> waiting;
};

std::string someText(FuzzInput* input)
{
  const uint32_t choice = input->below(24);
  if (choice < sizeof(TEXTS) / sizeof(*TEXTS))
  {
    return TEXTS[choice];
  }
  std::string text;
  for (const uint8_t byte : input->bytes(input->below(20)))
  {
    text += byte >= 0x20 && byte < 0x7f ? static_cast<char>(byte) : '/';  // what the decoder would let through
  }
  return text;
}

RpcValue someValue(FuzzInput* input, uint32_t depth)
{
  const uint32_t kind = input->below(depth < 6 ? 12 : 8);
  switch (kind)
  {
    case 0:
      return RpcValue();
    case 1:
      return input->below(2) == 1;
    case 2:
      return input->take<int32_t>();
    case 3:
      return static_cast<double>(input->take<int32_t>()) / 7;
    case 4:
      return RpcValue::Binary{"AAA="};
    case 8:
    case 9:
    {
      RpcValue::Array array;
      for (uint32_t count = input->below(5); count > 0; --count)
      {
        array.push_back(someValue(input, depth + 1));
      }
      return array;
    }
    case 10:
    case 11:
    {
      RpcValue::Struct members;
      for (uint32_t count = input->below(5); count > 0; --count)
      {
        std::string name = someText(input);
        members[std::move(name)] = someValue(input, depth + 1);
      }
      return members;
    }
    default:
      return someText(input);
  }
}

RpcValue::Array someArguments(FuzzInput* input)
{
  RpcValue::Array arguments;
  for (uint32_t count = input->below(6); count > 0; --count)
  {
    arguments.push_back(someValue(input, input->below(4) == 0 ? 0 : 6));
  }
  return arguments;
}

std::string someCall(FuzzInput* input)
{
  const std::string method = METHODS[input->below(sizeof(METHODS) / sizeof(*METHODS))];
  if (method != "system.multicall")
  {
    return encodeRpcCall(method, someArguments(input));
  }
  RpcValue::Array calls;
  for (uint32_t count = input->below(4); count > 0; --count)
  {
    const std::string one = METHODS[input->below(sizeof(METHODS) / sizeof(*METHODS))];
    calls.push_back(input->below(8) == 0
                        ? someValue(input, 5)
                        : RpcValue(RpcValue::Struct{{"methodName", one}, {"params", someArguments(input)}}));
  }
  return encodeRpcCall(method, {calls});
}

/// What is read as a document is written as one that reads as the same.
void readDocument(const std::string& xml)
{
  try
  {
    const RpcCall call = decodeRpcCall(xml);
    const RpcCall again = decodeRpcCall(encodeRpcCall(call.method, call.params));
    require(again.method == call.method && again.params.size() == call.params.size(), "a call is read as written");
  }
  catch (const RpcDecodeError&)
  {
  }
  try
  {
    const RpcResponse response = decodeRpcResponse(xml);
    if (!response.is_fault)
    {
      decodeRpcResponse(encodeRpcResponse(response.value));
    }
  }
  catch (const RpcDecodeError&)
  {
  }
}

void fuzz(FuzzInput input)
{
  Calls calls;
  MasterApi master("http://localhost:11311/", &calls, [](const std::string&) {});
  if (input.below(2) == 0)
  {
    // Documents, each ended by a zero byte.
    const std::vector<uint8_t> bytes = input.rest();
    std::istringstream documents(std::string(bytes.begin(), bytes.end()));
    std::string xml;
    while (std::getline(documents, xml, '\0'))
    {
      readDocument(xml);
      decodeRpcResponse(master.answer(xml), READER);  // throws if a caller could not read it
    }
    return;
  }
  for (uint32_t step = 0; step < 64 && !input.empty(); ++step)
  {
    if (input.below(6) == 0 && !calls.waiting.empty())
    {
      const NodeCall call = std::move(calls.waiting.back());
      calls.waiting.pop_back();
      RpcResponse response;
      response.is_fault = input.below(8) == 0;
      response.value = input.below(2) == 0 ? rpcResult(-1, "", 0) : someValue(&input, 4);
      if (call.done)
      {
        call.done(input.below(4) == 0 ? nullptr : &response);
      }
      continue;
    }
    decodeRpcResponse(master.answer(someCall(&input)), READER);
  }
}

}  // namespace
}  // namespace pi_os_transport

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size)
{
  pi_os_transport::fuzz(pi_os_transport::FuzzInput(data, size));
  return 0;
}
