#include "detector/onnx_floats.h"

#include <opencv2/core/cvdef.h>
#include <cstdint>
#include <cstring>
#include <stdexcept>
#include <string_view>
#include <vector>

namespace pi_detect
{
namespace
{

// Field numbers of onnx.proto3; the format stays compatible by never reusing one.
constexpr uint64_t MODEL_GRAPH = 7;
constexpr uint64_t GRAPH_NODE = 1;
constexpr uint64_t GRAPH_INITIALIZER = 5;
constexpr uint64_t GRAPH_VALUES[] = {11, 12, 13};  // input, output, value_info
constexpr uint64_t NODE_OPERATOR = 4;
constexpr uint64_t NODE_ATTRIBUTE = 5;
constexpr uint64_t ATTRIBUTE_NAME = 1;
constexpr uint64_t ATTRIBUTE_INTEGER = 3;
constexpr uint64_t ATTRIBUTE_TENSORS[] = {5, 10};  // t, tensors
constexpr uint64_t ATTRIBUTE_GRAPHS[] = {6, 11};   // g, graphs
constexpr uint64_t VALUE_TYPE = 2;
constexpr uint64_t TYPE_TENSOR = 1;
constexpr uint64_t TENSOR_TYPE_ELEMENT = 1;
constexpr uint64_t TENSOR_KIND = 2;
constexpr uint64_t TENSOR_INT32 = 5;  // halves as integers, where there are no raw bytes
constexpr uint64_t TENSOR_RAW = 9;
constexpr uint64_t TENSOR_EXTERNAL = 13;
constexpr uint64_t FLOAT_KIND = 1;
constexpr uint64_t HALF_KIND = 10;

enum WireType : uint64_t
{
  VARINT = 0,
  EIGHT_BYTES = 1,
  BYTES = 2,
  FOUR_BYTES = 5,
};

struct Field
{
  uint64_t number = 0;
  uint64_t wire = VARINT;
  uint64_t integer = 0;    ///< VARINT
  std::string_view bytes;  ///< BYTES: the content; fixed sizes: the value
};

/// Takes a protocol buffer's message apart.
class FieldReader
{
public:
  explicit FieldReader(std::string_view message) : rest_(message) {}

  bool next(Field* field)
  {
    if (rest_.empty())
    {
      return false;
    }
    const uint64_t tag = varint();
    *field = {tag >> 3, tag & 7, 0, {}};
    switch (field->wire)
    {
      case VARINT:
        field->integer = varint();
        return true;
      case EIGHT_BYTES:
        field->bytes = take(8);
        return true;
      case BYTES:
        field->bytes = take(varint());
        return true;
      case FOUR_BYTES:
        field->bytes = take(4);
        return true;
      default:
        throw std::runtime_error("it is no ONNX model, or damaged");
    }
  }

  uint64_t varint()
  {
    uint64_t value = 0;
    for (unsigned shift = 0; shift < 64; shift += 7)
    {
      const auto byte = static_cast<uint8_t>(take(1)[0]);
      value |= static_cast<uint64_t>(byte & 0x7F) << shift;
      if ((byte & 0x80) == 0)
      {
        return value;
      }
    }
    throw std::runtime_error("it is no ONNX model, or damaged");
  }

  bool empty() const { return rest_.empty(); }

private:
  std::string_view take(uint64_t count)
  {
    if (count > rest_.size())
    {
      throw std::runtime_error("the file ends early: it is no ONNX model, or damaged");
    }
    const std::string_view bytes = rest_.substr(0, count);
    rest_.remove_prefix(count);
    return bytes;
  }

  std::string_view rest_;
};

void appendVarint(uint64_t value, std::string* to)
{
  for (; value >= 0x80; value >>= 7)
  {
    to->push_back(static_cast<char>(value | 0x80));
  }
  to->push_back(static_cast<char>(value));
}

void append(const Field& field, std::string* to)
{
  appendVarint(field.number << 3 | field.wire, to);
  if (field.wire == VARINT)
  {
    appendVarint(field.integer, to);
    return;
  }
  if (field.wire == BYTES)
  {
    appendVarint(field.bytes.size(), to);
  }
  to->append(field.bytes);
}

template <size_t N>
bool isOneOf(uint64_t number, const uint64_t (&numbers)[N])
{
  for (const uint64_t one : numbers)
  {
    if (one == number)
    {
      return true;
    }
  }
  return false;
}

/// A message whose fields `change` may replace. @param change  (Field* field, std::string* storage): whether it did.
template <typename Change>
std::string rewrite(std::string_view message, Change&& change)
{
  std::string result;
  result.reserve(message.size());
  FieldReader reader(message);
  for (Field field; reader.next(&field);)
  {
    std::string storage;
    change(&field, &storage);
    append(field, &result);
  }
  return result;
}

/// Replaces the content of a field that is a message.
template <typename Function>
void replace(Field* field, std::string* storage, Function&& function)
{
  *storage = function(field->bytes);
  field->bytes = *storage;
}

/// A message in which all fields of a number are replaced by function(content).
template <typename Function>
std::string rewriteFields(std::string_view message, uint64_t number, Function&& function)
{
  return rewrite(message,
                 [number, &function](Field* field, std::string* storage)
                 {
                   if (field->number == number && field->wire == BYTES)
                   {
                     replace(field, storage, function);
                   }
                 });
}

void appendFloat(uint16_t half, std::string* to)
{
  cv::float16_t value;
  std::memcpy(static_cast<void*>(&value), &half, sizeof(half));
  const float wide = static_cast<float>(value);
  to->append(reinterpret_cast<const char*>(&wide), sizeof(wide));
}

bool isHalfTensor(std::string_view tensor)
{
  FieldReader reader(tensor);
  for (Field field; reader.next(&field);)
  {
    if (field.number == TENSOR_KIND)
    {
      return field.integer == HALF_KIND;
    }
  }
  return false;
}

std::string convertTensor(std::string_view tensor)
{
  if (!isHalfTensor(tensor))
  {
    return std::string(tensor);
  }
  std::string floats;
  std::string result;
  FieldReader reader(tensor);
  for (Field field; reader.next(&field);)
  {
    if (field.number == TENSOR_KIND)
    {
      field.integer = FLOAT_KIND;
      append(field, &result);
    }
    else if (field.number == TENSOR_RAW)
    {
      for (size_t i = 0; i + sizeof(uint16_t) <= field.bytes.size(); i += sizeof(uint16_t))
      {
        uint16_t half;
        std::memcpy(&half, field.bytes.data() + i, sizeof(half));
        appendFloat(half, &floats);
      }
    }
    else if (field.number == TENSOR_INT32 && field.wire == BYTES)
    {
      for (FieldReader packed(field.bytes); !packed.empty();)
      {
        appendFloat(static_cast<uint16_t>(packed.varint()), &floats);
      }
    }
    else if (field.number == TENSOR_INT32)
    {
      appendFloat(static_cast<uint16_t>(field.integer), &floats);
    }
    else if (field.number == TENSOR_EXTERNAL)
    {
      throw std::runtime_error("its weights lie in other files: export it as one file");
    }
    else
    {
      append(field, &result);
    }
  }
  append({TENSOR_RAW, BYTES, 0, floats}, &result);
  return result;
}

std::string convertTensorType(std::string_view type)
{
  return rewrite(type,
                 [](Field* field, std::string*)
                 {
                   if (field->number == TENSOR_TYPE_ELEMENT && field->integer == HALF_KIND)
                   {
                     field->integer = FLOAT_KIND;
                   }
                 });
}

std::string convertType(std::string_view type)
{
  return rewriteFields(type, TYPE_TENSOR, convertTensorType);
}

std::string convertValue(std::string_view value)
{
  return rewriteFields(value, VALUE_TYPE, convertType);
}

std::string convertGraph(std::string_view graph);

/// @param casts  the attribute belongs to a Cast, whose "to" is a type.
std::string convertAttribute(std::string_view attribute, bool casts)
{
  bool is_target = false;
  FieldReader reader(attribute);
  for (Field field; casts && reader.next(&field);)
  {
    is_target = is_target || (field.number == ATTRIBUTE_NAME && field.bytes == "to");
  }
  return rewrite(attribute,
                 [is_target](Field* field, std::string* storage)
                 {
                   if (isOneOf(field->number, ATTRIBUTE_TENSORS) && field->wire == BYTES)
                   {
                     replace(field, storage, convertTensor);
                   }
                   else if (isOneOf(field->number, ATTRIBUTE_GRAPHS) && field->wire == BYTES)
                   {
                     replace(field, storage, convertGraph);
                   }
                   else if (is_target && field->number == ATTRIBUTE_INTEGER && field->integer == HALF_KIND)
                   {
                     field->integer = FLOAT_KIND;
                   }
                 });
}

std::string convertNode(std::string_view node)
{
  bool casts = false;
  FieldReader reader(node);
  for (Field field; reader.next(&field);)
  {
    casts = casts || (field.number == NODE_OPERATOR && field.bytes == "Cast");
  }
  return rewriteFields(node, NODE_ATTRIBUTE,
                       [casts](std::string_view attribute) { return convertAttribute(attribute, casts); });
}

std::string convertGraph(std::string_view graph)
{
  return rewrite(graph,
                 [](Field* field, std::string* storage)
                 {
                   if (field->wire != BYTES)
                   {
                     return;
                   }
                   if (field->number == GRAPH_NODE)
                   {
                     replace(field, storage, convertNode);
                   }
                   else if (field->number == GRAPH_INITIALIZER)
                   {
                     replace(field, storage, convertTensor);
                   }
                   else if (isOneOf(field->number, GRAPH_VALUES))
                   {
                     replace(field, storage, convertValue);
                   }
                 });
}

}  // namespace

std::string withFloats(const std::string& model)
{
  return rewriteFields(model, MODEL_GRAPH, convertGraph);
}

}  // namespace pi_detect
