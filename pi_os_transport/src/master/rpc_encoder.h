#pragma once

#include <cstddef>
#include <string>
#include <string_view>

#include "master/rpc_value.h"

namespace pi_os_transport
{

/// @return the XML of a call. @param params  text in UTF-8 without control characters, as the decoder lets it through.
std::string encodeRpcCall(std::string_view method, const RpcValue::Array& params);
/// @return the XML of a successful answer.
std::string encodeRpcResponse(const RpcValue& value);

/// A successful answer whose value is a list, made value by value: it need not be held in two forms at a time.
class RpcListEncoder
{
public:
  RpcListEncoder();
  void add(const RpcValue& value);
  size_t size() const { return xml_.size(); }  ///< so far [B]
  /// @return the XML. Ends the use of this object.
  std::string finish();

private:
  std::string xml_;
};

/// @return the XML of an answer that says what was wrong with the call. @param text  may quote any bytes of it.
std::string encodeRpcFault(int code, std::string_view text);

}  // namespace pi_os_transport
