#pragma once

#include <cstddef>
#include <stdexcept>
#include <string>
#include <string_view>

#include "master/rpc_value.h"

namespace pi_os_transport
{

/// Limits of what the decoder allocates; far above what ROS sends.
struct RpcLimits
{
  size_t depth = 64;        ///< of nested values; each level costs stack
  size_t values = 1000000;  ///< in one document; each costs about 60 B of memory
};

/// The document is not XML-RPC, or exceeds the limits. The text tells the reason and the position.
class RpcDecodeError : public std::runtime_error
{
public:
  using std::runtime_error::runtime_error;
};

struct RpcCall
{
  std::string method;
  RpcValue::Array params;
};

struct RpcResponse
{
  bool is_fault = false;
  RpcValue value;  ///< of a fault: the struct with faultCode and faultString
};

// Own XML-RPC: all of pi_core takes 3.2 MB (bar: 4 MB); XmlRpc++ limits neither depth nor values (ros_master.md).

/// Reads XML-RPC as written by Python's xmlrpc and XmlRpc++, in UTF-8. Refuses document type declarations, and so
/// entities that expand. Line ends in text become "\n", as XML requires.
/// @throws RpcDecodeError
RpcCall decodeRpcCall(std::string_view xml, const RpcLimits& limits = RpcLimits());
RpcResponse decodeRpcResponse(std::string_view xml, const RpcLimits& limits = RpcLimits());

}  // namespace pi_os_transport
