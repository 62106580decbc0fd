#pragma once

#include <cstddef>
#include <string>
#include <string_view>

#include "master/rpc_value.h"

namespace pi_os_transport
{

/// @return the XML of a call. @param params  text in UTF-8 without control characters, as the decoder accepts it.
std::string encodeRpcCall(std::string_view method, const RpcValue::Array& params);
/// @return the XML of a successful answer.
std::string encodeRpcResponse(const RpcValue& value);

/// Encodes a successful answer whose value is a list, value by value, which saves memory.
class RpcListEncoder
{
public:
  RpcListEncoder();
  void add(const RpcValue& value);
  size_t size() const { return xml_.size(); }  ///< so far [B]
  /// @return the XML. Call once, last.
  std::string finish();

private:
  std::string xml_;
};

/// @return the XML of an answer that reports an error. @param text  may contain any bytes of the call.
std::string encodeRpcFault(int code, std::string_view text);

}  // namespace pi_os_transport
