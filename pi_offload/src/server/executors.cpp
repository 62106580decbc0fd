#include "server/executors.h"

#include <pi_node/durations.h>
#include <pi_node/option_check.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <list>
#include <memory>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>
#include <utility>

namespace pi_offload
{
namespace
{

class DetectionExecutor
{
public:
  DetectionExecutor(const pi_detect::ModelDescription& model, const DetectionExecutorOptions& options)
    : max_side_(options.max_side), detector_(std::make_unique<pi_detect::Detector>(model, options.detector, nullptr))
  {
  }

  OffloadReply run(const OffloadRequest& request, double* service_s)
  {
    const auto begin = std::chrono::steady_clock::now();
    const pi_detect::DetectionResult result = detector_->detect(pictureOf(request));
    OffloadReply reply;
    reply.model = detector_->model().name;
    reply.objects.reserve(result.detections.size());
    for (const pi_detect::Detection& found : result.detections)
    {
      reply.objects.push_back({found.class_id, found.score, found.box.x1, found.box.y1, found.box.x2, found.box.y2});
    }
    *service_s = pi_node::secondsSince(begin);
    return reply;
  }

private:
  void checkSize(uint32_t width, uint32_t height) const
  {
    if (width < 2 || height < 2 || width > max_side_ || height > max_side_)
    {
      throw std::runtime_error("a picture of " + std::to_string(width) + " x " + std::to_string(height) +
                               ", must be between 2 x 2 and " + std::to_string(max_side_) + " x " +
                               std::to_string(max_side_));
    }
  }

  pi_detect::PictureView pictureOf(const OffloadRequest& request)
  {
    using Format = pi_detect::PictureView::Format;
    if (request.encoding == Encoding::JPEG)
    {
      const PictureSize size = jpegSize(request.payload);  // before the decoder allocates memory
      checkSize(size.width, size.height);
      cv::imdecode(request.payload, cv::IMREAD_COLOR | cv::IMREAD_IGNORE_ORIENTATION, &picture_);
      if (picture_.empty())
      {
        throw std::runtime_error("the JPEG of " + std::to_string(request.payload.size()) + " bytes cannot be decoded");
      }
      return {picture_.data, picture_.cols, picture_.rows, picture_.step, Format::BGR8};
    }
    size_t channels = 3;
    Format format = Format::BGR8;
    switch (request.encoding)
    {
      case Encoding::BGR8:
        break;
      case Encoding::RGB8:
        format = Format::RGB8;
        break;
      case Encoding::MONO8:
        format = Format::MONO8;
        channels = 1;
        break;
      default:
        throw std::runtime_error("encoding " + std::to_string(static_cast<int>(request.encoding)) +
                                 " is not one of a picture");
    }
    checkSize(request.width, request.height);
    const size_t stride = channels * request.width;
    if (request.payload.size() != stride * request.height)
    {
      throw std::runtime_error("a picture of " + std::to_string(request.width) + " x " +
                               std::to_string(request.height) + " takes " + std::to_string(stride * request.height) +
                               " bytes, there are " + std::to_string(request.payload.size()));
    }
    return {request.payload.data(), static_cast<int>(request.width), static_cast<int>(request.height), stride, format};
  }

  const uint32_t max_side_;
  std::unique_ptr<pi_detect::Detector> detector_;
  cv::Mat picture_;
};

std::string linesOf(const pi_speech::CommandTable& table)
{
  std::string lines;
  for (const pi_speech::Command& command : table.commands)
  {
    lines += command.text + "\n";
  }
  return lines;
}

class SpeechExecutor
{
public:
  explicit SpeechExecutor(const SpeechExecutorOptions& options)
    : options_(options)
    , own_lines_(linesOf(options.commands))
    , own_(std::make_unique<pi_speech::CommandRecognizer>(options.recognizer, options.commands))
  {
    options_.recognizer.sphinx.check_model = false;  // checked before
  }

  OffloadReply run(const OffloadRequest& request, double* service_s)
  {
    const auto begin = std::chrono::steady_clock::now();
    if (request.encoding != Encoding::S16LE)
    {
      throw std::runtime_error("encoding " + std::to_string(static_cast<int>(request.encoding)) +
                               " is not one of sound");
    }
    const size_t count = request.payload.size() / 2;
    const double sound_s = static_cast<double>(count) / pi_speech::SAMPLE_RATE_HZ;
    if (request.payload.size() % 2 != 0 || count == 0 || sound_s > options_.max_sound_s)
    {
      throw std::runtime_error("sound of " + std::to_string(request.payload.size()) +
                               " bytes, must be 16 bit samples of at most " + std::to_string(options_.max_sound_s) +
                               " s");
    }
    pi_speech::CommandRecognizer& recognizer = recognizerFor(request.options);
    samples_.resize(count);
    for (size_t sample = 0; sample < count; ++sample)
    {
      samples_[sample] = static_cast<int16_t>(
          static_cast<uint16_t>(request.payload[2 * sample] | request.payload[2 * sample + 1] << 8));
    }
    const double speech_s = request.speech_s > 0.0 ? std::min(request.speech_s, sound_s) : sound_s;
    const pi_speech::Recognition recognition = recognizer.recognize(samples_.data(), count, speech_s);
    OffloadReply reply;
    reply.accepted = recognition.accepted;
    reply.text = recognition.accepted ? recognition.text : "";
    reply.confidence = static_cast<float>(recognition.confidence);
    *service_s = pi_node::secondsSince(begin);
    return reply;
  }

private:
  pi_speech::CommandRecognizer& recognizerFor(const std::string& lines)
  {
    if (lines.empty())
    {
      return *own_;
    }
    const pi_speech::CommandTable table = commandsOf(lines, options_.max_commands);
    const std::string key = linesOf(table);
    if (key == own_lines_)
    {
      return *own_;
    }
    const auto found =
        std::find_if(others_.begin(), others_.end(), [&](const auto& other) { return other.first == key; });
    if (found != others_.end())
    {
      others_.splice(others_.begin(), others_, found);
      return *others_.front().second;
    }
    auto recognizer = std::make_unique<pi_speech::CommandRecognizer>(options_.recognizer, table);
    while (others_.size() >= options_.max_tables)
    {
      others_.pop_back();
    }
    others_.emplace_front(key, std::move(recognizer));
    return *others_.front().second;
  }

  SpeechExecutorOptions options_;
  const std::string own_lines_;
  std::unique_ptr<pi_speech::CommandRecognizer> own_;
  /// Most recently used first.
  std::list<std::pair<std::string, std::unique_ptr<pi_speech::CommandRecognizer>>> others_;
  std::vector<int16_t> samples_;
};

}  // namespace

void DetectionExecutorOptions::validate() const
{
  const pi_node::OptionCheck check("detection");
  if (model.empty())
  {
    throw std::invalid_argument("detection/model is empty, must name the YAML file of a network");
  }
  check.range<uint32_t>("max_side", max_side, 2, 65535);
  detector.validate();
}

ExecutorFactory detectionExecutor(const DetectionExecutorOptions& options)
{
  options.validate();
  const pi_detect::ModelDescription model = pi_detect::ModelDescription::load(options.model);
  return [model, chosen = options]() mutable -> Executor
  {
    const auto executor = std::make_shared<DetectionExecutor>(model, chosen);
    chosen.detector.check_model = false;  // it is known to be good
    return [executor](const OffloadRequest& request, double* service_s) { return executor->run(request, service_s); };
  };
}

void SpeechExecutorOptions::validate() const
{
  const pi_node::OptionCheck check("speech");
  recognizer.validate();
  commands.validate();
  check.range("max_sound_s", max_sound_s, 0.1, 300.0);
  check.range<size_t>("max_commands", max_commands, 1, 10000);
  check.range<size_t>("max_tables", max_tables, 1, 100);
}

ExecutorFactory speechExecutor(const SpeechExecutorOptions& options)
{
  options.validate();
  return [chosen = options]() mutable -> Executor
  {
    const auto executor = std::make_shared<SpeechExecutor>(chosen);
    chosen.recognizer.sphinx.check_model = false;
    return [executor](const OffloadRequest& request, double* service_s) { return executor->run(request, service_s); };
  };
}

PictureSize jpegSize(const std::vector<uint8_t>& jpeg)
{
  constexpr uint8_t MARKER = 0xff;
  constexpr uint8_t START_OF_IMAGE = 0xd8;
  constexpr uint8_t START_OF_SCAN = 0xda;
  const auto word = [&](size_t at) { return static_cast<uint32_t>(jpeg[at] << 8U | jpeg[at + 1]); };
  if (jpeg.size() < 4 || jpeg[0] != MARKER || jpeg[1] != START_OF_IMAGE)
  {
    throw std::runtime_error("no JPEG (" + std::to_string(jpeg.size()) + " bytes)");
  }
  for (size_t at = 2; at + 4 <= jpeg.size();)
  {
    if (jpeg[at] != MARKER)
    {
      break;
    }
    const uint8_t kind = jpeg[at + 1];
    if (kind == MARKER)  // fill byte
    {
      ++at;
      continue;
    }
    if (kind == 0x01 || (kind >= 0xd0 && kind <= 0xd7))  // without a length
    {
      at += 2;
      continue;
    }
    // Start of frame: all of 0xc0 to 0xcf but tables of Huffman (c4), arithmetic (cc), and a reserved one (c8).
    const bool frame = kind >= 0xc0 && kind <= 0xcf && kind != 0xc4 && kind != 0xc8 && kind != 0xcc;
    if (frame && at + 9 <= jpeg.size())
    {
      return {word(at + 7), word(at + 5)};
    }
    if (frame || kind == START_OF_SCAN)
    {
      break;
    }
    at += 2 + std::max<size_t>(2, word(at + 2));
  }
  throw std::runtime_error("the JPEG of " + std::to_string(jpeg.size()) + " bytes does not say its size");
}

pi_speech::CommandTable commandsOf(const std::string& lines, size_t most)
{
  const std::string space = " \t\r";
  pi_speech::CommandTable table;
  for (size_t begin = 0; begin < lines.size();)
  {
    const size_t end = std::min(lines.find('\n', begin), lines.size());
    const std::string line = lines.substr(begin, end - begin);
    begin = end + 1;
    const size_t first = line.find_first_not_of(space);
    if (first == std::string::npos)
    {
      continue;
    }
    pi_speech::Command command;
    command.text = line.substr(first, line.find_last_not_of(space) - first + 1);
    std::transform(command.text.begin(), command.text.end(), command.text.begin(),
                   [](char letter)
                   { return letter >= 'A' && letter <= 'Z' ? static_cast<char>(letter + 32) : letter; });
    if (table.commands.size() == most)
    {
      throw std::runtime_error("more than " + std::to_string(most) + " commands");
    }
    table.commands.push_back(std::move(command));
  }
  table.validate();
  return table;
}

}  // namespace pi_offload
