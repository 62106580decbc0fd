#pragma once

#include <cstddef>
#include <stdexcept>
#include <string>
#include <string_view>

#include "master/rpc_value.h"

namespace pi_os_transport
{

/// What a document may make the decoder allocate; far above what ROS sends.
struct RpcLimits
{
  size_t depth = 64;        ///< of values in values; each level costs stack, here and in whoever reads it back
  size_t values = 1000000;  ///< in one document; each costs about 60 bytes, and in XML at least 8
};

/// The document is no XML-RPC, or more than the limits allow; says what and at which byte.
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

/// Reads XML-RPC as Python's xmlrpc and XmlRpc++ write it, in UTF-8. Declarations of document types are refused, and
/// with them entities that multiply. Line ends in text become "\n", as XML wants it.
/// @throws RpcDecodeError
RpcCall decodeRpcCall(std::string_view xml, const RpcLimits& limits = RpcLimits());
RpcResponse decodeRpcResponse(std::string_view xml, const RpcLimits& limits = RpcLimits());

}  // namespace pi_os_transport
