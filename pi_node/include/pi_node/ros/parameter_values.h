#pragma once

#include <XmlRpcValue.h>

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <initializer_list>
#include <map>
#include <sstream>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <vector>

namespace pi_node
{

/// One parameter to and from one field. parameter_tree.h does the same for all fields of an options struct, by these
/// functions. An error is an std::invalid_argument whose text follows the parameter's name: "= 5, must be true or
/// false".
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

inline void read(XmlRpc::XmlRpcValue value, float* field)
{
  double number = 0.0;
  read(value, &number);
  *field = static_cast<float>(number);
}

template <typename Period>
void read(XmlRpc::XmlRpcValue value, std::chrono::duration<int64_t, Period>* field)
{
  int number = 0;
  read(value, &number);
  *field = std::chrono::duration<int64_t, Period>(number);
}

inline void read(XmlRpc::XmlRpcValue value, std::string* field)
{
  requireType(value, XmlRpc::XmlRpcValue::TypeString, "a text");
  *field = static_cast<std::string>(value);
}

/// Elements of a type of their own are read by the read() of their namespace.
/// @param kind  what the parameter must be.
template <typename Element>
void read(XmlRpc::XmlRpcValue value, std::vector<Element>* field, const char* kind = "a list")
{
  requireType(value, XmlRpc::XmlRpcValue::TypeArray, kind);
  field->assign(static_cast<size_t>(value.size()), Element());
  for (int i = 0; i < value.size(); ++i)
  {
    read(value[i], &(*field)[static_cast<size_t>(i)]);
  }
}

inline void read(XmlRpc::XmlRpcValue value, std::vector<std::string>* field)
{
  read<std::string>(value, field, "a list of texts");
}

/// For the read() of an enum whose toString() gives the names. @param choices  those that are allowed.
template <typename Choice>
void readChoice(const XmlRpc::XmlRpcValue& value, std::initializer_list<Choice> choices, Choice* field)
{
  std::string name;
  read(value, &name);
  std::string names;
  size_t left = choices.size();
  for (const Choice choice : choices)
  {
    if (name == toString(choice))
    {
      *field = choice;
      return;
    }
    --left;
    names += std::string(toString(choice)) + (left == 0 ? "" : left == 1 ? " or " : ", ");
  }
  throw std::invalid_argument("= \"" + name + "\", must be " + names);
}

template <typename Choice, std::enable_if_t<std::is_enum<Choice>::value, int> = 0>
XmlRpc::XmlRpcValue write(const Choice& field)
{
  return XmlRpc::XmlRpcValue(toString(field));
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

/// With the digits that a float has.
inline XmlRpc::XmlRpcValue write(const float& field)
{
  char text[32];
  std::snprintf(text, sizeof text, "%.7g", static_cast<double>(field));
  return XmlRpc::XmlRpcValue(std::stod(text));
}
template <typename Period>
XmlRpc::XmlRpcValue write(const std::chrono::duration<int64_t, Period>& field)
{
  return XmlRpc::XmlRpcValue(static_cast<int>(field.count()));
}
template <typename Element>
XmlRpc::XmlRpcValue write(const std::vector<Element>& field)
{
  XmlRpc::XmlRpcValue value;
  value.setSize(static_cast<int>(field.size()));
  for (size_t i = 0; i < field.size(); ++i)
  {
    value[static_cast<int>(i)] = write(field[i]);
  }
  return value;
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
