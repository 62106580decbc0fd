// Measures the recorder from outside, on messages as a vehicle has them: stereo pictures of 640x480, IMU and pose at
// 200 Hz, and all the rest at its usual rate.
//   bench_recorder cpu   [--seconds 60] [--frame_rate 20] [--encoding mono8] [-- _picture_rate_hz:=5 ...]
//   bench_recorder kills [--rounds 200] [--folder DIR]    kill -9 at a random moment of each round
//   bench_recorder full  [--rounds 20]                    fills a file system of its own; needs root
// What is behind "--" goes to the recorder. Needs a ROS master. Over π-OS: LD_PRELOAD=.../libpi_os_transport.so.

#include <diagnostic_msgs/DiagnosticArray.h>
#include <nav_msgs/Odometry.h>
#include <pi_detect/Detection2DArray.h>
#include <pi_detect/ObstacleArray.h>
#include <pi_node/child_process.h>
#include <pi_node/command_line.h>
#include <pi_node/durations.h>
#include <pi_vehicle/MotionCommand.h>
#include <pi_vehicle/VehicleState.h>
#include <ros/ros.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <rosgraph_msgs/Log.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/Imu.h>
#include <std_srvs/Trigger.h>
#include <sys/mount.h>
#include <sys/wait.h>
#include <tf2_msgs/TFMessage.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iostream>
#include <map>
#include <mutex>
#include <random>
#include <sstream>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

namespace
{

namespace fs = std::filesystem;

constexpr double PATIENCE_S = 60.0;
constexpr char NAME[] = "bench_recorded";

struct Options
{
  std::string what;
  double seconds = 60.0;
  double frame_rate = 20.0;
  std::string encoding = "mono8";
  int rounds = 0;  // 200 kills, 20 full disks
  unsigned seed = 1;
  std::string folder;
  std::string node;
  std::vector<std::string> arguments;
};

bool until(const std::function<bool()>& condition)
{
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(PATIENCE_S);
  while (!condition())
  {
    if (std::chrono::steady_clock::now() > end)
    {
      return false;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  return true;
}

void pause(double seconds)
{
  std::this_thread::sleep_for(std::chrono::duration<double>(seconds));
}

/// A street: sky, ground, house fronts with windows, and the noise of a camera.
sensor_msgs::ImagePtr picture(const std::string& encoding, std::mt19937* random)
{
  auto image = boost::make_shared<sensor_msgs::Image>();
  const uint32_t channels = encoding == "mono8" ? 1 : 3;
  image->encoding = encoding;
  image->width = 640;
  image->height = 480;
  image->step = image->width * channels;
  image->data.resize(static_cast<size_t>(image->step) * image->height);
  std::normal_distribution<double> noise(0.0, 2.0);
  for (uint32_t y = 0; y < image->height; ++y)
  {
    for (uint32_t x = 0; x < image->width; ++x)
    {
      const bool window = y > 120 && y < 260 && x % 60 > 20 && x % 60 < 45 && y % 50 > 15 && y % 50 < 40;
      const double base = window     ? 60.0
                          : y <= 120 ? 200.0 - 0.2 * y
                          : y < 300  ? 130.0 + 20.0 * (x / 160)
                                     : 90.0 + 0.1 * y;
      for (uint32_t c = 0; c < channels; ++c)
      {
        image->data[y * image->step + x * channels + c] =
            static_cast<uint8_t>(std::clamp(base + 10.0 * c + noise(*random), 0.0, 255.0));
      }
    }
  }
  return image;
}

/// Publishes the topics of a vehicle, each at its rate, on a thread of its own.
class Vehicle
{
public:
  Vehicle(const Options& options, bool pictures)
  {
    std::mt19937 random(options.seed);
    sensor_msgs::Imu imu;
    imu.header.frame_id = "imu";
    add("imu/data", 200.0, imu);
    nav_msgs::Odometry odometry;
    odometry.header.frame_id = "odom";
    odometry.child_frame_id = "base_link";
    add("odometry", 200.0, odometry);
    add("wheel_odometry", 50.0, odometry);
    tf2_msgs::TFMessage tf;
    tf.transforms.resize(2);
    add("/tf", 200.0, tf);
    pi_vehicle::VehicleState state;
    state.detail = "drives";
    add("vehicle_state", 50.0, state);
    pi_vehicle::MotionCommand motion;
    motion.source = "navigation";
    motion.reason = "drives to the goal";
    for (const char* topic : {"motion", "motion/navigation", "motion/reaction", "motion/command"})
    {
      add(topic, std::string(topic) == "motion" ? 50.0 : 20.0, motion);
    }
    pi_detect::ObstacleArray obstacles;
    obstacles.obstacles.resize(10);
    add("obstacles", 20.0, obstacles);
    pi_detect::Detection2DArray detections;
    detections.detections.resize(5);
    add("detections", 10.0, detections);
    diagnostic_msgs::DiagnosticArray diagnostics;
    diagnostics.status.resize(2);
    for (auto& status : diagnostics.status)
    {
      status.name = "node: part";
      status.values.resize(15);
      for (auto& value : status.values)
      {
        value.key = "a value with a name";
        value.value = "12.3 of 45";
      }
    }
    add("/diagnostics", 15.0, diagnostics);
    for (const char* side : {"left", "right"})
    {
      sensor_msgs::CameraInfo info;
      info.D.resize(5);
      add(std::string(side) + "/camera_info", options.frame_rate, info);
      if (pictures)
      {
        addPicture(std::string(side) + "/image_raw", options.frame_rate, picture(options.encoding, &random));
      }
    }
    thread_ = std::thread([this] { run(); });
  }
  ~Vehicle()
  {
    stopping_ = true;
    thread_.join();
  }
  Vehicle(const Vehicle&) = delete;
  Vehicle& operator=(const Vehicle&) = delete;

private:
  struct Stream
  {
    double period_s;
    std::function<void(const ros::Time&)> publish;
    double next_s = 0.0;
  };

  template <typename Message>
  void add(const std::string& topic, double rate, Message message)
  {
    ros::Publisher publisher = node_.advertise<Message>(topic, 1000);
    streams_.push_back({1.0 / rate, [publisher, message](const ros::Time&) { publisher.publish(message); }});
  }
  void addPicture(const std::string& topic, double rate, const sensor_msgs::ImagePtr& image)
  {
    ros::Publisher publisher = node_.advertise<sensor_msgs::Image>(topic, 4);
    streams_.push_back({1.0 / rate, [publisher, image](const ros::Time& now)
                        {
                          image->header.stamp = now;
                          publisher.publish(*image);
                        }});
  }
  void run()
  {
    const auto begin = std::chrono::steady_clock::now();
    while (!stopping_)
    {
      const double now_s = pi_node::secondsSince(begin);
      const ros::Time now = ros::Time::now();
      for (Stream& stream : streams_)
      {
        if (now_s >= stream.next_s)
        {
          stream.publish(now);
          stream.next_s = std::max(stream.next_s + stream.period_s, now_s - 0.5);
        }
      }
      std::this_thread::sleep_for(std::chrono::microseconds(2500));
    }
  }

  ros::NodeHandle node_;
  std::vector<Stream> streams_;
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

/// The recorder as a process of its own.
class Recorder
{
public:
  Recorder(const Options& options, const std::vector<std::string>& more)
  {
    std::vector<std::string> words = {options.node, std::string("__name:=") + NAME, "_folder:=" + options.folder};
    words.insert(words.end(), more.begin(), more.end());
    words.insert(words.end(), options.arguments.begin(), options.arguments.end());
    std::vector<char*> pointers;
    std::transform(words.begin(), words.end(), std::back_inserter(pointers),
                   [](std::string& word) { return &word[0]; });
    pointers.push_back(nullptr);
    pid_ = ::fork();
    if (pid_ == 0)
    {
      std::signal(SIGINT, SIG_DFL);  // which a shell ignores for what it starts in the background
      const int silent = std::freopen("/dev/null", "w", stdout) == nullptr;  // what it logs is on /rosout
      ::execv(pointers[0], pointers.data());
      ::_exit(126 + silent);
    }
  }
  ~Recorder() { end(SIGINT); }
  Recorder(const Recorder&) = delete;
  Recorder& operator=(const Recorder&) = delete;

  void end(int signal)
  {
    if (pid_ > 0)
    {
      ::kill(pid_, signal);
      ::waitpid(pid_, nullptr, 0);
      pid_ = -1;
    }
  }

  double processorSeconds() const
  {
    std::ifstream file("/proc/" + std::to_string(pid_) + "/stat");
    std::string text((std::istreambuf_iterator<char>(file)), {});
    std::istringstream fields(text.substr(text.rfind(')') + 2));
    std::vector<std::string> words{std::istream_iterator<std::string>(fields), {}};
    return (std::stod(words.at(11)) + std::stod(words.at(12))) / static_cast<double>(::sysconf(_SC_CLK_TCK));
  }
  double residentMb(const std::string& field) const
  {
    std::ifstream file("/proc/" + std::to_string(pid_) + "/smaps_rollup");
    for (std::string line; std::getline(file, line);)
    {
      if (line.rfind(field + ":", 0) == 0)
      {
        return 1.024e-3 * std::stod(line.substr(field.size() + 1));
      }
    }
    return 0.0;
  }

private:
  pid_t pid_ = -1;
};

bool save(std::string* text = nullptr)
{
  std_srvs::Trigger call;
  const bool success = ros::service::call(std::string(NAME) + "/save", call) && call.response.success;
  if (text != nullptr)
  {
    *text = call.response.message;
  }
  return success;
}

std::vector<fs::path> filesOf(const std::string& folder, const std::string& ending)
{
  std::vector<fs::path> files;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder))
  {
    if (entry.path().extension() == ending)
    {
      files.push_back(entry.path());
    }
  }
  std::sort(files.begin(), files.end());
  return files;
}

/// Stamps of a topic in a bag [s]. @throws rosbag::BagException
std::vector<double> stampsIn(const fs::path& file, const std::string& topic)
{
  rosbag::Bag bag(file.string());
  rosbag::View view(bag, rosbag::TopicQuery(topic));
  std::vector<double> stamps;
  for (const rosbag::MessageInstance& message : view)
  {
    stamps.push_back(message.getTime().toSec());
  }
  bag.close();
  return stamps;
}

double largestGap(std::vector<double> stamps)
{
  std::sort(stamps.begin(), stamps.end());
  double gap = 0.0;
  for (size_t i = 1; i < stamps.size(); ++i)
  {
    gap = std::max(gap, stamps[i] - stamps[i - 1]);
  }
  return gap;
}

/// How many bags C++ and Python read, of how many.
void printReadable(const std::string& folder)
{
  size_t readable = 0;
  const std::vector<fs::path> files = filesOf(folder, ".bag");
  for (const fs::path& file : files)
  {
    try
    {
      readable += rosbag::View(rosbag::Bag(file.string())).size() > 0 ? 1 : 0;
    }
    catch (const std::exception& error)
    {
      std::cout << file << ": " << error.what() << "\n";
    }
  }
  pi_node::ChildOptions options;
  options.timeout_s = 1800.0;
  const pi_node::ChildResult python =
      pi_node::runChild("/usr/bin/python3",
                        {"-c",
                         "import glob, rosbag, sys\n"
                         "count = 0\n"
                         "for path in glob.glob(sys.argv[1] + '/*.bag'):\n"
                         "    count += sum(1 for _ in rosbag.Bag(path).read_messages(raw=True)) > 0\n"
                         "print(count)",
                         folder},
                        options);
  std::cout << "finished files " << files.size() << "; read by rosbag in C++ " << readable << ", in Python "
            << python.output << "not finished " << filesOf(folder, ".active").size() << "\n";
}

int measureCpu(const Options& options)
{
  const Vehicle vehicle(options, true);
  Recorder recorder(options, {});
  if (!until([&] { return !filesOf(options.folder, ".active").empty(); }))
  {
    throw std::runtime_error("the recorder does not record");
  }
  pause(5.0);
  const double before = recorder.processorSeconds();
  const auto begin = std::chrono::steady_clock::now();
  pause(options.seconds);
  const double taken = recorder.processorSeconds() - before;
  const double seconds = pi_node::secondsSince(begin);
  std::printf("2 x 640x480 %s at %.0f Hz, %.0f s: %.2f %% of a core; memory PSS %.1f MB, private %.1f MB\n",
              options.encoding.c_str(), options.frame_rate, seconds, 100.0 * taken / seconds,
              recorder.residentMb("Pss"), recorder.residentMb("Private_Dirty"));
  const double trigger_before = recorder.processorSeconds();
  std::string path;
  save(&path);
  pause(20.0);
  std::printf("an incident and 20 s: %.2f %% of a core; %.1f MB in %s\n",
              100.0 * (recorder.processorSeconds() - trigger_before) / 20.0,
              fs::exists(path) ? 1e-6 * static_cast<double>(fs::file_size(path)) : 0.0, path.c_str());
  return 0;
}

int countKills(const Options& options)
{
  const Vehicle vehicle(options, false);
  std::mt19937 random(options.seed);
  std::uniform_real_distribution<double> life(0.3, 2.5);
  std::vector<std::pair<fs::path, double>> victims;  // files that were being written, and when that ended
  std::map<fs::path, std::pair<uintmax_t, fs::file_time_type>> finished;
  std::map<fs::path, double> begun;  // when the recorder was started that wrote it first
  std::map<fs::path, double> saved;  // when an incident was asked for
  size_t changed = 0;
  for (int round = 0; round < options.rounds; ++round)
  {
    const std::vector<fs::path> before = filesOf(options.folder, ".active");
    const double begin = ros::Time::now().toSec();
    Recorder recorder(options, {"_before_s:=5", "_after_s:=1"});
    // Until its first message is on the disk: a file of its own, of more than a bag's header.
    const bool records = until(
        [&]
        {
          const std::vector<fs::path> active = filesOf(options.folder, ".active");
          std::error_code gone;
          return std::any_of(
              active.begin(), active.end(),
              [&](const fs::path& file)
              { return std::count(before.begin(), before.end(), file) == 0 && fs::file_size(file, gone) > 5000; });
        });
    if (!records)
    {
      throw std::runtime_error("the recorder does not record");
    }
    pause(life(random));
    std::string path;
    const bool incident = round % 2 == 0 && save(&path);
    saved[path] = ros::Time::now().toSec();
    pause(incident ? life(random) : 0.0);
    recorder.end(SIGKILL);
    for (fs::path file : filesOf(options.folder, ".active"))
    {
      victims.emplace_back(file.replace_extension(), ros::Time::now().toSec());
      begun.emplace(victims.back().first, begin);
    }
    for (const fs::path& file : filesOf(options.folder, ".bag"))
    {
      const auto now = std::make_pair(fs::file_size(file), fs::last_write_time(file));
      changed += finished.count(file) > 0 && finished[file] != now;
      finished[file] = now;
    }
  }
  {
    Recorder last(options, {});
    until(
        [&]
        {
          return std::none_of(victims.begin(), victims.end(),
                              [](const auto& victim) { return fs::exists(victim.first.string() + ".active"); });
        });
  }
  std::vector<double> losses;
  size_t incidents = 0, young = 0;
  double gap = 0.0;
  // A file may be killed twice, the second time while it waits for its recovery: the first time counts.
  std::map<fs::path, double> killed;
  killed.insert(victims.begin(), victims.end());
  for (const auto& [file, time] : killed)
  {
    const bool is_slim = file.filename().string().rfind("slim_", 0) == 0;
    incidents += is_slim ? 0 : 1;
    if (!fs::exists(file))  // deleted, as it held nothing yet: lost is what was on its way
    {
      ++young;
      losses.push_back(saved.count(file) > 0 ? time - saved[file] : time - begun[file]);
      continue;
    }
    const std::vector<double> stamps = stampsIn(file, is_slim ? "/odometry" : "/imu/data");
    losses.push_back(stamps.empty() ? PATIENCE_S : time - stamps.back());
    gap = std::max(gap, largestGap(stamps));
  }
  std::sort(losses.begin(), losses.end());
  printReadable(options.folder);
  std::cout << options.rounds << " kills, " << incidents << " of an incident, " << young
            << " of a file without a message; " << changed << " finished files changed by a later kill\n";
  std::printf("lost before a kill: median %.2f s, most %.2f s of %zu files; largest gap within a file %.2f s\n",
              losses.at(losses.size() / 2), losses.back(), losses.size(), gap);
  return 0;
}

/// A small file system of this program's own.
class SmallDisk
{
public:
  explicit SmallDisk(const std::string& path) : path_(path)
  {
    fs::create_directories(path_);
    if (::mount("none", path_.c_str(), "tmpfs", 0, "size=128m") != 0)
    {
      throw std::runtime_error("skipped: no file system can be mounted on " + path_ + "; this needs root");
    }
  }
  ~SmallDisk() { ::umount2(path_.c_str(), MNT_DETACH); }
  SmallDisk(const SmallDisk&) = delete;
  SmallDisk& operator=(const SmallDisk&) = delete;

  void fill() const
  {
    std::ofstream file(path_ + "/filler", std::ios::binary);
    const std::string block(1 << 20, 'x');
    while (file.write(block.data(), static_cast<std::streamsize>(block.size())).flush())
    {
    }
    std::ofstream rest(path_ + "/filler_2", std::ios::binary);
    while (rest.write(block.data(), 512).flush())
    {
    }
  }
  void empty() const
  {
    fs::remove(path_ + "/filler");
    fs::remove(path_ + "/filler_2");
  }

private:
  const std::string path_;
};

int countFullDisks(Options options)
{
  const std::string mounted = options.folder;
  const SmallDisk disk(mounted);
  options.folder += "/recordings";
  fs::create_directories(options.folder);
  std::atomic<int> errors{0};
  ros::Subscriber log = ros::NodeHandle().subscribe<rosgraph_msgs::Log>(
      "/rosout", 1000,
      [&errors](const rosgraph_msgs::Log::ConstPtr& message)
      {
        if (message->level >= rosgraph_msgs::Log::ERROR && message->name.find(NAME) != std::string::npos)
        {
          std::cout << (errors == 0 ? message->msg + "\n" : "") << std::flush;
          ++errors;
        }
      });
  const Vehicle vehicle(options, false);
  std::mt19937 random(options.seed);
  std::uniform_real_distribution<double> some(0.5, 3.0);
  double most_mb = 0.0;
  int stopped = 0, went_on = 0;
  {
    Recorder recorder(options, {"_before_s:=10", "_after_s:=1", "_min_free_mb:=0", "_slim/budget_mb:=60",
                                "_incidents_budget_mb:=20"});
    until([&] { return !filesOf(options.folder, ".active").empty(); });
    for (int round = 0; round < options.rounds; ++round)
    {
      pause(some(random));
      save();
      pause(0.2 * some(random));
      disk.fill();
      stopped += until([] { return !save(); });
      pause(some(random));
      disk.empty();
      went_on += until([] { return save(); });
      most_mb = std::max(most_mb, recorder.residentMb("Pss"));
    }
    pause(3.0);
  }
  {
    const std::vector<fs::path> left = filesOf(options.folder, ".active");
    Recorder last(options, {"_min_free_mb:=0"});
    until(
        [&]
        {
          return !filesOf(options.folder, ".active").empty() &&
                 std::none_of(left.begin(), left.end(), [](const fs::path& file) { return fs::exists(file); });
        });
  }
  printReadable(options.folder);
  std::vector<double> stamps;
  for (const fs::path& file : filesOf(options.folder, ".bag"))
  {
    const std::vector<double> more = stampsIn(file, "/odometry");
    stamps.insert(stamps.end(), more.begin(), more.end());
  }
  std::printf(
      "%d full disks, %d noticed, %d times recording went on, %d errors logged; largest gap %.2f s; "
      "memory PSS at most %.1f MB\n",
      options.rounds, stopped, went_on, errors.load(), largestGap(stamps), most_mb);
  return 0;
}

bool parse(int argc, char** argv, Options* options)
{
  pi_node::CommandLine line("bench_recorder cpu|kills|full [options] [-- _parameter:=value ...]");
  line.addPositional("what", &options->what, "cpu, kills or full is missing; see --help");
  line.addValue("seconds", &options->seconds, "of the measurement");
  line.addValue("frame_rate", &options->frame_rate, "of the cameras [Hz]");
  line.addValue("encoding", &options->encoding, "mono8 or bgr8");
  line.addValue("rounds", &options->rounds, "0: 200 kills, 20 full disks");
  line.addValue("seed", &options->seed, "of the moments");
  line.addValue("folder", &options->folder, "of the recordings, empty; default: one in /tmp that goes at the end");
  line.addValue("node", &options->node, "default: recorder_node beside this program");
  const auto own_end = std::find(argv + 1, argv + argc, std::string("--"));
  if (!line.parse(std::vector<std::string>(argv + 1, own_end)))
  {
    return false;
  }
  options->arguments.assign(own_end == argv + argc ? own_end : own_end + 1, argv + argc);
  if (options->rounds == 0)
  {
    options->rounds = options->what == "kills" ? 200 : 20;
  }
  if (options->node.empty())
  {
    options->node = (fs::read_symlink("/proc/self/exe").parent_path() / "recorder_node").string();
  }
  return true;
}

int run(int argc, char** argv, Options options)
{
  ros::init(argc, argv, "bench_recorder", ros::init_options::NoSigintHandler);
  ros::NodeHandle node;
  ros::AsyncSpinner spinner(1);
  spinner.start();
  const bool temporary = options.folder.empty();
  if (temporary)
  {
    options.folder = (fs::temp_directory_path() / ("bench_recorder_" + std::to_string(::getpid()))).string();
  }
  fs::create_directories(options.folder);
  const int status = options.what == "cpu"     ? measureCpu(options)
                     : options.what == "kills" ? countKills(options)
                     : options.what == "full"  ? countFullDisks(options)
                                              : throw std::runtime_error(options.what + ", must be cpu, kills or full");
  if (temporary)
  {
    fs::remove_all(options.folder);
  }
  return status;
}

}  // namespace

int main(int argc, char** argv)
{
  Options options;
  return pi_node::runTool(
      "bench_recorder", [&] { return parse(argc, argv, &options); }, [&] { return run(argc, argv, options); });
}
