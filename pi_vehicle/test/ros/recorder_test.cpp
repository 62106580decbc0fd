// Judge of recorder.test.

#include "ros/child_node.h"

#include <gtest/gtest.h>
#include <pi_node/test_support/on_graph.h>
#include <pi_node/test_support/temporary_folder.h>
#include <pi_vehicle/ArbiterState.h>
#include <pi_vehicle/Incident.h>
#include <ros/ros.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <rosgraph_msgs/Clock.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/Imu.h>
#include <std_msgs/String.h>
#include <std_srvs/Trigger.h>

#include <atomic>
#include <filesystem>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace pi_vehicle
{

using namespace pi_node::test_support;
namespace
{

namespace fs = std::filesystem;

constexpr int WARN = diagnostic_msgs::DiagnosticStatus::WARN;
constexpr int ERROR = diagnostic_msgs::DiagnosticStatus::ERROR;
constexpr double STEP_S = 0.05;  // of the clock, each 10 ms
constexpr double BEFORE_S = 10.0, AFTER_S = 3.0;
constexpr double TOLERANCE_S = 0.5;  // a step of the clock takes as long to reach another process on a busy computer
constexpr char RECORDER[] = "/recorder";

/// The time of the graph, five times as fast as that of the wall, with a message of each sensor in each step.
class Vehicle
{
public:
  Vehicle()
    : clock_(node_.advertise<rosgraph_msgs::Clock>("/clock", 10))
    , imu_(node_.advertise<sensor_msgs::Imu>("imu/data", 100))
    , odometry_(node_.advertise<std_msgs::String>("odometry", 100))
    , static_(node_.advertise<std_msgs::String>("tf_static", 1, true))
    , picture_(node_.advertise<sensor_msgs::Image>("left/image_raw", 10))
  {
    static_.publish(std_msgs::String());
    image_.encoding = "mono8";
    image_.width = image_.step = 64;
    image_.height = 48;
    image_.data.assign(64 * 48, 100);
    thread_ = std::thread(
        [this]
        {
          while (!stopping_)
          {
            step();
            std::this_thread::sleep_for(std::chrono::milliseconds(10));
          }
        });
  }
  ~Vehicle()
  {
    stopping_ = true;
    thread_.join();
  }
  Vehicle(const Vehicle&) = delete;
  Vehicle& operator=(const Vehicle&) = delete;

  ros::Time now() const
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    return now_;
  }
  void goBack(double seconds)
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    now_ -= ros::Duration(seconds);
  }

private:
  void step()
  {
    rosgraph_msgs::Clock clock;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      now_ += ros::Duration(STEP_S);
      clock.clock = now_;
    }
    clock_.publish(clock);
    sensor_msgs::Imu imu;
    imu.header.stamp = image_.header.stamp = clock.clock;
    imu_.publish(imu);
    odometry_.publish(std_msgs::String());
    picture_.publish(image_);
  }

  ros::NodeHandle node_;
  mutable std::mutex mutex_;
  inline static ros::Time now_{1000.0};  ///< goes on from test to test
  ros::Publisher clock_, imu_, odometry_, static_, picture_;
  sensor_msgs::Image image_;
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

class Recorder : public testing::Test
{
protected:
  Recorder()
  {
    ros::param::del(RECORDER);
    setUp(RECORDER, folder_.path());
  }
  ~Recorder() override { unloadNodelet(RECORDER); }

  static void setUp(const std::string& name, const std::string& folder)
  {
    ros::param::set(name + "/folder", folder);
    ros::param::set(name + "/before_s", BEFORE_S);
    ros::param::set(name + "/after_s", AFTER_S);
    ros::param::set(name + "/min_free_mb", 0);
    ros::param::set(name + "/diagnostic_period", 0.5);
  }

  /// Waits until it records: a message of the continuous file is on the disk.
  bool load()
  {
    return loadNodelet(RECORDER, "pi_vehicle/recorder") &&
           until(TIMEOUT_S, [this] { return !files(".active").empty(); });
  }

  std::vector<fs::path> files(const std::string& ending, const std::string& kind = "") const
  {
    std::vector<fs::path> found;
    for (const fs::directory_entry& entry : fs::directory_iterator(folder_.path()))
    {
      const std::string name = entry.path().filename().string();
      if (entry.path().extension() == ending && name.rfind(kind, 0) == 0)
      {
        found.push_back(entry.path());
      }
    }
    return found;
  }

  bool runFor(double seconds) const
  {
    const ros::Time end = vehicle_.now() + ros::Duration(seconds);
    return until(TIMEOUT_S, [&] { return vehicle_.now() > end; });
  }

  static std::string save(const std::string& recorder = RECORDER)
  {
    std_srvs::Trigger call;
    return ros::service::call(recorder + "/save", call) && call.response.success ? call.response.message : "";
  }

  Vehicle vehicle_;
  TemporaryFolder folder_;
  DiagnosticCollector diagnostics_;
  LogCollector log_;
  Collector<Incident> incidents_{"incident"};
};

struct Content
{
  explicit Content(const std::string& file) : bag(file) {}
  ~Content() { bag.close(); }

  std::vector<ros::Time> times(const std::string& topic)
  {
    std::vector<ros::Time> found;
    rosbag::View view(bag, rosbag::TopicQuery(topic));
    for (const rosbag::MessageInstance& message : view)
    {
      found.push_back(message.getTime());
    }
    return found;
  }
  template <typename Message>
  boost::shared_ptr<Message> first(const std::string& topic)
  {
    rosbag::View view(bag, rosbag::TopicQuery(topic));
    return view.size() == 0 ? nullptr : view.begin()->instantiate<Message>();
  }

  rosbag::Bag bag;
};

TEST_F(Recorder, ServiceSaveWritesFromBeforeToAfterIt)
{
  ASSERT_TRUE(load()) << log_.text();
  ASSERT_TRUE(runFor(BEFORE_S + 5.0));
  const ros::Time asked = vehicle_.now();
  const std::string path = save();
  ASSERT_NE("", path);
  ASSERT_TRUE(until(TIMEOUT_S, [&] { return fs::exists(path); })) << diagnostics_.text();
  Content content(path);
  const std::vector<ros::Time> times = content.times("/imu/data");
  ASSERT_FALSE(times.empty());
  EXPECT_NEAR(-BEFORE_S, (times.front() - asked).toSec(), TOLERANCE_S);
  EXPECT_NEAR(AFTER_S, (times.back() - asked).toSec(), TOLERANCE_S);
  EXPECT_NEAR((BEFORE_S + AFTER_S) / STEP_S, static_cast<double>(times.size()), 30);
  EXPECT_NEAR((BEFORE_S + AFTER_S) * 2.0, static_cast<double>(content.times("/left/image_raw/compressed").size()), 4);
  EXPECT_EQ(0u, content.times("/left/image_raw").size());
  const auto picture = content.first<sensor_msgs::CompressedImage>("/left/image_raw/compressed");
  ASSERT_TRUE(picture);
  EXPECT_EQ("mono8; jpeg compressed mono8", picture->format);
  EXPECT_GE(content.times("/tf_static").size(), 1u) << "latched before the recorder came";
  const auto incident = content.first<Incident>("/incident");
  ASSERT_TRUE(incident);
  EXPECT_EQ("request", incident->cause);
  EXPECT_EQ(path, incident->file);
}

TEST_F(Recorder, TriggersOfTheVehicleJoinAnIncident)
{
  ros::Publisher arbiter = ros::NodeHandle().advertise<ArbiterState>("arbiter/state", 10, true);
  ros::Publisher bumper = ros::NodeHandle().advertise<std_msgs::String>("collision", 10, true);
  ASSERT_TRUE(load()) << log_.text();
  ArbiterState state;
  state.driver = "remote";
  arbiter.publish(state);
  ASSERT_TRUE(incidents_.waitFor([](const Incident& incident) { return incident.cause == "take_over"; }));
  std_msgs::String what;
  what.data = "box";
  bumper.publish(what);
  ASSERT_TRUE(incidents_.waitFor([](const Incident& incident) { return incident.cause == "collision"; }));
  EXPECT_EQ("box", incidents_.last()->text);
  const std::string path = incidents_.last()->file;
  EXPECT_EQ(incidents_.messages().front()->file, path);
  ASSERT_TRUE(until(TIMEOUT_S, [&] { return fs::exists(path); }));
  EXPECT_EQ(2u, Content(path).times("/incident").size());
}

TEST_F(Recorder, CompletesWhatAKilledRecorderLeft)
{
  setUp("/victim", folder_.path());
  ros::Time killed;
  {
    test::ChildNode child(RECORDER_NODE, "victim");
    ASSERT_TRUE(until(TIMEOUT_S, [this] { return !files(".active").empty(); }));
    ASSERT_TRUE(runFor(5.0));
    ASSERT_NE("", save("/victim"));
    ASSERT_TRUE(runFor(2.0));
    ASSERT_FALSE(files(".active", "incident_").empty());
    killed = vehicle_.now();
  }
  ASSERT_TRUE(load()) << log_.text();
  ASSERT_TRUE(until(TIMEOUT_S, [this] { return files(".active").size() == 1; })) << log_.text();
  ASSERT_EQ(1u, files(".bag", "incident_").size());
  Content incident(files(".bag", "incident_").at(0));
  EXPECT_LE((killed - incident.times("/imu/data").back()).toSec(), 1.0);
  Content slim(files(".bag", "slim_").at(0));
  EXPECT_LE((killed - slim.times("/odometry").back()).toSec(), 1.0);
}

TEST_F(Recorder, AClockThatGoesBackBeginsNewFiles)
{
  ASSERT_TRUE(load()) << log_.text();
  ASSERT_TRUE(runFor(2.0));
  vehicle_.goBack(100.0);
  EXPECT_TRUE(log_.waitForText("the clock went back by ")) << log_.text();
  EXPECT_TRUE(until(TIMEOUT_S, [this] { return files(".bag", "slim_").size() == 1 && files(".active").size() == 1; }));
  const std::string path = save();
  ASSERT_TRUE(until(TIMEOUT_S, [&] { return fs::exists(path); }));
  Content content(path);
  const std::vector<ros::Time> times = content.times("/imu/data");
  EXPECT_LT((times.back() - times.front()).toSec(), BEFORE_S + AFTER_S + 1.0) << "nothing of before the jump";
}

TEST_F(Recorder, ASecondRecorderOnAFolderSaysSo)
{
  ASSERT_TRUE(load()) << log_.text();
  setUp("/second", folder_.path());
  ASSERT_TRUE(loadNodelet("/second", "pi_vehicle/recorder"));
  EXPECT_TRUE(diagnostics_.waitForSummary("second: recorder", ERROR, "is used by another recorder"))
      << diagnostics_.text();
  EXPECT_EQ("", save("/second"));
  EXPECT_TRUE(unloadNodelet("/second"));
}

TEST_F(Recorder, PicturesAmongTopicsAreNamed)
{
  ros::param::set(std::string(RECORDER) + "/topics", std::vector<std::string>{"left/image_raw", "no/such"});
  ros::param::set(std::string(RECORDER) + "/pictures", std::vector<std::string>{});
  ASSERT_TRUE(load()) << log_.text();
  EXPECT_TRUE(diagnostics_.waitForSummary("recorder: recorder", WARN, "/left/image_raw has pictures"))
      << diagnostics_.text();
  EXPECT_TRUE(diagnostics_.waitForStatus("recorder: recorder",
                                         [](const diagnostic_msgs::DiagnosticStatus& status)
                                         {
                                           for (const diagnostic_msgs::KeyValue& pair : status.values)
                                           {
                                             if (pair.key == "nothing came yet of")
                                             {
                                               return pair.value.find("/no/such") != std::string::npos &&
                                                      pair.value.find("/odometry") == std::string::npos;
                                             }
                                           }
                                           return false;
                                         }));
}

TEST_F(Recorder, AWrongParameterFailsTheLoad)
{
  ros::param::set(std::string(RECORDER) + "/jpeg_quality", 0);
  ASSERT_TRUE(log_.waitForNode());
  EXPECT_FALSE(loadNodelet(RECORDER, "pi_vehicle/recorder"));
  EXPECT_TRUE(log_.waitForText("/recorder/jpeg_quality = 0, must be in [1, 100]")) << log_.text();
}

}  // namespace
}  // namespace pi_vehicle

int main(int argc, char** argv)
{
  return pi_node::test_support::runOnGraph(argc, argv, "recorder_test");
}
