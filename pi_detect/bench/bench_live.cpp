// Publishes pictures to ssd_node as its camera would, and measures the node from outside:
//   bench_live --model MODEL.yaml [--rate 30] [--duration 20] [--rounds 3] [--recipe] VIDEO
// Prints pictures in and detections out, the time from a picture's stamp to the arrival of its detections here (both
// transports included), processor time and memory of the node. With --recipe, rounds of ssd_node alternate with rounds
// of dnn_detect_recipe, the usual way to write such a node. Starts a master of its own.

#include <pi_detect/Detection2DArray.h>
#include <pi_detect/model_catalogue.h>
#include <pi_node/command_line.h>
#include <ros/ros.h>
#include <sensor_msgs/Image.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <map>
#include <mutex>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>
#include <sstream>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

extern char** environ;

namespace
{

namespace po = boost::program_options;
using Clock = std::chrono::steady_clock;

struct Arguments
{
  std::string video;
  std::string model;
  double rate_hz = 30.0;
  double duration_s = 20.0;
  int rounds = 3;
  int width = 640;
  int height = 480;
  int port = 11397;
  bool recipe = false;
  std::vector<std::string> parameters;
};

/// A program that ends with this object: by SIGINT, and if that does not help within 10 s, by SIGKILL.
class Process
{
public:
  explicit Process(std::vector<std::string> arguments)
  {
    std::vector<char*> pointers;
    for (std::string& argument : arguments)
    {
      pointers.push_back(argument.data());
    }
    pointers.push_back(nullptr);
    const int error = posix_spawnp(&pid_, pointers[0], nullptr, nullptr, pointers.data(), environ);
    if (error != 0)
    {
      throw std::runtime_error(arguments[0] + ": cannot be started: " + std::strerror(error));
    }
  }
  ~Process()
  {
    kill(pid_, SIGINT);
    const auto end = Clock::now() + std::chrono::seconds(10);
    while (waitpid(pid_, nullptr, WNOHANG) == 0)
    {
      if (Clock::now() > end)
      {
        kill(pid_, SIGKILL);
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
  }
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  double processorSeconds() const
  {
    std::ifstream file("/proc/" + std::to_string(pid_) + "/stat");
    std::string text;
    std::getline(file, text);
    std::istringstream fields(text.substr(text.rfind(')') + 2));
    std::string skipped;
    for (int i = 0; i < 11; ++i)
    {
      fields >> skipped;
    }
    double user = 0.0;
    double system = 0.0;
    fields >> user >> system;
    return (user + system) / static_cast<double>(sysconf(_SC_CLK_TCK));
  }
  /// A line of its status [MB], "VmHWM" or "VmRSS".
  double memoryMb(const std::string& name) const
  {
    std::ifstream file("/proc/" + std::to_string(pid_) + "/status");
    for (std::string line; std::getline(file, line);)
    {
      if (line.rfind(name + ":", 0) == 0)
      {
        return std::stod(line.substr(name.size() + 1)) / 1024.0;
      }
    }
    return 0.0;
  }

private:
  pid_t pid_ = -1;
};

std::vector<sensor_msgs::ImagePtr> readPictures(const Arguments& line)
{
  cv::VideoCapture video(line.video);
  std::vector<sensor_msgs::ImagePtr> pictures;
  cv::Mat frame;
  cv::Mat resized;
  while (pictures.size() < 300 && video.read(frame))
  {
    cv::resize(frame, resized, cv::Size(line.width, line.height), 0, 0, cv::INTER_AREA);
    auto picture = boost::make_shared<sensor_msgs::Image>();
    picture->header.frame_id = "camera_optical";
    picture->encoding = "bgr8";
    picture->width = static_cast<uint32_t>(line.width);
    picture->height = static_cast<uint32_t>(line.height);
    picture->step = picture->width * 3;
    picture->data.assign(resized.data, resized.data + resized.total() * 3);
    pictures.push_back(picture);
  }
  if (pictures.empty())
  {
    throw std::runtime_error(line.video + ": no video that OpenCV can read");
  }
  return pictures;
}

struct Round
{
  double sent_hz = 0.0;
  double detected_hz = 0.0;
  std::vector<double> latency_ms;
  size_t objects = 0;
  double processor = 0.0;  ///< cores
  double peak_mb = 0.0;
  double resident_mb = 0.0;
};

/// What comes from the node.
class Detections
{
public:
  void add(const pi_detect::Detection2DArrayConstPtr& message)
  {
    const double latency_ms = 1e3 * (ros::Time::now() - message->header.stamp).toSec();
    std::lock_guard<std::mutex> lock(mutex_);
    latency_ms_.push_back(latency_ms);
    objects_ += message->detections.size();
  }
  void take(Round* round)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    round->latency_ms = std::exchange(latency_ms_, {});
    round->objects = std::exchange(objects_, 0);
  }

private:
  std::mutex mutex_;
  std::vector<double> latency_ms_;
  size_t objects_ = 0;
};

Round measure(const Arguments& line, const std::string& program, const std::vector<sensor_msgs::ImagePtr>& pictures)
{
  ros::NodeHandle node;
  Detections detections;
  const ros::Publisher publisher = node.advertise<sensor_msgs::Image>("image", 2);
  const ros::Subscriber subscriber = node.subscribe<pi_detect::Detection2DArray>(
      "detections", 100, [&](const pi_detect::Detection2DArrayConstPtr& message) { detections.add(message); },
      ros::VoidConstPtr(), ros::TransportHints().tcpNoDelay());
  std::vector<std::string> arguments = {
      (std::filesystem::read_symlink("/proc/self/exe").parent_path() / program).string(), "_model:=" + line.model};
  arguments.insert(arguments.end(), line.parameters.begin(), line.parameters.end());
  const Process process(arguments);
  const auto give_up = Clock::now() + std::chrono::seconds(60);
  while (publisher.getNumSubscribers() == 0)
  {
    if (Clock::now() > give_up || !ros::ok())
    {
      throw std::runtime_error(program + " did not subscribe to image within 60 s");
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  Round round;
  const auto period = std::chrono::duration<double>(1.0 / line.rate_hz);
  const double warm_up_s = 2.0;
  auto next = Clock::now();
  auto start = next;
  double processor = 0.0;
  bool measuring = false;
  size_t sent = 0;
  for (size_t i = 0; ros::ok(); ++i)
  {
    std::this_thread::sleep_until(next);
    next += std::chrono::duration_cast<Clock::duration>(period);
    const double elapsed_s = std::chrono::duration<double>(Clock::now() - start).count();
    if (!measuring && elapsed_s > warm_up_s)
    {
      measuring = true;
      start = Clock::now();
      processor = process.processorSeconds();
      sent = 0;
      detections.take(&round);
    }
    else if (measuring && elapsed_s > line.duration_s)
    {
      detections.take(&round);
      round.sent_hz = static_cast<double>(sent) / elapsed_s;
      round.detected_hz = static_cast<double>(round.latency_ms.size()) / elapsed_s;
      round.processor = (process.processorSeconds() - processor) / elapsed_s;
      round.peak_mb = process.memoryMb("VmHWM");
      round.resident_mb = process.memoryMb("VmRSS");
      break;
    }
    sensor_msgs::Image& picture = *pictures[i % pictures.size()];
    picture.header.stamp = ros::Time::now();
    publisher.publish(picture);
    ++sent;
  }
  return round;
}

double quantile(std::vector<double> values, double part)
{
  if (values.empty())
  {
    return 0.0;
  }
  const auto at = values.begin() + static_cast<long>(part * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

void print(const std::string& program, const Round& round)
{
  std::printf(
      "%-18s in %5.1f Hz, out %5.1f Hz, latency p50 %6.1f ms, p95 %6.1f ms, p99 %6.1f ms, %5.1f %% of a core, "
      "%5.1f ms of processor per picture out, %4.0f MB (peak %4.0f), %.2f objects per picture\n",
      program.c_str(), round.sent_hz, round.detected_hz, quantile(round.latency_ms, 0.5),
      quantile(round.latency_ms, 0.95), quantile(round.latency_ms, 0.99), 100.0 * round.processor,
      1e3 * round.processor / std::max(round.detected_hz, 0.01), round.resident_mb, round.peak_mb,
      static_cast<double>(round.objects) / std::max<double>(1.0, static_cast<double>(round.latency_ms.size())));
  std::fflush(stdout);
}

void run(const Arguments& line, int argc, char** argv)
{
  setenv("ROS_MASTER_URI", ("http://localhost:" + std::to_string(line.port)).c_str(), 1);
  const Process master({"rosrun", "pi_os_transport", "pi_core", "-p", std::to_string(line.port)});
  ros::init(argc, argv, "bench_live");
  const auto give_up = Clock::now() + std::chrono::seconds(30);
  while (!ros::master::check())
  {
    if (Clock::now() > give_up)
    {
      throw std::runtime_error("no master on port " + std::to_string(line.port) + " within 30 s");
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  const ros::NodeHandle keeps_ros_up;
  ros::AsyncSpinner spinner(1);
  spinner.start();
  const std::vector<sensor_msgs::ImagePtr> pictures = readPictures(line);
  std::vector<std::string> programs = {"ssd_node"};
  if (line.recipe)
  {
    programs.emplace_back("dnn_detect_recipe");
  }
  std::map<std::string, std::vector<double>> processor_ms;
  for (int i = 0; i < line.rounds && ros::ok(); ++i)
  {
    for (const std::string& program : programs)
    {
      const Round round = measure(line, program, pictures);
      print(program, round);
      processor_ms[program].push_back(1e3 * round.processor / std::max(round.detected_hz, 0.01));
    }
  }
  if (line.recipe)
  {
    std::printf("processor time per picture, ssd_node / recipe: %.2f (medians of %d rounds)\n",
                quantile(processor_ms["ssd_node"], 0.5) / quantile(processor_ms["dnn_detect_recipe"], 0.5),
                line.rounds);
  }
}

}  // namespace

int main(int argc, char** argv)
{
  Arguments line;
  line.model = pi_detect::DEFAULT_MODEL;
  pi_node::CommandLine options("bench_live [options] VIDEO");
  options.addValue("model", &line.model, "network: name or path of a description");
  options.addValue("rate", &line.rate_hz, "of pictures [Hz]");
  options.addValue("duration", &line.duration_s, "of a round [s]");
  options.addValue("rounds", &line.rounds, "of each node");
  options.addValue("width", &line.width, "of pictures [px]");
  options.addValue("height", &line.height, "of pictures [px]");
  options.addValue("port", &line.port, "of the master that is started");
  options.addFlag("recipe", &line.recipe, "compare with dnn_detect_recipe");
  options.add("parameter", po::value(&line.parameters)->composing(), "_NAME:=VALUE for the node; may be repeated");
  options.addPositional("video", &line.video, "no video is named; see --help");
  return pi_node::runTool(
      "bench_live", [&] { return options.parse(argc, argv); },
      [&]
      {
        run(line, argc, argv);
        return EXIT_SUCCESS;
      });
}
