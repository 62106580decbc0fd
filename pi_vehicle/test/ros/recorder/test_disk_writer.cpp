#include "ros/recorder/disk_writer.h"

#include <gtest/gtest.h>
#include <pi_node/child_process.h>
#include <pi_node/test_support/temporary_folder.h>
#include <pi_vehicle/Incident.h>
#include <rosbag/view.h>
#include <std_msgs/String.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <map>
#include <vector>

namespace pi_vehicle::recorder
{
namespace
{

using pi_node::test_support::TemporaryFolder;
namespace fs = std::filesystem;

constexpr int64_t SECOND = 1000000000;
constexpr int64_t BEGIN = 1000 * SECOND;  // time of ROS at elapsed 0
constexpr uint64_t PLENTY = 1000000000;

/// The recorder without its topics: one message each 0.1 s on /fast, of which every tenth is slim, and a tick of the
/// disk each second.
struct Recorder
{
  explicit Recorder(const DiskOptions& options, size_t memory_bytes = 100000000)
    : memory(memory_bytes, 61 * SECOND)
    , plan({60 * SECOND, 15 * SECOND, 300 * SECOND})
    , disk(options, &memory, &plan,
           [this](DiskWriter::Level level, const std::string& text) { log[level].push_back(text); })
  {
  }

  void add(const std::string& topic, const std::string& text, bool slim, bool latching = false)
  {
    std_msgs::String message;
    message.data = text;
    auto kept = std::make_shared<KeptMessage>();
    std::shared_ptr<const Channel>& channel = channels[topic];
    if (!channel)
    {
      channel =
          std::make_shared<const Channel>(Channel{topic,
                                                  {{"type", ros::message_traits::datatype(message)},
                                                   {"md5sum", ros::message_traits::md5sum(message)},
                                                   {"message_definition", ros::message_traits::definition(message)},
                                                   {"callerid", "/test"},
                                                   {"latching", latching ? "1" : "0"}}});
    }
    kept->channel = channel;
    kept->stamp_ns = stamps_from + now;
    kept->elapsed_ns = now;
    kept->slim = slim;
    kept->bytes.resize(ros::serialization::serializationLength(message));
    ros::serialization::OStream stream(kept->bytes.data(), static_cast<uint32_t>(kept->bytes.size()));
    ros::serialization::serialize(stream, message);
    memory.add(kept);
  }

  void run(int seconds, size_t bytes = 10)
  {
    for (int tenth = 0; tenth < 10 * seconds; ++tenth)
    {
      now += SECOND / 10;
      add("/fast", std::string(bytes, 'x'), tenth % 10 == 0);
      memory.advance(now);
      if (tenth % 10 == 9)
      {
        disk.tick();
      }
    }
  }

  void trigger(const std::string& cause)
  {
    add("/incident", cause, true);
    const MessageMemory::Batch last = memory.read(memory.end() - 1, 1);
    plan.trigger(last.messages.at(0), plan.nameFor(now).value_or(disk.incidentName(BEGIN + now, cause)));
  }

  MessageMemory memory;
  IncidentPlan plan;
  std::map<DiskWriter::Level, std::vector<std::string>> log;
  std::map<std::string, std::shared_ptr<const Channel>> channels;
  int64_t now = 0;
  int64_t stamps_from = BEGIN;
  DiskWriter disk;  // last: its end may log
};

DiskOptions optionsOf(const std::string& folder)
{
  DiskOptions options;
  options.folder = folder;
  options.slim_file_ns = 600 * SECOND;
  options.slim_budget = PLENTY;
  options.incidents_budget = PLENTY;
  return options;
}

std::vector<fs::path> filesOf(const std::string& folder, const std::string& kind, const std::string& ending = ".bag")
{
  std::vector<fs::path> files;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder))
  {
    if (entry.path().filename().string().rfind(kind, 0) == 0 && entry.path().extension() == ending)
    {
      files.push_back(entry.path());
    }
  }
  std::sort(files.begin(), files.end());
  return files;
}

/// Elapsed seconds of a topic's messages in a bag.
std::vector<double> timesIn(const fs::path& file, const std::string& topic)
{
  rosbag::Bag bag(file.string());
  rosbag::View view(bag, rosbag::TopicQuery(topic));
  std::vector<double> times;
  for (const rosbag::MessageInstance& message : view)
  {
    times.push_back(message.getTime().toSec() - 1e-9 * BEGIN);
  }
  return times;
}

TEST(DiskWriter, AnIncidentReachesFromSixtySecondsBeforeToFifteenAfter)
{
  const TemporaryFolder folder;
  Recorder recorder(optionsOf(folder.path()));
  recorder.add("/latched", "first", false, true);
  recorder.run(100);
  recorder.trigger("watchdog");
  recorder.run(30);
  const std::vector<fs::path> files = filesOf(folder.path(), "incident_");
  ASSERT_EQ(1u, files.size());
  EXPECT_EQ("incident_1970-01-01T00-18-20Z_watchdog.bag", files[0].filename());
  const std::vector<double> times = timesIn(files[0], "/fast");
  ASSERT_EQ(751u, times.size());
  EXPECT_NEAR(40.0, times.front(), 1e-6);
  EXPECT_NEAR(115.0, times.back(), 1e-6);
  EXPECT_EQ(1u, timesIn(files[0], "/incident").size());
  EXPECT_EQ(1u, timesIn(files[0], "/latched").size()) << "what was latched long before is at the begin";
  EXPECT_NEAR(40.0, timesIn(files[0], "/latched").at(0), 1e-6);
}

TEST(DiskWriter, TriggersInARowBecomeOneFile)
{
  const TemporaryFolder folder;
  Recorder recorder(optionsOf(folder.path()));
  recorder.run(100);
  recorder.trigger("watchdog");
  recorder.run(10);
  recorder.trigger("collision");
  recorder.run(14);
  recorder.trigger("take_over");
  recorder.run(30);
  const std::vector<fs::path> files = filesOf(folder.path(), "incident_");
  ASSERT_EQ(1u, files.size());
  EXPECT_EQ(3u, timesIn(files[0], "/incident").size());
  EXPECT_NEAR(139.0, timesIn(files[0], "/fast").back(), 1e-6);
}

TEST(DiskWriter, TheEndOfTheRecorderEndsItsFiles)
{
  const TemporaryFolder folder;
  Recorder recorder(optionsOf(folder.path()));
  recorder.run(5);
  recorder.trigger("request");
  recorder.run(1);
  recorder.disk.finish();
  ASSERT_EQ(1u, filesOf(folder.path(), "incident_").size());
  EXPECT_NEAR(6.0, timesIn(filesOf(folder.path(), "incident_")[0], "/fast").back(), 1e-6);
  ASSERT_EQ(1u, filesOf(folder.path(), "slim_").size());
  EXPECT_EQ(6u, timesIn(filesOf(folder.path(), "slim_")[0], "/fast").size());
}

TEST(DiskWriter, SlimFilesRotateWithinTheirBudget)
{
  const TemporaryFolder folder;
  DiskOptions options = optionsOf(folder.path());
  options.slim_file_ns = 60 * SECOND;
  options.slim_budget = 200000;
  options.incidents_budget = 1;
  Recorder recorder(options);
  recorder.run(100);
  recorder.trigger("watchdog");
  recorder.run(30);
  EXPECT_EQ(1u, recorder.log[DiskWriter::Level::WARN].size()) << "an incident is not deleted silently";
  for (int round = 0; round < 30; ++round)
  {
    recorder.run(60, 100);
    ASSERT_LE(recorder.disk.state().slim_usage.bytes, options.slim_budget);
  }
  EXPECT_GT(filesOf(folder.path(), "slim_").size(), 3u);
  const std::vector<double> times = timesIn(filesOf(folder.path(), "slim_").back(), "/fast");
  EXPECT_NEAR(60.0, static_cast<double>(times.size()), 1.0);
  EXPECT_EQ(1u, recorder.log[DiskWriter::Level::WARN].size());
}

TEST(DiskWriter, AJumpOfTheStampsBeginsANewSlimFile)
{
  const TemporaryFolder folder;
  Recorder recorder(optionsOf(folder.path()));
  recorder.run(5);
  recorder.stamps_from -= 100 * SECOND;
  recorder.run(5);
  recorder.disk.finish();
  const std::vector<fs::path> files = filesOf(folder.path(), "slim_");
  ASSERT_EQ(2u, files.size());
  EXPECT_EQ(5u, timesIn(files[0], "/fast").size());
  EXPECT_EQ(5u, timesIn(files[1], "/fast").size());
}

TEST(DiskWriter, AFullDiskIsOneErrorAndRecordingGoesOn)
{
  const TemporaryFolder folder;
  DiskOptions options = optionsOf(folder.path());
  options.min_free = UINT64_MAX;  // always full
  constexpr size_t memory_bytes = 60000;
  Recorder recorder(options, memory_bytes);
  recorder.run(100, 100);
  recorder.trigger("watchdog");
  recorder.run(5, 100);
  EXPECT_EQ(1u, recorder.log[DiskWriter::Level::ERROR].size());
  const std::string& text = recorder.log[DiskWriter::Level::ERROR].at(0);
  EXPECT_NE(std::string::npos, text.find(folder.path())) << text;
  EXPECT_NE(std::string::npos, text.find("are free there")) << text;
  EXPECT_LE(recorder.memory.usage().bytes, memory_bytes);
  EXPECT_TRUE(filesOf(folder.path(), "incident_").empty());
}

/// Lets no file of this process grow beyond a size: a write behind it fails, as on a full disk.
class FileLimit
{
public:
  explicit FileLimit(rlim_t bytes)
  {
    ::getrlimit(RLIMIT_FSIZE, &before_);
    std::signal(SIGXFSZ, SIG_IGN);
    const rlimit limit{bytes, before_.rlim_max};
    ::setrlimit(RLIMIT_FSIZE, &limit);
  }
  ~FileLimit()
  {
    ::setrlimit(RLIMIT_FSIZE, &before_);
    std::signal(SIGXFSZ, SIG_DFL);
  }
  FileLimit(const FileLimit&) = delete;
  FileLimit& operator=(const FileLimit&) = delete;

private:
  rlimit before_ = {};
};

TEST(DiskWriter, AWriteThatFailsCostsNothingThatTheMemoryHolds)
{
  const TemporaryFolder folder;
  Recorder recorder(optionsOf(folder.path()));
  recorder.run(100, 100);
  recorder.trigger("watchdog");
  {
    const FileLimit limit(30000);  // in the middle of the incident, and of the slim file
    recorder.run(5, 100);
  }
  EXPECT_EQ(1u, recorder.log[DiskWriter::Level::ERROR].size()) << recorder.log[DiskWriter::Level::ERROR].at(1);
  EXPECT_TRUE(filesOf(folder.path(), "incident_").empty());
  recorder.run(30, 100);
  EXPECT_TRUE(recorder.disk.state().problem.empty());
  const std::vector<fs::path> files = filesOf(folder.path(), "incident_");
  ASSERT_FALSE(files.empty());
  const std::vector<double> times = timesIn(files.back(), "/fast");
  EXPECT_EQ(751u, times.size());
  EXPECT_NEAR(115.0, times.back(), 1e-6);
}

TEST(DiskWriter, AFolderThatIsInUseIsOneError)
{
  const TemporaryFolder folder;
  Recorder first(optionsOf(folder.path()));
  Recorder second(optionsOf(folder.path()));
  first.run(2);
  second.run(5);
  EXPECT_EQ(1u, second.log[DiskWriter::Level::ERROR].size());
  EXPECT_TRUE(first.log[DiskWriter::Level::ERROR].empty());
}

TEST(DiskWriter, AKilledRecorderLosesNothingThatItsLastTickWrote)
{
  const TemporaryFolder folder;
  const pid_t child = ::fork();
  ASSERT_GE(child, 0);
  if (child == 0)
  {
    Recorder recorder(optionsOf(folder.path()));
    recorder.run(100);
    recorder.trigger("collision");
    recorder.run(7);
    ::raise(SIGKILL);
  }
  ::waitpid(child, nullptr, 0);
  ASSERT_EQ(1u, filesOf(folder.path(), "incident_", ".active").size());
  {
    Recorder recorder(optionsOf(folder.path()));
    recorder.run(1);
  }  // its end waits for the recovery
  const std::vector<fs::path> files = filesOf(folder.path(), "incident_");
  ASSERT_EQ(1u, files.size());
  EXPECT_TRUE(filesOf(folder.path(), "incident_", ".active").empty());
  const std::vector<double> times = timesIn(files[0], "/fast");
  EXPECT_NEAR(40.0, times.front(), 1e-6);
  EXPECT_NEAR(106.9, times.back(), 1e-6) << "the last chunk, of one message, is lost with its index";
  EXPECT_EQ(1u, timesIn(files[0], "/incident").size());
}

TEST(DiskWriter, ItsBagsOpenInPython)
{
  const TemporaryFolder folder;
  Recorder recorder(optionsOf(folder.path()));
  recorder.run(10);
  recorder.trigger("request");
  recorder.run(20);
  pi_node::ChildOptions options;
  const pi_node::ChildResult result =
      pi_node::runChild("/usr/bin/python3",
                        {"-c",
                         "import rosbag, sys\n"
                         "bag = rosbag.Bag(sys.argv[1])\n"
                         "print([(topic, message.data) for topic, message, _ in bag.read_messages('/incident')])\n"
                         "print(bag.get_message_count('/fast'))",
                         filesOf(folder.path(), "incident_").at(0).string()},
                        options);
  EXPECT_EQ("[('/incident', 'request')]\n250\n", result.output);
}

}  // namespace
}  // namespace pi_vehicle::recorder
