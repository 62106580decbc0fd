#include <pi_bringup/frame_prefetcher.h>

#include <pthread.h>

#include <fstream>
#include <iterator>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <utility>

namespace pi_bringup
{

namespace
{

Frame failedFrame(const std::string& reason)
{
  Frame frame;
  frame.error = reason;
  return frame;
}

}  // namespace

Frame decodeGreyImage(const std::string& path, int width, int height)
{
  std::ifstream file(path, std::ios::binary);
  if (!file)
  {
    return failedFrame(path + ": cannot be opened");
  }
  const std::vector<uint8_t> bytes((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
  // A PNG ends with its IEND chunk. libpng hands out the rows before a cut without an error in some versions, so the
  // end is checked here.
  static const uint8_t PNG_START[] = {0x89, 'P', 'N', 'G'};
  static const uint8_t PNG_END[] = {'I', 'E', 'N', 'D', 0xae, 0x42, 0x60, 0x82};
  const bool is_png =
      bytes.size() >= sizeof(PNG_START) && std::equal(std::begin(PNG_START), std::end(PNG_START), bytes.begin());
  if (is_png && (bytes.size() < sizeof(PNG_END) ||
                 !std::equal(std::begin(PNG_END), std::end(PNG_END), bytes.end() - sizeof(PNG_END))))
  {
    return failedFrame(path + ": truncated, the PNG has no end (" + std::to_string(bytes.size()) + " bytes)");
  }

  // Not decoded in place: given a matrix, OpenCV 4.6 returns it as it was when it cannot decode.
  cv::Mat image;
  try
  {
    if (!bytes.empty())
    {
      image = cv::imdecode(bytes, cv::IMREAD_GRAYSCALE);
    }
    if (image.empty())
    {
      return failedFrame(path + ": not a picture that OpenCV can decode (" + std::to_string(bytes.size()) + " bytes)");
    }
  }
  catch (const cv::Exception& exception)
  {
    return failedFrame(path + ": " + exception.what());
  }
  if (image.cols != width || image.rows != height)
  {
    return failedFrame(path + ": is " + std::to_string(image.cols) + "x" + std::to_string(image.rows) +
                       ", the calibration is for " + std::to_string(width) + "x" + std::to_string(height));
  }
  Frame frame;
  frame.width = width;
  frame.height = height;
  frame.channels = 1;
  frame.pixels.assign(image.datastart, image.dataend);
  return frame;
}

FramePrefetcher::FramePrefetcher(Producer producer, size_t depth) : queue_(depth)
{
  thread_ = std::thread(
      [this, producer = std::move(producer)]
      {
        pthread_setname_np(pthread_self(), "prefetch");
        try
        {
          while (std::optional<Frame> frame = producer())
          {
            if (!queue_.push(std::move(*frame)))
            {
              return;
            }
          }
        }
        catch (const std::exception& exception)
        {
          queue_.push(failedFrame(exception.what()));
        }
        queue_.close();
      });
}

FramePrefetcher::~FramePrefetcher()
{
  stop();
}

std::optional<Frame> FramePrefetcher::next()
{
  return queue_.pop();
}

void FramePrefetcher::stop()
{
  queue_.close();
  if (thread_.joinable())
  {
    thread_.join();
  }
}

}  // namespace pi_bringup
