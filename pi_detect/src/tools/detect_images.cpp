// detect_images --model M.yaml --output det.json PICTURES_OR_FOLDERS: finds objects in picture files. Needs no ROS
// master.

#include <pi_detect/detector.h>
#include <pi_node/command_line.h>
#include <pi_node/durations.h>
#include <pi_node/output_file.h>
#include <pi_node/progress.h>
#include <pi_node/stop_signal.h>
#include "detector/draw_detections.h"
#include "ros/default_model.h"

#include <algorithm>
#include <boost/algorithm/string.hpp>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <iomanip>
#include <iostream>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/videoio.hpp>
#include <set>

namespace
{

namespace fs = std::filesystem;
namespace po = boost::program_options;
using namespace pi_detect;

struct Arguments
{
  std::string model;
  std::string output;
  std::string overlay;
  std::string target = "cpu";
  std::vector<std::string> inputs;
  int every = 1;  ///< picture of a video
  bool direct = false;
  bool name_pictures = false;  ///< also those without detections
  bool quiet = false;
  DetectorOptions detector;
};

bool hasExtension(const fs::path& path, const std::set<std::string>& extensions)
{
  return extensions.count(boost::to_lower_copy(path.extension().string())) != 0;
}

bool isPicture(const fs::path& path)
{
  return hasExtension(path, {".bmp", ".jpeg", ".jpg", ".pgm", ".png", ".ppm", ".tif", ".tiff", ".webp"});
}

bool isVideo(const fs::path& path)
{
  return hasExtension(path, {".avi", ".mkv", ".mov", ".mp4", ".mpg", ".webm"});
}

/// Pictures and videos named, and pictures in folders named, at any depth; in order of their names.
std::vector<std::string> listFiles(const std::vector<std::string>& inputs)
{
  std::vector<std::string> files;
  for (const std::string& input : inputs)
  {
    if (!fs::is_directory(input))
    {
      if (!fs::exists(input))
      {
        throw std::runtime_error(input + ": there is no such file or folder");
      }
      files.push_back(input);
      continue;
    }
    std::vector<std::string> found;
    for (const auto& entry : fs::recursive_directory_iterator(input))
    {
      if (entry.is_regular_file() && isPicture(entry.path()))
      {
        found.push_back(entry.path().string());
      }
    }
    if (found.empty())
    {
      throw std::runtime_error(input + ": there are no pictures in this folder (bmp, jpg, png, ppm, tif, webp)");
    }
    std::sort(found.begin(), found.end());
    files.insert(files.end(), found.begin(), found.end());
  }
  return files;
}

/// Hands out pictures one after the other; those of a video are called VIDEO#NUMBER.
class Pictures
{
public:
  Pictures(std::vector<std::string> files, int every) : files_(std::move(files)), every_(every) {}

  /// @return false at the end. An empty picture: this file cannot be read.
  bool next(std::string* name, cv::Mat* picture)
  {
    picture->release();
    while (frame_ > 0 || file_ < files_.size())
    {
      if (frame_ == 0)
      {
        *name = files_[file_++];
        if (!isVideo(*name))
        {
          *picture = cv::imread(*name, cv::IMREAD_COLOR);
          return true;
        }
        video_.open(*name);
        video_name_ = *name;
        if (!video_.read(*picture))
        {
          return true;
        }
        frame_ = 1;
        *name += "#0";
        return true;
      }
      bool good = true;
      for (int skipped = 1; good && skipped < every_; ++skipped)
      {
        good = video_.grab();
        ++frame_;
      }
      if (good && video_.read(*picture))
      {
        *name = video_name_ + "#" + std::to_string(frame_++);
        return true;
      }
      frame_ = 0;
    }
    return false;
  }

  /// Files begun, of all.
  size_t done() const { return file_; }
  size_t total() const { return files_.size(); }

private:
  const std::vector<std::string> files_;
  const int every_;
  size_t file_ = 0;
  cv::VideoCapture video_;
  std::string video_name_;
  int frame_ = 0;  ///< of the video that is open; 0: none is
};

std::string quoted(const std::string& text)
{
  return nlohmann::json(text).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

/// A JSON list, one detection per line; or an object that holds this list, the model's name and all pictures looked at.
class DetectionFile
{
public:
  /// @param model  name for the object; empty: the plain list.
  DetectionFile(const std::string& path, const std::string& model) : file_(path), is_object_(!model.empty())
  {
    file_.stream() << (is_object_ ? "{\"model\": " + quoted(model) + ", \"detections\": [" : "[") << std::fixed;
  }

  void add(const std::string& picture, const Detections& detections, const std::map<int, std::string>& labels)
  {
    pictures_ += (pictures_.empty() ? "" : ", ") + quoted(picture);
    for (const Detection& detection : detections)
    {
      file_.stream() << (empty_ ? "\n" : ",\n") << "{\"image\": " << quoted(picture)
                     << ", \"class\": " << quoted(labels.at(detection.class_id))
                     << ", \"score\": " << std::setprecision(5) << detection.score << std::setprecision(2)
                     << ", \"x1\": " << detection.box.x1 << ", \"y1\": " << detection.box.y1
                     << ", \"x2\": " << detection.box.x2 << ", \"y2\": " << detection.box.y2 << "}";
      empty_ = false;
    }
  }

  void complete()
  {
    file_.stream() << "\n]" << (is_object_ ? ", \"images\": [" + pictures_ + "]}" : "") << "\n";
    file_.complete();
  }

private:
  pi_node::OutputFile file_;
  const bool is_object_;
  std::string pictures_;
  bool empty_ = true;
};

void saveOverlay(const std::string& folder, const std::string& path, const Detections& detections,
                 const std::map<int, std::string>& labels, cv::Mat picture)
{
  drawDetections(detections, labels, &picture);
  std::string name = fs::path(path).relative_path().string();
  std::replace(name.begin(), name.end(), '/', '_');
  const std::string file = (fs::path(folder) / (name + ".jpg")).string();
  if (!cv::imwrite(file, picture))
  {
    throw std::runtime_error(file + ": cannot be written");
  }
}

/// @return exit status.
int run(const Arguments& line)
{
  Pictures pictures(listFiles(line.inputs), line.every);
  const ModelDescription model = ModelDescription::load(line.model);
  Detector detector(model, line.detector, line.direct ? nullptr : pi_runtime::Runtime::shared());
  const TargetInUse& target = detector.target();
  std::cerr << "model " << model.name << " on " << toString(target.used)
            << (target.device.empty() ? "" : " (" + target.device + ")") << "\n";
  if (!target.reason.empty())
  {
    std::cerr << "warning: not on " << toString(target.requested) << ": " << target.reason << "\n";
  }
  if (!line.overlay.empty())
  {
    fs::create_directories(line.overlay);
  }
  DetectionFile file(line.output, line.name_pictures ? model.name : "");
  size_t unreadable = 0;
  size_t found = 0;
  std::vector<double> times_ms;
  {
    pi_node::Progress progress("files", line.quiet);
    std::string name;
    cv::Mat picture;
    while (!pi_node::StopSignal::came() && pictures.next(&name, &picture))
    {
      if (picture.cols < 2 || picture.rows < 2)
      {
        std::cerr << "\nwarning: " << name << ": no picture that OpenCV can read; left out\n";
        ++unreadable;
        continue;
      }
      const auto start = std::chrono::steady_clock::now();
      const DetectionResult result = detector.detect(
          PictureView{picture.data, picture.cols, picture.rows, picture.step, PictureView::Format::BGR8});
      times_ms.push_back(1e3 * pi_node::secondsSince(start));
      file.add(name, result.detections, model.labels);
      found += result.detections.size();
      if (!line.overlay.empty())
      {
        saveOverlay(line.overlay, name, result.detections, model.labels, picture);
      }
      progress.show(pictures.done(), pictures.total());
    }
  }
  if (pi_node::StopSignal::came())
  {
    std::cerr << "stopped; " << line.output << " was not written\n";
    return pi_node::StopSignal::exitStatus();
  }
  if (times_ms.empty())
  {
    throw std::runtime_error("none of " + std::to_string(pictures.total()) +
                             " files is a picture that OpenCV can read");
  }
  file.complete();
  std::nth_element(times_ms.begin(), times_ms.begin() + static_cast<long>(times_ms.size() / 2), times_ms.end());
  std::cerr << times_ms.size() << " pictures, " << found << " objects, median " << std::fixed << std::setprecision(1)
            << times_ms[times_ms.size() / 2] << " ms per picture; " << line.output << "\n";
  return unreadable == 0 ? EXIT_SUCCESS : EXIT_FAILURE;
}

bool parse(int argc, char** argv, Arguments* line)
{
  std::vector<std::string> thresholds;
  DetectionFilter& filter = line->detector.filter;
  pi_node::CommandLine options("detect_images --output DETECTIONS.json [options] PICTURE_FOLDER_OR_VIDEO...");
  options.add("model", po::value(&line->model)->default_value(defaultModel()), "description of the network, YAML");
  options.add("output", po::value(&line->output)->required(), "JSON list of image, class, score, x1, y1, x2, y2 [px]");
  options.addFlag(
      "name-pictures", &line->name_pictures,
      "write an object with the model and all pictures beside the list; for evaluate_detections --only-seen");
  options.add("overlay", po::value(&line->overlay), "folder for the pictures with boxes drawn");
  options.add("score", po::value(&filter.score_threshold)->default_value(0.0F, "the model's"),
              "least score, in (0, 1]");
  options.add("class-score", po::value(&thresholds)->composing(),
              "CLASS=SCORE, least score of one class; may be repeated");
  options.add("class", po::value(&filter.classes)->composing(), "look for this class only; may be repeated");
  options.add("agnostic-overlap", po::value(&filter.class_agnostic_overlap)->default_value(-1.0F, "the model's"),
              "above which boxes of different classes suppress each other; 0: never");
  options.addValue("max", &filter.max_detections, "detections per picture at most");
  options.addValue("every", &line->every, "of a video, take every N-th picture");
  options.addValue("target", &line->target, "cpu, opencl or opencl_fp16");
  options.addFlag("require-target", &line->detector.require_target, "fail where the target cannot be had");
  options.add("threads", po::value(&line->detector.threads)->default_value(0, "all cores"), "of OpenCV");
  options.addFlag("direct", &line->direct, "without the runtime");
  options.addFlag("quiet", &line->quiet, "no progress");
  options.addPositional("inputs", &line->inputs, "no picture, folder or video is named; see --help");
  if (!options.parse(argc, argv))
  {
    return false;
  }
  for (const std::string& text : thresholds)
  {
    const size_t equals = text.rfind('=');
    char* end = nullptr;
    const float score = equals == std::string::npos ? 0.0F : std::strtof(text.c_str() + equals + 1, &end);
    if (end == nullptr || *end != '\0' || end == text.c_str() + equals + 1)
    {
      throw po::error("--class-score \"" + text + "\", expected CLASS=SCORE, as in person=0.4");
    }
    filter.class_thresholds[text.substr(0, equals)] = score;
  }
  if (line->every < 1)
  {
    throw po::error("--every " + std::to_string(line->every) + ", must be at least 1");
  }
  line->detector.target = parseTarget(line->target);
  line->detector.validate();
  return true;
}

}  // namespace

int main(int argc, char** argv)
{
  Arguments line;
  return pi_node::runTool(
      "detect_images", [&] { return parse(argc, argv, &line); },
      [&]
      {
        pi_node::StopSignal::install();
        return run(line);
      });
}
