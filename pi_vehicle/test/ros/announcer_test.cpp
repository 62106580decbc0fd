// Judge of announcer.test.

#include "ros/announcer_ros.h"
#include "ros/child_node.h"

#include <gtest/gtest.h>
#include <pi_node/ros/parameter_values.h>
#include <pi_node/test_support/on_graph.h>
#include <pi_node/test_support/temporary_folder.h>
#include <pi_node/test_support/yaml_parameters.h>
#include <ros/ros.h>
#include <std_msgs/Empty.h>
#include <std_msgs/String.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <memory>
#include <set>
#include <stdexcept>
#include <string>

namespace pi_vehicle
{

using namespace pi_node::test_support;
namespace
{

constexpr int OK = diagnostic_msgs::DiagnosticStatus::OK;
constexpr int WARN = diagnostic_msgs::DiagnosticStatus::WARN;

TEST(AnnouncerRosOptions, FileAndCodeAreEqual)
{
  const XmlRpc::XmlRpcValue yaml = fromYaml(YAML::LoadFile(CONFIG_DIR "/announcer.yaml"));
  std::vector<std::string> unknown;
  const AnnouncerRosOptions options = AnnouncerRosOptions::fromParameters(yaml, "", &unknown);
  EXPECT_EQ(std::vector<std::string>(), unknown);
  EXPECT_EQ(pi_node::parameters::text(AnnouncerRosOptions().toParameters()),
            pi_node::parameters::text(options.toParameters()));
  std::set<std::string> in_file;
  std::set<std::string> in_code;
  collectNames(yaml, "", &in_file);
  collectNames(AnnouncerRosOptions().toParameters(), "", &in_code);
  EXPECT_EQ(in_code, in_file);
  EXPECT_THROW(AnnouncerRosOptions::fromParameters(fromYaml(YAML::Load("horn_s: 0")), "", &unknown),
               std::invalid_argument);
}

TEST(HornSound, IsAsLongAsAskedForAndStartsAndEndsSoftly)
{
  const std::vector<int16_t> sound = hornSound(8000, 0.5);
  ASSERT_EQ(sound.size(), 4000U);
  EXPECT_EQ(sound.front(), 0);
  EXPECT_LT(std::abs(sound.back()), 1000);
  EXPECT_GT(*std::max_element(sound.begin(), sound.end()), 20000);
}

class AnnouncerNode : public testing::Test
{
protected:
  void start(const std::string& device)
  {
    const std::string conf = "pcm.null { type null }\npcm.recorder { type file\n slave { pcm null }\n file \"" + file_ +
                             "\"\n format raw }\n";
    ASSERT_EQ(0, ::setenv("ALSA_CONFIG_PATH", folder_.file("asound.conf", conf).c_str(), 1));
    ros::param::del("/announcer");
    ros::param::set("/announcer/device", device);
    ros::param::set("/announcer/diagnostic_period", 0.1);
    say_ = ros::NodeHandle().advertise<std_msgs::String>("say", 10);
    horn_ = ros::NodeHandle().advertise<std_msgs::Empty>("horn", 1);
    node_ = std::make_unique<test::ChildNode>(ANNOUNCER_NODE, "announcer");
    ASSERT_TRUE(until(TIMEOUT_S, [this] { return say_.getNumSubscribers() > 0 && horn_.getNumSubscribers() > 0; }));
    ASSERT_TRUE(diagnostics_.waitForPublisher());
  }
  void say(const std::string& text)
  {
    std_msgs::String message;
    message.data = text;
    say_.publish(message);
  }
  /// Samples on the device that are no silence.
  size_t heard() const
  {
    std::ifstream file(file_, std::ios::binary);
    const std::string bytes((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
    size_t loud = 0;
    for (size_t i = 0; i + 1 < bytes.size(); i += 2)
    {
      const auto sample =
          static_cast<int16_t>(static_cast<unsigned char>(bytes[i]) | (static_cast<unsigned char>(bytes[i + 1]) << 8));
      loud += std::abs(static_cast<int>(sample)) > 500 ? 1 : 0;
    }
    return loud;
  }

  const TemporaryFolder folder_;
  const std::string file_ = folder_.path() + "/sound.raw";
  ros::Publisher say_;
  ros::Publisher horn_;
  DiagnosticCollector diagnostics_;
  std::unique_ptr<test::ChildNode> node_;
};

TEST_F(AnnouncerNode, SpeaksAndBlowsTheHorn)
{
  start("recorder");
  say("hello, I am a vehicle");
  ASSERT_TRUE(diagnostics_.waitForValue("announcer: announcer", "sounds heard", "1")) << diagnostics_.text();
  EXPECT_TRUE(diagnostics_.waitForSummary("announcer: announcer", OK, "is heard")) << diagnostics_.text();
  EXPECT_GT(heard(), 5000U) << "a quarter of a second of loud samples at least";
  horn_.publish(std_msgs::Empty());
  ASSERT_TRUE(diagnostics_.waitForValue("announcer: announcer", "sounds heard", "2")) << diagnostics_.text();
  EXPECT_GT(heard(), 10000U) << "the horn alone has 0.6 s";
}

TEST_F(AnnouncerNode, WithoutADeviceItSaysSoAndGoesOn)
{
  const LogCollector log;
  start("nowhere");
  ASSERT_TRUE(log.waitForNode());
  say("hello");
  say("hello again");
  ASSERT_TRUE(diagnostics_.waitForValue("announcer: announcer", "sounds not heard", "2")) << diagnostics_.text();
  EXPECT_TRUE(diagnostics_.waitForSummary("announcer: announcer", WARN, "sound device \"nowhere\" cannot be opened"))
      << diagnostics_.text();
  EXPECT_TRUE(log.waitForText("says: hello again") && log.waitForText("cannot be opened")) << log.text();
  size_t complaints = 0;
  for (const auto& line : log.messages())
  {
    complaints += line->msg.find("cannot be opened") != std::string::npos ? 1 : 0;
  }
  EXPECT_EQ(complaints, 1U) << log.text();
}

}  // namespace
}  // namespace pi_vehicle

int main(int argc, char** argv)
{
  return pi_node::test_support::runOnGraph(argc, argv, "announcer_test");
}
