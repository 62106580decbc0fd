#pragma once

#include <XmlRpcValue.h>

#include <map>
#include <sstream>
#include <stdexcept>
#include <string>
#include <type_traits>

namespace pi_node
{

/// Parameters of ROS as the parameter server has them, to and from fields of options. What is wrong is an
/// std::invalid_argument that goes on after the parameter's name: "= 5, must be true or false".
namespace parameters
{

inline std::string text(const XmlRpc::XmlRpcValue& value)
{
  std::ostringstream stream;
  value.write(stream);
  return stream.str();
}

inline void requireType(const XmlRpc::XmlRpcValue& value, XmlRpc::XmlRpcValue::Type type, const char* name)
{
  if (value.getType() != type)
  {
    throw std::invalid_argument("= " + text(value) + ", must be " + name);
  }
}

// The accessors of XmlRpcValue are not const in all versions, hence the copies below.
inline void read(XmlRpc::XmlRpcValue value, bool* field)
{
  requireType(value, XmlRpc::XmlRpcValue::TypeBoolean, "true or false");
  *field = static_cast<bool>(value);
}

template <typename Integer, std::enable_if_t<std::is_integral<Integer>::value, int> = 0>
void read(XmlRpc::XmlRpcValue value, Integer* field)
{
  requireType(value, XmlRpc::XmlRpcValue::TypeInt, "a whole number");
  const int number = static_cast<int>(value);
  if (std::is_unsigned<Integer>::value && number < 0)
  {
    throw std::invalid_argument("= " + std::to_string(number) + ", must be at least 0");
  }
  *field = static_cast<Integer>(number);
}

inline void read(XmlRpc::XmlRpcValue value, double* field)
{
  if (value.getType() == XmlRpc::XmlRpcValue::TypeInt)
  {
    *field = static_cast<int>(value);
    return;
  }
  requireType(value, XmlRpc::XmlRpcValue::TypeDouble, "a number");
  *field = static_cast<double>(value);
}

inline void read(XmlRpc::XmlRpcValue value, std::string* field)
{
  requireType(value, XmlRpc::XmlRpcValue::TypeString, "a text");
  *field = static_cast<std::string>(value);
}

template <typename Integer, std::enable_if_t<std::is_integral<Integer>::value, int> = 0>
XmlRpc::XmlRpcValue write(const Integer& field)
{
  return XmlRpc::XmlRpcValue(static_cast<int>(field));
}
inline XmlRpc::XmlRpcValue write(const bool& field)
{
  return XmlRpc::XmlRpcValue(field);
}
inline XmlRpc::XmlRpcValue write(const double& field)
{
  return XmlRpc::XmlRpcValue(field);
}
inline XmlRpc::XmlRpcValue write(const std::string& field)
{
  return XmlRpc::XmlRpcValue(field);
}

/// The parameters of a tree by the paths of their names.
inline void flatten(XmlRpc::XmlRpcValue tree, const std::string& path,
                    std::map<std::string, XmlRpc::XmlRpcValue>* leaves)
{
  for (auto& [name, value] : tree)
  {
    if (value.getType() == XmlRpc::XmlRpcValue::TypeStruct)
    {
      flatten(value, path + name + "/", leaves);
    }
    else
    {
      (*leaves)[path + name] = value;
    }
  }
}

/// @throws std::invalid_argument "name = value, must be bound" if it is not valid.
template <typename Value>
void require(bool valid, const char* name, const Value& value, const char* bound)
{
  if (!valid)
  {
    std::ostringstream stream;
    stream << name << " = " << value << ", must be " << bound;
    throw std::invalid_argument(stream.str());
  }
}

}  // namespace parameters
}  // namespace pi_node
