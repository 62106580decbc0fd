#include "drive_work.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <random>
#include <string>
#include <thread>

#include <pi_runtime/opencl_command.h>
#include "runtime_bench.h"

namespace pi_runtime_bench
{
namespace
{

using pi_runtime::Access;
using pi_runtime::Argument;
using pi_runtime::Buffer;
using pi_runtime::BufferPtr;
using pi_runtime::Codelet;
using pi_runtime::CodeletPtr;
using pi_runtime::ImageView;
using pi_runtime::NativeCall;
using pi_runtime::NdRange;
using pi_runtime::OpenClCommand;
using pi_runtime::kernels::Corner;
using pi_runtime::kernels::PyramidLayout;

constexpr int DISPARITY = 12;  ///< of the synthetic pictures [px]
constexpr int SEARCH = 64;     ///< disparities that are tried
constexpr int HALF_ROWS = 5;   ///< of the window that is compared
constexpr int WINDOW_COLUMNS = 16;
constexpr int FAST_THRESHOLD = 12;
constexpr float BIAS = 0.125f;  ///< of each layer
constexpr float MOST = 6.0f;    ///< at which its values are clipped

// The arithmetic of runNetwork(): one work item makes 8 pixels of a row.
constexpr char NETWORK_SOURCE[] = R"cl(
kernel void layer(global float* maps, global const float* weights, int from, int to, int first_row, int rows)
{
  const int x = 8 * get_global_id(0);
  const int y = first_row + get_global_id(1) % rows;
  const int c = get_global_id(1) / rows;
  float8 sum = 0.0f;
  for (int i = 0; i < CHANNELS; ++i)
  {
    global const float* in = maps + from + i * PLANE + y * STRIDE + x;
    global const float* w = weights + (c * CHANNELS + i) * 9;
    for (int r = 0; r < 3; ++r)
    {
      for (int k = 0; k < 3; ++k)
      {
        sum += w[3 * r + k] * vload8(0, in + r * STRIDE + k);
      }
    }
  }
  vstore8(clamp(sum + BIAS, 0.0f, MOST), 0, maps + to + c * PLANE + (y + 1) * STRIDE + x + 1);
}
)cl";

PyramidLayout layout()
{
  return PyramidLayout(FrontEndFrame::WIDTH, FrontEndFrame::HEIGHT, FrontEndFrame::LEVELS);
}

ImageView<const uint8_t> picture(const uint8_t* data)
{
  return {data, FrontEndFrame::WIDTH, FrontEndFrame::HEIGHT, FrontEndFrame::WIDTH};
}

/// Smooth structure of three sizes, and rectangles with sharp corners.
uint8_t sceneAt(int x, int y)
{
  const double smooth = 30.0 * std::sin(x * 0.031 + y * 0.017) + 18.0 * std::sin(x * 0.11 - y * 0.07);
  const auto cell = [](int value, int size) { return static_cast<uint32_t>((value + 4096) / size); };
  const uint32_t coarse = (cell(x, 23) * 2654435761u ^ cell(y, 19) * 2246822519u) * 3266489917u;
  const uint32_t fine = (cell(x, 9) * 668265263u ^ cell(y, 11) * 374761393u) * 2654435761u;
  const double value = 128.0 + smooth + ((coarse >> 24) - 127.5) * 0.35 + ((fine >> 24) - 127.5) * 0.25;
  return static_cast<uint8_t>(std::clamp(value, 0.0, 255.0));
}

std::vector<uint8_t> makePicture(int shift, uint32_t seed)
{
  std::mt19937 random(seed);
  std::normal_distribution<float> noise(0.0f, 1.5f);
  std::vector<uint8_t> pixels(static_cast<size_t>(FrontEndFrame::WIDTH) * FrontEndFrame::HEIGHT);
  for (int y = 0; y < FrontEndFrame::HEIGHT; ++y)
  {
    for (int x = 0; x < FrontEndFrame::WIDTH; ++x)
    {
      const float value = static_cast<float>(sceneAt(x + shift, y)) + noise(random);
      pixels[static_cast<size_t>(y) * FrontEndFrame::WIDTH + static_cast<size_t>(x)] =
          static_cast<uint8_t>(std::clamp(value, 0.0f, 255.0f));
    }
  }
  return pixels;
}

int differenceOf(const ImageView<const uint8_t>& left, const ImageView<const uint8_t>& right, int x_left, int x_right,
                 int y)
{
  int sum = 0;
  for (int dy = -HALF_ROWS; dy <= HALF_ROWS; ++dy)
  {
    const uint8_t* const a = left.row(y + dy) + x_left - WINDOW_COLUMNS / 2;
    const uint8_t* const b = right.row(y + dy) + x_right - WINDOW_COLUMNS / 2;
    for (int k = 0; k < WINDOW_COLUMNS; ++k)
    {
      sum += std::abs(a[k] - b[k]);
    }
  }
  return sum;
}

/// -1 for a corner too near to the border.
int32_t disparityOf(const ImageView<const uint8_t>& left, const ImageView<const uint8_t>& right, const Corner& corner)
{
  const int x = corner.x;
  const int y = corner.y;
  if (x < SEARCH + WINDOW_COLUMNS / 2 || x + WINDOW_COLUMNS / 2 > left.width || y < HALF_ROWS ||
      y + HALF_ROWS >= left.height)
  {
    return -1;
  }
  int32_t best = 0;
  int least = differenceOf(left, right, x, x, y);
  for (int32_t disparity = 1; disparity < SEARCH; ++disparity)
  {
    const int difference = differenceOf(left, right, x, x - disparity, y);
    if (difference < least)
    {
      least = difference;
      best = disparity;
    }
  }
  return best;
}

/// One row of one output channel. The loop over a row inside the others lets the compiler use vectors.
void networkRow(const float* from, float* to, const float* weights, int channel, int y)
{
  std::array<float, Network::WIDTH> sum{};
  for (int i = 0; i < Network::CHANNELS; ++i)
  {
    const float* const w = weights + (channel * Network::CHANNELS + i) * 9;
    for (int r = 0; r < 3; ++r)
    {
      const float* const in = from + i * Network::PLANE + (y + r) * Network::STRIDE;
      for (int x = 0; x < Network::WIDTH; ++x)
      {
        sum[x] += w[3 * r] * in[x] + w[3 * r + 1] * in[x + 1] + w[3 * r + 2] * in[x + 2];
      }
    }
  }
  float* const out = to + channel * Network::PLANE + (y + 1) * Network::STRIDE + 1;
  for (int x = 0; x < Network::WIDTH; ++x)
  {
    out[x] = std::clamp(sum[x] + BIAS, 0.0f, MOST);
  }
}

void detectionOpenCl(OpenClCommand& command)
{
  const auto height = static_cast<uint64_t>(Network::HEIGHT);
  for (uint64_t row = command.begin(); row < command.end();)
  {
    const uint64_t layer = row / height;
    const uint64_t end = std::min(command.end(), (layer + 1) * height);
    const auto rows = static_cast<int32_t>(end - row);
    const auto map = static_cast<int32_t>(Network::MAP_FLOATS);
    const int32_t from = layer % 2 == 0 ? 0 : map;
    command.enqueue("layer", NdRange(Network::WIDTH / 8, static_cast<size_t>(rows) * Network::CHANNELS, 8, 1),
                    command.buffer(0), command.buffer(1), from, map - from, static_cast<int32_t>(row % height), rows);
    row = end;
  }
}

std::vector<float> networkInput()
{
  std::mt19937 random(3);
  std::uniform_real_distribution<float> value(0.0f, 1.0f);
  std::vector<float> maps(2 * Network::MAP_FLOATS, 0.0f);
  for (int channel = 0; channel < Network::CHANNELS; ++channel)
  {
    for (int y = 1; y <= Network::HEIGHT; ++y)
    {
      for (int x = 1; x <= Network::WIDTH; ++x)
      {
        maps[static_cast<size_t>(channel * Network::PLANE + y * Network::STRIDE + x)] = value(random);
      }
    }
  }
  return maps;
}

std::vector<float> networkWeights()
{
  // Variance 2 / inputs keeps the size of the values from layer to layer (He et al. 2015).
  std::mt19937 random(4);
  std::normal_distribution<float> value(0.0f, std::sqrt(2.0f / (9.0f * Network::CHANNELS)));
  std::vector<float> weights(Network::WEIGHT_FLOATS);
  std::generate(weights.begin(), weights.end(), [&] { return value(random); });
  return weights;
}

template <typename T>
BufferPtr filledBuffer(const std::vector<T>& values)
{
  BufferPtr buffer = Buffer::allocate(values.size() * sizeof(T));
  std::memcpy(buffer->address(), values.data(), buffer->bytes());
  return buffer;
}

/// The same for all frames: jobs only read it.
BufferPtr sharedPicture(bool right)
{
  static const BufferPtr pictures[] = {filledBuffer(makePicture(0, 1)), filledBuffer(makePicture(DISPARITY, 2))};
  return pictures[right ? 1 : 0];
}

/// CPU time of a call [s], so that other programs on the machine count little; its upper quartile over some tenths of a
/// second, as cores have quick and slow moments.
double typicalTime(const std::function<void()>& function)
{
  constexpr int RUNS = 41;
  const auto cpu_s = []
  {
    timespec time{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
    return static_cast<double>(time.tv_sec) + static_cast<double>(time.tv_nsec) * 1e-9;
  };
  std::vector<double> times_s;
  for (int run = 0; run < RUNS; ++run)
  {
    const double start_s = cpu_s();
    function();
    times_s.push_back(cpu_s() - start_s);
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  return quantile(times_s, 0.75);
}

}  // namespace

WorkSize WorkSize::forThisMachine()
{
  constexpr int SOME_POINTS = 200;
  const FrontEndMemory memory;
  const FrontEndFrame frame = memory.frame();
  const double none_s = typicalTime([&] { runFrontEnd(frame, 0); });
  const double some_s = typicalTime([&] { runFrontEnd(frame, SOME_POINTS); });
  const double wanted = SOME_POINTS * (DRIVE_FRONT_END.typical_s - none_s) / (some_s - none_s);
  WorkSize size;
  size.points = runFrontEnd(frame, static_cast<int>(std::clamp(wanted, 1.0, 1.0 * FrontEndFrame::MAX_CORNERS)));
  size.front_end_s = typicalTime([&] { runFrontEnd(frame, size.points); });
  const DetectionMemory network;
  const double layer_s = typicalTime(
      [&]
      {
        runNetwork(network.maps->hostAs<float>(Access::READ_WRITE), network.weights->hostAs<float>(Access::READ), 0,
                   Network::HEIGHT);
      });
  size.layers = static_cast<int32_t>(std::max(1.0, std::round(DRIVE_DETECTION.typical_s / layer_s)));
  return size;
}

int runFrontEnd(const FrontEndFrame& frame, int points)
{
  const PyramidLayout pyramid = layout();
  const ImageView<const uint8_t> left = picture(frame.left);
  const ImageView<const uint8_t> right = picture(frame.right);
  pi_runtime::kernels::buildPyramid(left, pyramid, frame.left_pyramid);
  pi_runtime::kernels::buildPyramid(right, pyramid, frame.right_pyramid);
  size_t corners = 0;
  for (int level = FrontEndFrame::LEVELS - 1; level >= 0; --level)
  {
    corners = pi_runtime::kernels::findFastCorners(pyramid.view(static_cast<const uint8_t*>(frame.left_pyramid), level),
                                                   FAST_THRESHOLD, frame.corners + level * FrontEndFrame::MAX_CORNERS,
                                                   FrontEndFrame::MAX_CORNERS);
  }
  const int listed = static_cast<int>(std::min<size_t>(corners, FrontEndFrame::MAX_CORNERS));
  const int count = std::min(points, listed);
  for (int i = 0; i < count; ++i)
  {
    // Spread over the picture: the list is ordered by rows.
    frame.disparities[i] = disparityOf(left, right, frame.corners[static_cast<long>(i) * listed / count]);
  }
  return count;
}

void runNetwork(float* maps, const float* weights, uint64_t begin, uint64_t end)
{
  for (uint64_t row = begin; row < end; ++row)
  {
    const bool even = (row / Network::HEIGHT) % 2 == 0;
    const float* const from = maps + (even ? 0 : Network::MAP_FLOATS);
    float* const to = maps + (even ? Network::MAP_FLOATS : 0);
    for (int channel = 0; channel < Network::CHANNELS; ++channel)
    {
      networkRow(from, to, weights, channel, static_cast<int>(row % Network::HEIGHT));
    }
  }
}

CodeletPtr frontEndCodelet()
{
  Codelet codelet;
  codelet.name = "front_end";
  codelet.native = {{[](const NativeCall& call)
                     {
                       runFrontEnd(
                           {call.buffer<const uint8_t>(0), call.buffer<const uint8_t>(1), call.buffer<uint8_t>(2),
                            call.buffer<uint8_t>(3), call.buffer<Corner>(4), call.buffer<int32_t>(5)},
                           call.value<int32_t>(6));
                     }}};
  return makeCodelet(std::move(codelet));
}

CodeletPtr detectionCodelet(bool sliceable)
{
  pi_runtime::OpenClImplementation opencl;
  opencl.source = NETWORK_SOURCE;
  opencl.options = "-DCHANNELS=" + std::to_string(Network::CHANNELS) + " -DPLANE=" + std::to_string(Network::PLANE) +
                   " -DSTRIDE=" + std::to_string(Network::STRIDE) + " -DBIAS=" + std::to_string(BIAS) +
                   "f -DMOST=" + std::to_string(MOST) + "f";
  opencl.kernels = {"layer"};
  opencl.function = detectionOpenCl;
  Codelet codelet;
  codelet.name = sliceable ? "detection_sliced" : "detection";
  codelet.sliceable = sliceable;
  codelet.native = {{[](const NativeCall& call)
                     { runNetwork(call.buffer<float>(0), call.buffer<float>(1), call.begin(), call.end()); }}};
  codelet.opencl = {std::move(opencl)};
  return makeCodelet(std::move(codelet));
}

void runInertial(float* covariance)
{
  constexpr int SIZE = 15;
  std::array<float, SIZE * SIZE> product{};
  for (int i = 0; i < SIZE; ++i)
  {
    for (int k = 0; k < SIZE; ++k)
    {
      const float transition = i == k ? 0.99f : 0.001f;
      for (int j = 0; j < SIZE; ++j)
      {
        product[static_cast<size_t>(i * SIZE + j)] += transition * covariance[k * SIZE + j];
      }
    }
  }
  std::copy(product.begin(), product.end(), covariance);
}

CodeletPtr inertialCodelet()
{
  Codelet codelet;
  codelet.name = "inertial";
  codelet.native = {{[](const NativeCall& call) { runInertial(call.buffer<float>(0)); }}};
  return makeCodelet(std::move(codelet));
}

FrontEndMemory::FrontEndMemory()
  : left(sharedPicture(false))
  , right(sharedPicture(true))
  , left_pyramid(Buffer::allocate(layout().bytes))
  , right_pyramid(Buffer::allocate(layout().bytes))
  , corners(Buffer::allocate(sizeof(Corner) * FrontEndFrame::LEVELS * FrontEndFrame::MAX_CORNERS))
  , disparities(Buffer::allocate(sizeof(int32_t) * FrontEndFrame::MAX_CORNERS))
{
}

FrontEndFrame FrontEndMemory::frame() const
{
  return {left->hostAs<const uint8_t>(Access::READ),   right->hostAs<const uint8_t>(Access::READ),
          left_pyramid->hostAs<uint8_t>(Access::READ), right_pyramid->hostAs<uint8_t>(Access::READ),
          corners->hostAs<Corner>(Access::READ),       disparities->hostAs<int32_t>(Access::READ)};
}

std::vector<Argument> FrontEndMemory::arguments(int32_t points) const
{
  return {Argument::in(left),     Argument::in(right),        Argument::out(left_pyramid), Argument::out(right_pyramid),
          Argument::out(corners), Argument::out(disparities), Argument::value(points)};
}

DetectionMemory::DetectionMemory() : maps(filledBuffer(networkInput())), weights(filledBuffer(networkWeights())) {}

std::vector<Argument> DetectionMemory::arguments() const
{
  return {Argument::inOut(maps), Argument::in(weights)};
}

}  // namespace pi_runtime_bench
