#include <memory>
#include <opencv2/features2d.hpp>
#include <opencv2/video/tracking.hpp>

#include "kernel_test_images.h"
#include "kernel_cases.h"
#include <pi_runtime/kernels/fast_corners.h>
#include <pi_runtime/kernels/lucas_kanade.h>
#include <pi_runtime/kernels/pyramid.h>

namespace pi_runtime
{
namespace
{

using kernels::FastCornersShape;
using kernels::PyramidLayout;
using kernels::PyramidShape;
using kernels::TrackOptions;

std::string sizeName(const cv::Mat& image)
{
  return std::to_string(image.cols) + "x" + std::to_string(image.rows);
}

/// A case whose native and OpenCL runs take the same arguments.
KernelCase makeCase(CodeletRunner& runner, const std::string& name, const CodeletPtr& codelet,
                    const std::vector<Argument>& arguments, uint64_t range, std::function<void()> opencv)
{
  return KernelCase{name, [=, &runner]() { runner.native(codelet, arguments, range); },
                    [=, &runner]() { runner.opencl(codelet, arguments, range); }, std::move(opencv)};
}

KernelCase pyramidDownCase(CodeletRunner& runner, const cv::Mat& image)
{
  const cv::Mat smaller((image.rows + 1) / 2, (image.cols + 1) / 2, CV_8UC1);
  const PyramidShape shape{image.cols, image.rows, image.cols, smaller.cols, 0};
  const std::vector<Argument> arguments = {Argument::in(wrapMat(image)), Argument::out(wrapMat(smaller)),
                                           Argument::value(shape)};
  return makeCase(runner, "pyramid_down " + sizeName(image), kernels::pyramidDownCodelet(), arguments, smaller.rows,
                  [image]()
                  {
                    cv::Mat out;
                    cv::pyrDown(image, out);
                  });
}

KernelCase imagePyramidCase(CodeletRunner& runner, const cv::Mat& image)
{
  const int levels = 4;
  const PyramidShape shape{image.cols, image.rows, image.cols, 0, levels};
  const std::vector<Argument> arguments = {
      Argument::in(wrapMat(image)),
      Argument::out(Buffer::allocate(PyramidLayout(image.cols, image.rows, levels).bytes)), Argument::value(shape)};
  const auto pyramid = std::make_shared<std::vector<cv::Mat>>();
  return makeCase(runner, "image_pyramid " + sizeName(image) + " 4 levels", kernels::imagePyramidCodelet(), arguments,
                  1,
                  [image, pyramid]()
                  {
                    pyramid->resize(levels);
                    image.copyTo(pyramid->at(0));
                    for (int i = 1; i < levels; ++i)
                    {
                      cv::pyrDown(pyramid->at(i - 1), pyramid->at(i));
                    }
                  });
}

KernelCase fastCornersCase(CodeletRunner& runner, const std::string& content, const cv::Mat& image, int threshold)
{
  const int capacity = 20000;
  const FastCornersShape shape{image.cols, image.rows, image.cols, threshold, capacity};
  const std::vector<Argument> arguments = {
      Argument::in(wrapMat(image)), Argument::out(Buffer::allocate(capacity * sizeof(kernels::Corner))),
      Argument::out(Buffer::allocate(sizeof(uint32_t))),
      Argument::out(Buffer::allocate(kernels::fastCornersWorkBytes(image.cols, image.rows))), Argument::value(shape)};
  return makeCase(runner, "fast_corners " + sizeName(image) + " " + content, kernels::fastCornersCodelet(), arguments,
                  1,
                  [image, threshold]()
                  {
                    std::vector<cv::KeyPoint> corners;
                    cv::FAST(image, corners, threshold, true, cv::FastFeatureDetector::TYPE_9_16);
                  });
}

/// 200 corners of a scene that moved and turned a little between two images.
KernelCase trackPointsCase(CodeletRunner& runner, const cv::Mat& image)
{
  TrackOptions options;
  options.width = image.cols;
  options.height = image.rows;
  cv::Mat moved;
  cv::Mat motion = cv::getRotationMatrix2D(cv::Point2f(300, 200), 1.0, 1.01);
  motion.at<double>(0, 2) += 6.3;
  motion.at<double>(1, 2) -= 3.7;
  cv::warpAffine(image, moved, motion, image.size(), cv::INTER_LINEAR, cv::BORDER_REFLECT_101);
  std::vector<cv::Point2f> points;
  cv::goodFeaturesToTrack(image, points, 200, 0.01, 15);
  const PyramidLayout layout(image.cols, image.rows, options.levels);
  const auto pyramid = [&layout](const cv::Mat& of)
  {
    const BufferPtr buffer = Buffer::allocate(layout.bytes);
    kernels::buildPyramid({of.ptr(), of.cols, of.rows, of.step[0]}, layout, buffer->hostAs<uint8_t>(Access::WRITE));
    return buffer;
  };
  const BufferPtr next = Buffer::allocate(points.size() * sizeof(cv::Point2f));
  const std::vector<Argument> arguments = {Argument::in(pyramid(image)),
                                           Argument::in(pyramid(moved)),
                                           Argument::in(wrapMat(cv::Mat(points, true))),
                                           Argument::inOut(next),
                                           Argument::out(Buffer::allocate(points.size())),
                                           Argument::out(Buffer::allocate(points.size() * sizeof(float))),
                                           Argument::value(options)};
  KernelCase result = makeCase(runner, "track_points " + sizeName(image) + " " + std::to_string(points.size()),
                               kernels::trackPointsCodelet(), arguments, points.size(), nullptr);
  const auto reset = [next, points]()
  { std::memcpy(next->host(Access::WRITE), points.data(), points.size() * sizeof(cv::Point2f)); };
  result.native = [reset, run = result.native]()
  {
    reset();
    run();
  };
  result.opencl = [reset, run = result.opencl]()
  {
    reset();
    run();
  };
  std::vector<cv::Mat> previous_levels;
  std::vector<cv::Mat> next_levels;
  const cv::Size window(options.window, options.window);
  cv::buildOpticalFlowPyramid(image, previous_levels, window, options.levels - 1, false);
  cv::buildOpticalFlowPyramid(moved, next_levels, window, options.levels - 1, false);
  result.opencv = [=]()
  {
    std::vector<cv::Point2f> found = points;
    std::vector<uint8_t> status;
    std::vector<float> error;
    cv::calcOpticalFlowPyrLK(
        previous_levels, next_levels, points, found, status, error, window, options.levels - 1,
        cv::TermCriteria(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, options.max_iterations, options.epsilon),
        cv::OPTFLOW_USE_INITIAL_FLOW, options.min_eigenvalue);
  };
  return result;
}

}  // namespace

std::vector<KernelCase> frontEndCases(CodeletRunner& runner)
{
  std::vector<KernelCase> cases;
  for (const cv::Size& size : {cv::Size(640, 480), cv::Size(752, 480)})
  {
    const cv::Mat image = pictureWithCorners(size.width, size.height);
    cases.push_back(pyramidDownCase(runner, image));
    cases.push_back(imagePyramidCase(runner, image));
    cases.push_back(fastCornersCase(runner, "scene", image, 20));
    cases.push_back(trackPointsCase(runner, image));
  }
  cases.push_back(fastCornersCase(runner, "noise", makeImage(Content::RANDOM, 640, 480), 20));
  return cases;
}

}  // namespace pi_runtime
