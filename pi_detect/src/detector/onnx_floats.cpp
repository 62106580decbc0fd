#include "detector/onnx_floats.h"

#include <onnx/onnx_pb.h>
#include <cstdint>
#include <cstring>
#include <opencv2/core.hpp>
#include <stdexcept>
#include <vector>

namespace pi_detect
{
namespace
{

constexpr auto HALF = onnx::TensorProto::FLOAT16;
constexpr auto FLOAT = onnx::TensorProto::FLOAT;

// Each returns whether there was a half.

bool widen(onnx::TensorProto* tensor)
{
  if (tensor->data_type() != HALF)
  {
    return false;
  }
  if (tensor->data_location() == onnx::TensorProto::EXTERNAL)
  {
    throw std::runtime_error("its weights lie in other files: export it as one file");
  }
  // Halves lie in raw bytes, or one in each integer.
  std::vector<uint16_t> halves(tensor->int32_data().begin(), tensor->int32_data().end());
  if (tensor->has_raw_data())
  {
    halves.resize(tensor->raw_data().size() / sizeof(uint16_t));
    std::memcpy(halves.data(), tensor->raw_data().data(), halves.size() * sizeof(uint16_t));
  }
  const cv::Mat narrow(1, static_cast<int>(halves.size()), CV_16F, halves.data());
  cv::Mat wide;
  narrow.convertTo(wide, CV_32F);
  tensor->clear_int32_data();
  tensor->set_raw_data(wide.data, wide.total() * wide.elemSize());
  tensor->set_data_type(FLOAT);
  return true;
}

bool widen(onnx::ValueInfoProto* value)
{
  if (!value->type().has_tensor_type() || value->type().tensor_type().elem_type() != HALF)
  {
    return false;
  }
  value->mutable_type()->mutable_tensor_type()->set_elem_type(FLOAT);
  return true;
}

bool widen(onnx::NodeProto* node);
bool widen(onnx::GraphProto* graph);

template <typename Messages>
bool widenAll(Messages* messages)
{
  bool any = false;
  for (auto& message : *messages)
  {
    any = widen(&message) || any;
  }
  return any;
}

bool widen(onnx::NodeProto* node)
{
  bool any = false;
  for (onnx::AttributeProto& attribute : *node->mutable_attribute())
  {
    if (node->op_type() == "Cast" && attribute.name() == "to" && attribute.i() == HALF)
    {
      attribute.set_i(FLOAT);
      any = true;
    }
    any = (attribute.has_t() && widen(attribute.mutable_t())) || any;
    any = (attribute.has_g() && widen(attribute.mutable_g())) || any;
    any = widenAll(attribute.mutable_tensors()) || any;
    any = widenAll(attribute.mutable_graphs()) || any;
  }
  return any;
}

bool widen(onnx::GraphProto* graph)
{
  bool any = widenAll(graph->mutable_node());
  any = widenAll(graph->mutable_initializer()) || any;
  any = widenAll(graph->mutable_input()) || any;
  any = widenAll(graph->mutable_output()) || any;
  return widenAll(graph->mutable_value_info()) || any;
}

}  // namespace

std::string withFloats(const std::string& model)
{
  onnx::ModelProto parsed;
  if (!parsed.ParseFromString(model))
  {
    throw std::runtime_error("it is no ONNX model, or damaged: get it again");
  }
  return widen(parsed.mutable_graph()) ? parsed.SerializeAsString() : model;
}

}  // namespace pi_detect
