#pragma once

#include <functional>
#include <map>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "master/rpc_decoder.h"
#include "master/rpc_value.h"

namespace pi_os_transport
{

/// Writes one line to the log of the program.
using Log = std::function<void(const std::string& line)>;

/// An argument is invalid; the caller gets the text.
class RpcArgumentError : public std::runtime_error
{
public:
  using std::runtime_error::runtime_error;
};

/// The methods of one XML-RPC API of ROS. Finds the method of a request, checks the arguments, and makes an answer from
/// the result or the exception. Supports system.multicall. Not thread safe.
class RpcMethods
{
public:
  /// May change the argument, for example resolve a name. @throws RpcArgumentError
  using Check = std::function<void(RpcValue* argument, const std::string& caller)>;
  /// @param arguments  checked arguments after the caller's name, one per check.
  /// @return status code, message and value, see rpcResult().
  using Method = std::function<RpcValue(const std::string& caller, RpcValue::Array& arguments)>;

  explicit RpcMethods(const RpcLimits& limits = RpcLimits()) : limits_(limits) {}

  /// @param on_error  the value that is returned with an error.
  void add(const std::string& name, RpcValue on_error, std::vector<Check> checks, Method method);

  /// @return the answer; a fault if the request is invalid or names an unknown method. Throws only std::bad_alloc.
  std::string answer(std::string_view request) const;

private:
  struct Entry
  {
    RpcValue on_error;
    std::vector<Check> checks;
    Method method;
  };
  std::string answerMany(RpcValue::Array* params) const;
  RpcValue call(const Entry& entry, RpcValue::Array* params) const;

  RpcLimits limits_;
  std::map<std::string, Entry, std::less<>> entries_;
};

/// The triple that every method of ROS's APIs returns. @param code  1 success, 0 failure, -1 error of the caller
RpcValue rpcResult(int code, std::string message, RpcValue value);

/// Checks for RpcMethods::add(), with the texts of ROS's own master. @param name  of the argument, for the text.
namespace check
{

/// Accepts everything.
RpcMethods::Check any();
RpcMethods::Check notNil(const std::string& name);
RpcMethods::Check text(const std::string& name);
/// A URI with the scheme http or rosrpc.
RpcMethods::Check api(const std::string& name);
/// A topic or service; resolves it.
RpcMethods::Check graphName(const std::string& name, bool may_be_root = false);
/// "" or a name; resolves it.
RpcMethods::Check graphNameOrEmpty(const std::string& name);
/// "package/Type" or "*".
RpcMethods::Check typeName(const std::string& name);

}  // namespace check

}  // namespace pi_os_transport
