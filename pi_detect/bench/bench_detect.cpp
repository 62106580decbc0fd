// Time of a picture through Detector, directly and as tasks of the runtime, beside the usual recipe of OpenCV on the
// same network and pictures:
//   bench_detect --model MODEL.yaml [--rounds 5] PICTURES_OR_VIDEO...
// The three take turns picture by picture, in an order that rotates; a second network (--other) takes part likewise.
// Wall time is what the user waits; processor time counts all threads and is disturbed less by other programs.

#include <pi_detect/detector.h>
#include <pi_node/command_line.h>
#include "ros/default_model.h"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iostream>
#include <memory>
#include <opencv2/dnn.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>
#include <string>
#include <vector>

namespace
{

namespace fs = std::filesystem;
namespace po = boost::program_options;
using namespace pi_detect;

constexpr size_t MAX_PICTURES = 100;  ///< of a video

std::string machineName()
{
  std::ifstream info("/proc/cpuinfo");
  std::string line;
  while (std::getline(info, line))
  {
    if (line.rfind("model name", 0) == 0)
    {
      return line.substr(line.find(':') + 2);
    }
  }
  return "unknown processor";
}

double processorSeconds()
{
  timespec time{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + static_cast<double>(time.tv_nsec) * 1e-9;
}

long residentMb()
{
  std::ifstream statm("/proc/self/statm");
  long pages = 0;
  long resident = 0;
  statm >> pages >> resident;
  return resident * 4096 / (1 << 20);
}

std::vector<cv::Mat> readPictures(const std::vector<std::string>& inputs)
{
  std::vector<cv::Mat> pictures;
  for (const std::string& input : inputs)
  {
    std::vector<std::string> files = {input};
    if (fs::is_directory(input))
    {
      files.clear();
      for (const auto& entry : fs::directory_iterator(input))
      {
        files.push_back(entry.path().string());
      }
      std::sort(files.begin(), files.end());
    }
    for (const std::string& file : files)
    {
      const cv::Mat picture = cv::imread(file, cv::IMREAD_COLOR);
      if (!picture.empty())
      {
        pictures.push_back(picture);
        continue;
      }
      cv::VideoCapture video(file);
      cv::Mat frame;
      while (pictures.size() < MAX_PICTURES && video.read(frame))
      {
        pictures.push_back(frame.clone());
      }
    }
  }
  if (pictures.empty())
  {
    throw std::runtime_error("none of the inputs is a picture or a video that OpenCV can read");
  }
  return pictures;
}

/// Resizing, blobFromImage() and forward(), as OpenCV's and the networks' samples do it. Outputs are not decoded.
class PlainOpenCv
{
public:
  explicit PlainOpenCv(const ModelDescription& model)
    : input_(model.input), net_(cv::dnn::readNet(model.weights.path, model.config.path))
  {
    names_ = net_.getUnconnectedOutLayersNames();
  }
  void detect(const cv::Mat& picture)
  {
    const cv::Scalar mean(input_.mean[0], input_.mean[1], input_.mean[2]);
    const cv::Scalar scale(input_.scale[0], input_.scale[1], input_.scale[2]);
    const cv::Mat fitted = input_.fit == InputFit::STRETCH ? picture : boxed(picture);
    if (scale[0] == scale[1] && scale[1] == scale[2])
    {
      net_.setInput(
          cv::dnn::blobFromImage(fitted, scale[0], cv::Size(input_.width, input_.height), mean, input_.rgb, false));
    }
    else  // blobFromImage() has one factor for all channels
    {
      cv::Mat normalised;
      cv::resize(fitted, normalised, cv::Size(input_.width, input_.height));
      normalised.convertTo(normalised, CV_32FC3);
      cv::subtract(normalised, mean, normalised);
      cv::multiply(normalised, scale, normalised);
      net_.setInput(cv::dnn::blobFromImage(normalised, 1.0, cv::Size(), cv::Scalar(), input_.rgb, false));
    }
    net_.forward(outputs_, names_);
  }

private:
  cv::Mat boxed(const cv::Mat& picture) const
  {
    const double ratio = std::min(1.0 * input_.width / picture.cols, 1.0 * input_.height / picture.rows);
    cv::Mat resized;
    cv::resize(picture, resized,
               cv::Size(static_cast<int>(picture.cols * ratio), static_cast<int>(picture.rows * ratio)));
    const int right = input_.width - resized.cols;
    const int below = input_.height - resized.rows;
    const bool centred = input_.fit == InputFit::LETTERBOX;
    const int left = centred ? right / 2 : 0;
    const int above = centred ? below / 2 : 0;
    cv::Mat square;
    cv::copyMakeBorder(resized, square, above, below - above, left, right - left, cv::BORDER_CONSTANT,
                       cv::Scalar::all(input_.bar_level));
    return square;
  }

  const NetworkInput input_;
  cv::dnn::Net net_;
  std::vector<std::string> names_;
  std::vector<cv::Mat> outputs_;
};

struct Contender
{
  std::string name;
  std::function<void(const cv::Mat&)> detect;
  std::vector<double> wall_ms;
  std::vector<double> processor_ms;
};

double quantile(std::vector<double> values, double part)
{
  const auto at = values.begin() + static_cast<long>(part * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

void addDetector(const ModelDescription& model, DetectorOptions options,
                 const std::shared_ptr<pi_runtime::Runtime>& runtime, std::vector<Contender>* contenders)
{
  const auto detector = std::make_shared<Detector>(model, options, runtime);
  contenders->push_back(
      {model.name + (runtime == nullptr ? ", direct" : ", tasks") +
           (detector->target().used == Target::CPU ? "" : std::string(", ") + toString(detector->target().used)),
       [detector](const cv::Mat& picture) {
         detector->detect(
             PictureView{picture.data, picture.cols, picture.rows, picture.step, PictureView::Format::BGR8});
       },
       {},
       {}});
}

void run(const std::string& description, const std::string& other, DetectorOptions options, int rounds,
         const std::vector<std::string>& inputs)
{
  const std::vector<cv::Mat> pictures = readPictures(inputs);
  const auto runtime = pi_runtime::Runtime::shared();
  std::vector<Contender> contenders;
  const ModelDescription model = ModelDescription::load(description);
  const auto plain = std::make_shared<PlainOpenCv>(model);
  contenders.push_back(
      {model.name + ", plain OpenCV", [plain](const cv::Mat& picture) { plain->detect(picture); }, {}, {}});
  addDetector(model, options, nullptr, &contenders);
  addDetector(model, options, runtime, &contenders);
  if (!other.empty())
  {
    addDetector(ModelDescription::load(other), options, nullptr, &contenders);
  }
  for (Contender& contender : contenders)  // compiled, allocated, learned
  {
    for (size_t i = 0; i < 3; ++i)
    {
      contender.detect(pictures[i % pictures.size()]);
    }
  }
  size_t turn = 0;
  for (int round = 0; round < rounds; ++round)
  {
    for (const cv::Mat& picture : pictures)
    {
      ++turn;
      for (size_t i = 0; i < contenders.size(); ++i)
      {
        Contender& contender = contenders[(i + turn) % contenders.size()];
        const double processor = processorSeconds();
        const auto start = std::chrono::steady_clock::now();
        contender.detect(picture);
        contender.wall_ms.push_back(
            std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count());
        contender.processor_ms.push_back(1e3 * (processorSeconds() - processor));
      }
    }
  }
  std::printf("%s, %d threads of OpenCV, %zu pictures of %d x %d and so on, %d rounds\n", machineName().c_str(),
              cv::getNumThreads(), pictures.size(), pictures[0].cols, pictures[0].rows, rounds);
  std::printf("%-45s %9s %9s %9s %12s %18s\n", "", "p50 [ms]", "p95 [ms]", "min [ms]", "CPU p50 [ms]",
              "p50 / plain OpenCV");
  const double reference = quantile(contenders[0].wall_ms, 0.5);
  for (const Contender& contender : contenders)
  {
    const double median = quantile(contender.wall_ms, 0.5);
    std::printf("%-45s %9.2f %9.2f %9.2f %12.2f %18.2f\n", contender.name.c_str(), median,
                quantile(contender.wall_ms, 0.95), quantile(contender.wall_ms, 0.0),
                quantile(contender.processor_ms, 0.5), median / reference);
  }
  std::printf("memory of this process, with all of them: %ld MB\n", residentMb());
}

}  // namespace

int main(int argc, char** argv)
{
  std::string model;
  std::string other;
  std::string target = "cpu";
  int rounds = 5;
  std::vector<std::string> inputs;
  DetectorOptions detector;
  pi_node::CommandLine options("bench_detect [options] PICTURE_FOLDER_OR_VIDEO...");
  options.add("model", po::value(&model)->default_value(defaultModel()), "description of the network");
  options.add("other", po::value(&other), "a second network, for comparison");
  options.addValue("target", &target, "of Detector: cpu, opencl or opencl_fp16");
  options.add("threads", po::value(&detector.threads)->default_value(0, "all cores"), "of OpenCV, for all of them");
  options.addValue("rounds", &rounds, "over the pictures");
  options.addPositional("inputs", &inputs, "no picture, folder or video is named; see --help");
  return pi_node::runTool(
      "bench_detect", [&] { return options.parse(argc, argv); },
      [&]
      {
        detector.target = parseTarget(target);
        run(model, other, detector, rounds, inputs);
        return EXIT_SUCCESS;
      });
}
