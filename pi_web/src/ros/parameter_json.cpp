#include "ros/parameter_json.h"

#include <cmath>
#include <limits>
#include <stdexcept>

namespace pi_web
{
namespace
{

using nlohmann::json;
using XmlRpc::XmlRpcValue;

constexpr int MAX_DEPTH = 20;
constexpr size_t MAX_PARAMETERS = 5000;  // in an answer

}  // namespace

json toJson(XmlRpcValue value)
{
  switch (value.getType())
  {
    case XmlRpcValue::TypeBoolean:
      return static_cast<bool>(value);
    case XmlRpcValue::TypeInt:
      return static_cast<int>(value);
    case XmlRpcValue::TypeDouble:
      return std::isfinite(static_cast<double>(value)) ? json(static_cast<double>(value)) : json();
    case XmlRpcValue::TypeString:
      return static_cast<std::string>(value);
    case XmlRpcValue::TypeArray:
    {
      json list = json::array();
      for (int i = 0; i < value.size(); ++i)
      {
        list.push_back(toJson(value[i]));
      }
      return list;
    }
    case XmlRpcValue::TypeStruct:
    {
      json object = json::object();
      for (auto& [name, field] : value)
      {
        object[name] = toJson(field);
      }
      return object;
    }
    default:
      return "(a value that JSON does not have)";
  }
}

XmlRpcValue fromJson(const json& value, int depth)
{
  if (depth > MAX_DEPTH)
  {
    throw std::invalid_argument("a value is nested more than " + std::to_string(MAX_DEPTH) + " deep");
  }
  switch (value.type())
  {
    case json::value_t::boolean:
      return XmlRpcValue(value.get<bool>());
    case json::value_t::string:
      return XmlRpcValue(value.get<std::string>());
    case json::value_t::number_float:
      return XmlRpcValue(value.get<double>());
    case json::value_t::number_integer:
    case json::value_t::number_unsigned:
      if (value > std::numeric_limits<int>::max() || value < std::numeric_limits<int>::min())
      {
        throw std::invalid_argument(value.dump() + " is beyond the integers of the parameter server; add .0");
      }
      return XmlRpcValue(value.get<int>());
    case json::value_t::array:
    {
      XmlRpcValue list;
      list.setSize(static_cast<int>(value.size()));
      for (size_t i = 0; i < value.size(); ++i)
      {
        list[static_cast<int>(i)] = fromJson(value[i], depth + 1);
      }
      return list;
    }
    case json::value_t::object:
    {
      XmlRpcValue object;
      object.begin();  // an empty one is a struct, too
      for (const auto& [name, field] : value.items())
      {
        object[name] = fromJson(field, depth + 1);
      }
      return object;
    }
    default:
      throw std::invalid_argument("the parameter server has no " + std::string(value.type_name()));
  }
}

namespace
{

/// A tree of parameters as "/a/b": value; structs are the branches.
void flatten(const std::string& name, XmlRpcValue value, json* list)
{
  if (value.getType() != XmlRpcValue::TypeStruct)
  {
    list->push_back({{"name", name}, {"value", toJson(value)}});
    return;
  }
  for (auto& [part, field] : value)
  {
    flatten((name == "/" ? name : name + "/") + part, field, list);
  }
}

OutMessage parameterValues(const json& list, const std::string& id)
{
  json object = {{"op", "parameterValues"}, {"parameters", list}};
  if (!id.empty())
  {
    object["id"] = id;
  }
  return textMessage(object);
}

}  // namespace

OutMessage answerTo(const request::GetParameters& request, const GraphReader& reader)
{
  json list = json::array();
  if (request.names.empty())
  {
    flatten("/", reader.master("getParam", {std::string("/")}), &list);
  }
  for (const std::string& name : request.names)
  {
    try
    {
      list.push_back({{"name", name}, {"value", toJson(reader.master("getParam", {name}))}});
    }
    catch (const std::runtime_error&)
    {
      list.push_back({{"name", name}});  // there is none
    }
  }
  if (list.size() > MAX_PARAMETERS)
  {
    throw std::invalid_argument(std::to_string(list.size()) + " parameters are too many; ask for some by name");
  }
  return parameterValues(list, request.id);
}

OutMessage answerTo(const request::SetParameters& request, const GraphReader& reader)
{
  json list = json::array();
  for (const auto& [name, value] : request.values)
  {
    value.is_null() ? reader.master("deleteParam", {name}) : reader.master("setParam", {name, fromJson(value)});
    list.push_back(value.is_null() ? json({{"name", name}}) : json({{"name", name}, {"value", value}}));
  }
  return parameterValues(list, request.id);
}

}  // namespace pi_web
