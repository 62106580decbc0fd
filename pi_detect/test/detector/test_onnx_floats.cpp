#include <gtest/gtest.h>

#include <opencv2/core/cvdef.h>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <iterator>
#include <opencv2/dnn.hpp>
#include <string>
#include <vector>

#include "detector/onnx_floats.h"

namespace pi_detect
{
namespace
{

constexpr uint64_t FLOAT = 1;
constexpr uint64_t HALF = 10;

// What onnx.proto3 calls the fields is beside each number below.

std::string varint(uint64_t value)
{
  std::string text;
  for (; value >= 0x80; value >>= 7)
  {
    text.push_back(static_cast<char>(value | 0x80));
  }
  text.push_back(static_cast<char>(value));
  return text;
}

std::string number(uint64_t field, uint64_t value)
{
  return varint(field << 3) + varint(value);
}

std::string bytes(uint64_t field, const std::string& content)
{
  return varint(field << 3 | 2) + varint(content.size()) + content;
}

uint16_t halfOf(float value)
{
  const cv::float16_t half(value);
  uint16_t bits;
  std::memcpy(&bits, static_cast<const void*>(&half), sizeof(bits));
  return bits;
}

/// Weights of a 1 x 1 convolution from 3 channels to 1, or its bias.
std::string tensor(const std::string& name, const std::vector<uint64_t>& dims, const std::vector<float>& values,
                   uint64_t kind, bool as_integers)
{
  std::string content;
  for (const uint64_t dim : dims)
  {
    content += number(1, dim);  // dims
  }
  content += number(2, kind) + bytes(8, name);  // data_type, name
  std::string raw;
  for (const float value : values)
  {
    const uint16_t half = halfOf(value);
    if (as_integers)
    {
      raw += varint(half);
    }
    else if (kind == HALF)
    {
      raw.append(reinterpret_cast<const char*>(&half), sizeof(half));
    }
    else
    {
      raw.append(reinterpret_cast<const char*>(&value), sizeof(value));
    }
  }
  return content + bytes(as_integers ? 5 : 9, raw);  // int32_data or raw_data
}

std::string valueInfo(const std::string& name, const std::vector<uint64_t>& dims, uint64_t kind)
{
  std::string shape;
  for (const uint64_t dim : dims)
  {
    shape += bytes(1, number(1, dim));  // dim, dim_value
  }
  return bytes(1, name) + bytes(2, bytes(1, number(1, kind) + bytes(2, shape)));  // name; type: tensor: element, shape
}

/// A cast, then weights and bias of the kind.
std::string convolution(uint64_t kind, bool as_integers = false)
{
  const std::string cast_to = bytes(1, "to") + number(3, kind) + number(20, 2);  // name, i, type: integer
  const std::string cast = bytes(1, "image") + bytes(2, "wide") + bytes(4, "Cast") + bytes(5, cast_to);
  const std::string kernel = bytes(1, "kernel_shape") + number(8, 1) + number(8, 1) + number(20, 7);  // ints
  const std::string node =
      bytes(1, "wide") + bytes(1, "weights") + bytes(1, "bias") + bytes(2, "sum") + bytes(4, "Conv") + bytes(5, kernel);
  const std::string graph = bytes(1, cast) + bytes(1, node) + bytes(2, "graph") +
                            bytes(5, tensor("weights", {1, 3, 1, 1}, {0.5F, -0.25F, 2.0F}, kind, as_integers)) +
                            bytes(5, tensor("bias", {1}, {0.125F}, kind, false)) +
                            bytes(11, valueInfo("image", {1, 3, 2, 2}, FLOAT)) +
                            bytes(12, valueInfo("sum", {1, 1, 2, 2}, kind));
  return number(1, 7) + bytes(8, number(2, 11)) + bytes(7, graph);  // version; operator set; graph
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

}  // namespace
}  // namespace pi_detect
