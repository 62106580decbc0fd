// Judge of reaction.test.

#include <gtest/gtest.h>
#include <pi_detect/ObstacleArray.h>
#include <pi_node/test_support/on_graph.h>
#include <pi_node/test_support/temporary_folder.h>
#include <pi_vehicle/MotionCommand.h>
#include <pi_vehicle/ReactionEvent.h>
#include <ros/ros.h>
#include <std_msgs/Empty.h>
#include <std_msgs/String.h>
#include <std_srvs/Trigger.h>

#include <atomic>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace pi_vehicle
{

using namespace pi_node::test_support;
namespace
{

constexpr int OK = diagnostic_msgs::DiagnosticStatus::OK;
constexpr int WARN = diagnostic_msgs::DiagnosticStatus::WARN;
constexpr int ERROR = diagnostic_msgs::DiagnosticStatus::ERROR;

// Gaps as long as a loaded machine may pause.
const char* const RULES = R"(
rules:
  - {name: passenger, label: person, range: [0.5, 4.0], persistence: 0.3, gap: 5.0, action: greet}
  - {name: person ahead, label: person, polygon: [[0, -2], [6, -2], [6, 2], [0, 2]], persistence: 0.2, gap: 5.0, action: slow, speed: 1.2}
  - {name: person close, label: person, polygon: [[0, -1], [2, -1], [2, 1], [0, 1]], persistence: 0.1, gap: 5.0, action: stop}
  - {name: dog, label: dog, range: [0.5, 6.0], persistence: 0.1, gap: 5.0, action: horn}
)";

/// Publishes obstacles as pi_detect does, until it ends.
class Detector
{
public:
  explicit Detector(const std::string& frame = "base_link")
    : publisher_(ros::NodeHandle().advertise<pi_detect::ObstacleArray>("obstacles", 1)), frame_(frame)
  {
    thread_ = std::thread(
        [this]
        {
          while (!stopping_)
          {
            publish();
            std::this_thread::sleep_for(std::chrono::milliseconds(30));
          }
        });
  }
  ~Detector()
  {
    stopping_ = true;
    thread_.join();
  }
  Detector(const Detector&) = delete;
  Detector& operator=(const Detector&) = delete;

  void see(int64_t id, const std::string& label, double x, double y)
  {
    pi_detect::Obstacle3D obstacle;
    obstacle.id = id;
    obstacle.label = label;
    obstacle.score = 0.9;
    obstacle.position.x = x;
    obstacle.position.y = y;
    std::lock_guard<std::mutex> lock(mutex_);
    obstacles_ = {obstacle};
  }
  void seeNothing()
  {
    std::lock_guard<std::mutex> lock(mutex_);
    obstacles_.clear();
  }

private:
  void publish()
  {
    pi_detect::ObstacleArray message;
    message.header.stamp = ros::Time::now();
    message.header.frame_id = frame_;
    {
      std::lock_guard<std::mutex> lock(mutex_);
      message.obstacles = obstacles_;
    }
    publisher_.publish(message);
  }

  ros::Publisher publisher_;
  const std::string frame_;
  std::mutex mutex_;
  std::vector<pi_detect::Obstacle3D> obstacles_;
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

class ReactionNode : public testing::Test
{
protected:
  void SetUp() override
  {
    ros::param::del("/reaction");
    ros::param::set("/reaction/rules_file", folder_.file("rules.yaml", RULES));
    ros::param::set("/reaction/diagnostic_period", 0.1);
    ros::param::set("/reaction/warning_period_s", 30.0);
    ros::param::set("/reaction/greeting", "good day");
    ASSERT_TRUE(loadNodelet("/reaction", "pi_vehicle/reaction"));
    ASSERT_TRUE(motion_.waitForPublisher() && events_.waitForPublisher() && said_.waitForPublisher() &&
                horn_.waitForPublisher());
  }
  void TearDown() override { EXPECT_TRUE(unloadNodelet("/reaction")); }

  bool waitFor(const std::string& reason, double speed)
  {
    motion_.clear();
    return motion_.waitFor([&](const MotionCommand& motion)
                           { return motion.speed == speed && motion.reason.compare(0, reason.size(), reason) == 0; });
  }
  bool waitForNoLimit()
  {
    motion_.clear();
    return motion_.waitFor([&](const MotionCommand& motion) { return motion.speed > 100.0; });
  }
  std::string last() const
  {
    const auto motion = motion_.last();
    return motion ? std::to_string(motion->speed) + " " + motion->reason : "no motion";
  }
  static std_srvs::Trigger::Response reload()
  {
    std_srvs::Trigger trigger;
    EXPECT_TRUE(ros::service::call("/reaction/reload", trigger));
    return trigger.response;
  }

  const TemporaryFolder folder_;
  Collector<MotionCommand> motion_{"motion/reaction"};
  Collector<ReactionEvent> events_{"reaction/events"};
  Collector<std_msgs::String> said_{"say"};
  Collector<std_msgs::Empty> horn_{"horn"};
  DiagnosticCollector diagnostics_;
};

TEST_F(ReactionNode, GreetsOnceAndBoundsTheSpeedWhileSomebodyIsThere)
{
  EXPECT_TRUE(waitFor("no obstacles heard yet", 0.0)) << last();
  Detector detector;
  ASSERT_TRUE(waitForNoLimit()) << last();
  EXPECT_TRUE(diagnostics_.waitForSummary("reaction: reaction", OK, "no limit")) << diagnostics_.text();

  detector.see(7, "person", 3.0, 0.5);
  ASSERT_TRUE(waitFor("person ahead", 1.2)) << last();
  EXPECT_EQ(motion_.last()->max_deceleration, 0.0);
  ASSERT_TRUE(events_.waitFor([](const ReactionEvent& event) { return event.rule == "passenger"; }));
  EXPECT_TRUE(said_.waitFor([](const std_msgs::String& text) { return text.data == "good day"; }));
  detector.see(7, "person", 1.5, 0.5);
  ASSERT_TRUE(waitFor("person close", 0.0)) << last();
  EXPECT_EQ(motion_.last()->max_deceleration, 2.5);
  detector.see(8, "dog", 2.0, 0.0);
  ASSERT_TRUE(until(TIMEOUT_S, [this] { return horn_.last() != nullptr; }));
  detector.seeNothing();
  ASSERT_TRUE(waitForNoLimit()) << last();

  // Each rule once, though obstacles came again and again.
  ASSERT_EQ(events_.messages().size(), 4U);
  for (const auto& event : events_.messages())
  {
    EXPECT_EQ(event->id, event->label == "dog" ? 8 : 7) << event->rule;
    EXPECT_EQ(event->header.frame_id, "base_link");
    EXPECT_GT(event->position.x, 1.0);
  }
  EXPECT_EQ(said_.messages().size(), 1U);
}

TEST_F(ReactionNode, SilenceOfTheObstaclesStops)
{
  {
    Detector detector;
    ASSERT_TRUE(waitForNoLimit()) << last();
  }
  EXPECT_TRUE(waitFor("obstacles silent for", 0.0)) << last();
  EXPECT_TRUE(diagnostics_.waitForSummary("reaction: reaction", ERROR, "obstacles are silent")) << diagnostics_.text();
  Detector detector;
  EXPECT_TRUE(waitForNoLimit()) << last();
}

TEST_F(ReactionNode, SilenceMeansThatNothingIsThereIfToldSo)
{
  ASSERT_TRUE(unloadNodelet("/reaction"));
  ros::param::set("/reaction/need_obstacles", false);
  ASSERT_TRUE(loadNodelet("/reaction", "pi_vehicle/reaction"));
  EXPECT_TRUE(waitForNoLimit()) << last();
  {
    Detector detector;
    detector.see(7, "person", 1.5, 0.0);
    ASSERT_TRUE(waitFor("person close", 0.0)) << last();
  }
  EXPECT_TRUE(waitForNoLimit()) << last();
}

TEST_F(ReactionNode, ObstaclesInAnotherFrameAreRefused)
{
  Detector detector("left_optical");
  EXPECT_TRUE(diagnostics_.waitForStatus(
      "reaction: reaction",
      [](const DiagnosticCollector::Status& status)
      {
        for (const auto& value : status.values)
        {
          if (value.value.find("are in frame \"left_optical\", must be in base_link") != std::string::npos)
          {
            return true;
          }
        }
        return false;
      }))
      << diagnostics_.text();
  EXPECT_TRUE(waitFor("no obstacles heard yet", 0.0)) << last();
}

TEST_F(ReactionNode, ReadsItsRulesAgainAndKeepsThemIfTheFileIsWrong)
{
  Detector detector;
  detector.see(7, "person", 3.0, 0.5);
  ASSERT_TRUE(waitFor("person ahead", 1.2)) << last();
  folder_.file("rules.yaml", "rules: [{name: a, label: person, range: [0, 9], action: dance}]");
  const auto refused = reload();
  EXPECT_EQ(0, refused.success);
  EXPECT_NE(std::string::npos, refused.message.find("the old rules stay: ")) << refused.message;
  EXPECT_NE(std::string::npos, refused.message.find("rules/0/action = \"dance\", must be one of")) << refused.message;
  ASSERT_TRUE(waitFor("person ahead", 1.2)) << last();
  folder_.file("rules.yaml", "rules: [{name: slower, label: person, range: [0, 9], action: slow, speed: 0.4}]");
  const auto taken = reload();
  EXPECT_NE(0, taken.success) << taken.message;
  EXPECT_TRUE(waitFor("slower", 0.4)) << last();
}

TEST_F(ReactionNode, AWrongFileAtTheStartIsOneError)
{
  ASSERT_TRUE(unloadNodelet("/reaction"));
  folder_.file("rules.yaml", "rules: 3");
  const LogCollector log;
  ASSERT_TRUE(log.waitForNode());
  EXPECT_FALSE(loadNodelet("/reaction", "pi_vehicle/reaction"));
  EXPECT_TRUE(log.waitForText("rules.yaml: rules must be a list")) << log.text();
  folder_.file("rules.yaml", RULES);
  ASSERT_TRUE(loadNodelet("/reaction", "pi_vehicle/reaction"));
}

}  // namespace
}  // namespace pi_vehicle

int main(int argc, char** argv)
{
  return pi_node::test_support::runOnGraph(argc, argv, "reaction_test");
}
