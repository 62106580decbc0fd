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

/// Writes one line about what happened to whoever runs the program.
using Log = std::function<void(const std::string& line)>;

/// An argument is not what it should be; the text goes to the caller.
class RpcArgumentError : public std::runtime_error
{
public:
  using std::runtime_error::runtime_error;
};

/// The methods of one XML-RPC API of ROS: finds the one that a request names, checks its arguments, and makes an answer
/// of what it returns or throws. Knows system.multicall. Not thread safe.
class RpcMethods
{
public:
  /// May replace the argument by what it means, such as a name by its resolved form. @throws RpcArgumentError
  using Check = std::function<void(RpcValue* argument, const std::string& caller)>;
  /// @param arguments  those after the caller's name, as many as there are checks, checked.
  /// @return status code, message and value, see rpcResult().
  using Method = std::function<RpcValue(const std::string& caller, RpcValue::Array& arguments)>;

  explicit RpcMethods(const RpcLimits& limits = RpcLimits()) : limits_(limits) {}

  /// @param on_error  the value beside a status code that tells of an error.
  void add(const std::string& name, RpcValue on_error, std::vector<Check> checks, Method method);

  /// @return the answer, which is a fault where the request is none or names no known method. Throws nothing but for
  /// want of memory.
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

/// Checks for RpcMethods::add(), in the words of ROS's own master. @param name  of the argument, for the message.
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
