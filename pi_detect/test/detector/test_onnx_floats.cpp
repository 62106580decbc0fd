#include <gtest/gtest.h>
#include <onnx/onnx_pb.h>

#include <cstdint>
#include <cstring>
#include <fstream>
#include <iterator>
#include <opencv2/core.hpp>
#include <opencv2/dnn.hpp>
#include <string>
#include <vector>

#include "detector/onnx_floats.h"

namespace pi_detect
{
namespace
{

constexpr auto FLOAT = onnx::TensorProto::FLOAT;
constexpr auto HALF = onnx::TensorProto::FLOAT16;

void addWeights(const std::string& name, const std::vector<int64_t>& dims, const std::vector<float>& values, int kind,
                bool as_integers, onnx::GraphProto* graph)
{
  onnx::TensorProto* tensor = graph->add_initializer();
  tensor->set_name(name);
  *tensor->mutable_dims() = {dims.begin(), dims.end()};
  tensor->set_data_type(kind);
  cv::Mat halves;
  cv::Mat(values).convertTo(halves, CV_16F);
  if (as_integers)
  {
    for (size_t i = 0; i < values.size(); ++i)
    {
      tensor->add_int32_data(halves.ptr<uint16_t>()[i]);
    }
  }
  else if (kind == HALF)
  {
    tensor->set_raw_data(halves.data, values.size() * sizeof(uint16_t));
  }
  else
  {
    tensor->set_raw_data(values.data(), values.size() * sizeof(float));
  }
}

void describe(const std::string& name, const std::vector<int64_t>& dims, int kind, onnx::ValueInfoProto* value)
{
  value->set_name(name);
  onnx::TypeProto::Tensor* type = value->mutable_type()->mutable_tensor_type();
  type->set_elem_type(kind);
  for (const int64_t dim : dims)
  {
    type->mutable_shape()->add_dim()->set_dim_value(dim);
  }
}

/// A cast, then a 1 x 1 convolution from 3 channels to 1 with weights and bias of the kind.
std::string convolution(int kind, bool as_integers = false)
{
  onnx::ModelProto model;
  model.set_ir_version(7);
  model.add_opset_import()->set_version(11);
  onnx::GraphProto* graph = model.mutable_graph();
  graph->set_name("graph");
  onnx::NodeProto* cast = graph->add_node();
  cast->set_op_type("Cast");
  cast->add_input("image");
  cast->add_output("wide");
  onnx::AttributeProto* to = cast->add_attribute();
  to->set_name("to");
  to->set_i(kind);
  to->set_type(onnx::AttributeProto::INT);
  onnx::NodeProto* node = graph->add_node();
  node->set_op_type("Conv");
  for (const char* input : {"wide", "weights", "bias"})
  {
    node->add_input(input);
  }
  node->add_output("sum");
  onnx::AttributeProto* kernel = node->add_attribute();
  kernel->set_name("kernel_shape");
  kernel->add_ints(1);
  kernel->add_ints(1);
  kernel->set_type(onnx::AttributeProto::INTS);
  addWeights("weights", {1, 3, 1, 1}, {0.5F, -0.25F, 2.0F}, kind, as_integers, graph);
  addWeights("bias", {1}, {0.125F}, kind, false, graph);
  describe("image", {1, 3, 2, 2}, FLOAT, graph->add_input());
  describe("sum", {1, 1, 2, 2}, kind, graph->add_output());
  return model.SerializeAsString();
}

cv::Mat run(const std::string& model)
{
  cv::dnn::Net net = cv::dnn::readNetFromONNX(model.data(), model.size());
  const int shape[] = {1, 3, 2, 2};
  cv::Mat image(4, shape, CV_32F);
  for (int i = 0; i < 12; ++i)
  {
    image.ptr<float>()[i] = static_cast<float>(i);
  }
  net.setInput(image);
  return net.forward().clone();
}

TEST(OnnxFloats, GiveTheResultOfTheSameNetworkInFloats)
{
  const cv::Mat expected = run(convolution(FLOAT));
  for (const bool as_integers : {false, true})
  {
    const cv::Mat result = run(withFloats(convolution(HALF, as_integers)));
    ASSERT_EQ(expected.total(), result.total());
    ASSERT_EQ(CV_32F, result.type());
    EXPECT_EQ(0, std::memcmp(expected.data, result.data, expected.total() * sizeof(float))) << as_integers;
  }
  EXPECT_FLOAT_EQ(0.5F * 1 - 0.25F * 5 + 2.0F * 9 + 0.125F, expected.ptr<float>()[1]);
}

TEST(OnnxFloats, LeaveAModelWithoutHalvesAsItIs)
{
  EXPECT_EQ(convolution(FLOAT), withFloats(convolution(FLOAT)));
  std::ifstream file(STREET_ONNX, std::ios::binary);
  const std::string street((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
  ASSERT_FALSE(street.empty());
  EXPECT_EQ(street, withFloats(street));
}

TEST(OnnxFloats, RefuseWhatEndsEarlyOrIsNoModel)
{
  const std::string model = convolution(HALF);
  for (size_t size : {size_t{3}, model.size() / 2, model.size() - 1})
  {
    EXPECT_THROW(withFloats(model.substr(0, size)), std::runtime_error) << size;
  }
  EXPECT_THROW(withFloats(std::string(100, '\xff')), std::runtime_error);
}

TEST(OnnxFloats, RefuseWeightsInOtherFiles)
{
  onnx::ModelProto model;
  ASSERT_TRUE(model.ParseFromString(convolution(HALF)));
  model.mutable_graph()->mutable_initializer(0)->set_data_location(onnx::TensorProto::EXTERNAL);
  EXPECT_THROW(withFloats(model.SerializeAsString()), std::runtime_error);
}

}  // namespace
}  // namespace pi_detect
