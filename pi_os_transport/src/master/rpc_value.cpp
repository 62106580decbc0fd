#include "master/rpc_value.h"

#include <algorithm>

namespace pi_os_transport
{
namespace
{

struct Falsy
{
  bool operator()(RpcValue::Nil) const { return true; }
  bool operator()(bool value) const { return !value; }
  bool operator()(int32_t value) const { return value == 0; }
  bool operator()(double value) const { return value == 0.0; }
  bool operator()(const std::string& value) const { return value.empty(); }
  bool operator()(const RpcValue::Binary&) const { return false; }
  bool operator()(const RpcValue::DateTime&) const { return false; }
  bool operator()(const RpcValue::Array& value) const { return value.empty(); }
  bool operator()(const RpcValue::Struct& value) const { return value.empty(); }
};

}  // namespace

bool RpcValue::isFalsy() const
{
  return std::visit(Falsy(), data);
}

bool RpcValue::containsNil() const
{
  if (is<Array>())
  {
    return std::any_of(as<Array>().begin(), as<Array>().end(), [](const RpcValue& one) { return one.containsNil(); });
  }
  if (is<Struct>())
  {
    return std::any_of(as<Struct>().begin(), as<Struct>().end(),
                       [](const auto& member) { return member.second.containsNil(); });
  }
  return is<Nil>();
}

}  // namespace pi_os_transport
