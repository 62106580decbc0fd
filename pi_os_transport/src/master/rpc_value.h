#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <utility>
#include <variant>
#include <vector>

namespace pi_os_transport
{

/// A value of XML-RPC: a parameter, argument or result. Copies are deep.
struct RpcValue
{
  using Array = std::vector<RpcValue>;
  using Struct = std::map<std::string, RpcValue, std::less<>>;
  /// Kept as received, because a master only passes them on.
  struct Binary
  {
    std::string base64;
    bool operator==(const Binary& other) const { return base64 == other.base64; }
  };
  struct DateTime
  {
    std::string iso8601;
    bool operator==(const DateTime& other) const { return iso8601 == other.iso8601; }
  };
  using Nil = std::monostate;

  RpcValue() = default;
  RpcValue(bool value) : data(value) {}
  RpcValue(int32_t value) : data(value) {}
  RpcValue(double value) : data(value) {}
  RpcValue(const char* value) : data(std::string(value)) {}
  RpcValue(std::string value) : data(std::move(value)) {}
  RpcValue(Binary value) : data(std::move(value)) {}
  RpcValue(DateTime value) : data(std::move(value)) {}
  RpcValue(Array value) : data(std::move(value)) {}
  RpcValue(Struct value) : data(std::move(value)) {}

  template <typename Type>
  bool is() const
  {
    return std::holds_alternative<Type>(data);
  }
  /// Call only if is() is true.
  template <typename Type>
  const Type& as() const
  {
    return std::get<Type>(data);
  }
  template <typename Type>
  Type& as()
  {
    return std::get<Type>(data);
  }
  /// Null if the value is no list.
  const Array* array() const { return std::get_if<Array>(&data); }
  /// True for zero, false and empty values. ROS's own master uses this test, from Python, for missing arguments.
  bool isFalsy() const;
  /// True if the value is or contains nil, which is not part of XML-RPC.
  bool containsNil() const;

  bool operator==(const RpcValue& other) const { return data == other.data; }
  bool operator!=(const RpcValue& other) const { return !(*this == other); }

  std::variant<Nil, bool, int32_t, double, std::string, Binary, DateTime, Array, Struct> data;
};

}  // namespace pi_os_transport
