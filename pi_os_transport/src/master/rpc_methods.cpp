#include "master/rpc_methods.h"

#include <exception>
#include <utility>

#include "master/graph_name.h"
#include "master/rpc_encoder.h"

namespace pi_os_transport
{
namespace
{

constexpr int FAULT_CODE = 1;  // the code of Python's servers, for all reasons
constexpr size_t MOST_REPLY_BYTES =
    256 * 1024 * 1024;  // of one multicall, which may request a large parameter many times
constexpr std::string_view MULTICALL = "system.multicall";

std::string unknownMethod(std::string_view name)
{
  return "method \"" + std::string(name) + "\" is not supported";
}

RpcValue::Struct fault(std::string text)
{
  return {{"faultCode", FAULT_CODE}, {"faultString", std::move(text)}};
}

const std::string& textOf(const RpcValue& value)
{
  return value.as<std::string>();
}

bool isText(const RpcValue& value)
{
  return value.is<std::string>();
}

}  // namespace

void RpcMethods::add(const std::string& name, RpcValue on_error, std::vector<Check> checks, Method method)
{
  entries_[name] = {std::move(on_error), std::move(checks), std::move(method)};
}

std::string RpcMethods::answer(std::string_view request) const
{
  try
  {
    RpcCall call = decodeRpcCall(request, limits_);
    if (call.method == MULTICALL)
    {
      return answerMany(&call.params);
    }
    const auto found = entries_.find(call.method);
    if (found == entries_.end())
    {
      return encodeRpcFault(FAULT_CODE, unknownMethod(call.method));
    }
    return encodeRpcResponse(this->call(found->second, &call.params));
  }
  catch (const std::exception& error)
  {
    return encodeRpcFault(FAULT_CODE, error.what());
  }
}

std::string RpcMethods::answerMany(RpcValue::Array* params) const
{
  if (params->size() != 1 || !(*params)[0].is<RpcValue::Array>())
  {
    return encodeRpcFault(FAULT_CODE, std::string(MULTICALL) + " takes one list of calls");
  }
  RpcListEncoder answers;
  for (RpcValue& call : (*params)[0].as<RpcValue::Array>())
  {
    RpcValue answer = fault("each call has to be a struct of methodName and params");
    if (call.is<RpcValue::Struct>())
    {
      RpcValue& method = call.as<RpcValue::Struct>()["methodName"];
      RpcValue& arguments = call.as<RpcValue::Struct>()["params"];
      if (isText(method) && arguments.is<RpcValue::Array>())
      {
        const auto found = entries_.find(textOf(method));
        answer = found == entries_.end()
                     ? RpcValue(fault(unknownMethod(textOf(method))))
                     : RpcValue(RpcValue::Array{this->call(found->second, &arguments.as<RpcValue::Array>())});
      }
    }
    answers.add(answer);
    if (answers.size() > MOST_REPLY_BYTES)
    {
      return encodeRpcFault(FAULT_CODE,
                            "the answer to this " + std::string(MULTICALL) + " is too long; ask for less at a time");
    }
  }
  return answers.finish();
}

RpcValue RpcMethods::call(const Entry& entry, RpcValue::Array* params) const
{
  if (params->empty())
  {
    return rpcResult(-1, "missing required caller_id parameter", entry.on_error);
  }
  if (params->size() != entry.checks.size() + 1)
  {
    return rpcResult(-1, "Error: bad call arity", entry.on_error);
  }
  if (!isText((*params)[0]))
  {
    return rpcResult(-1, "caller_id must be a string", entry.on_error);
  }
  const std::string caller = std::move((*params)[0].as<std::string>());
  params->erase(params->begin());
  try
  {
    for (size_t index = 0; index < params->size(); ++index)
    {
      entry.checks[index](&(*params)[index], caller);
    }
    return entry.method(caller, *params);
  }
  catch (const RpcArgumentError& error)
  {
    return rpcResult(-1, error.what(), entry.on_error);
  }
}

RpcValue rpcResult(int code, std::string message, RpcValue value)
{
  RpcValue::Array result;
  result.reserve(3);
  result.emplace_back(code);
  result.emplace_back(std::move(message));
  result.push_back(std::move(value));
  return result;
}

namespace check
{
namespace
{

[[noreturn]] void reject(const std::string& name, const std::string& why)
{
  throw RpcArgumentError("ERROR: parameter [" + name + "] " + why);
}

void resolve(RpcValue* value, const std::string& caller)
{
  *value = resolveName(textOf(*value), caller);
}

}  // namespace

RpcMethods::Check any()
{
  return [](RpcValue*, const std::string&) {};
}

RpcMethods::Check notNil(const std::string& name)
{
  return [name](RpcValue* value, const std::string&)
  {
    if (value->is<RpcValue::Nil>())
    {
      reject(name, "must be specified");
    }
    if (value->containsNil())
    {
      reject(name, "contains nil, which cannot be handed out again");
    }
  };
}

RpcMethods::Check text(const std::string& name)
{
  return [name](RpcValue* value, const std::string&)
  {
    if (value->isFalsy())
    {
      reject(name, "must be specified and non-empty");
    }
    if (!isText(*value))
    {
      reject(name, "must be a string");
    }
  };
}

RpcMethods::Check api(const std::string& name)
{
  return [name](RpcValue* value, const std::string&)
  {
    if (!isText(*value) || value->isFalsy())
    {
      reject(name, "is not an XMLRPC URI");
    }
    if (textOf(*value).rfind("http://", 0) != 0 && textOf(*value).rfind("rosrpc://", 0) != 0)
    {
      reject(name, "is not an RPC URI");
    }
  };
}

RpcMethods::Check graphName(const std::string& name, bool may_be_root)
{
  return [name, may_be_root](RpcValue* value, const std::string& caller)
  {
    if (!isText(*value) || value->isFalsy())
    {
      reject(name, "must be a non-empty string");
    }
    if (textOf(*value).find_first_of(": ") != std::string::npos)
    {
      reject(name, "contains illegal chars");
    }
    if (!may_be_root && textOf(*value) == "/")
    {
      reject(name, "cannot be the global namespace");
    }
    resolve(value, caller);
  };
}

RpcMethods::Check graphNameOrEmpty(const std::string& name)
{
  return [name](RpcValue* value, const std::string& caller)
  {
    if (!isText(*value))
    {
      reject(name, "must be a string");
    }
    if (!value->isFalsy())
    {
      resolve(value, caller);
    }
  };
}

RpcMethods::Check typeName(const std::string& name)
{
  return [name](RpcValue* value, const std::string&)
  {
    if (!isText(*value) || value->isFalsy())
    {
      reject(name, "must be a non-empty string");
    }
    const std::string& type = textOf(*value);
    const size_t slash = type.find('/');
    if (type != "*" && (slash == std::string::npos || type.find('/', slash + 1) != std::string::npos))
    {
      reject(name, "is not a valid package resource name");
    }
  };
}

}  // namespace check

}  // namespace pi_os_transport
