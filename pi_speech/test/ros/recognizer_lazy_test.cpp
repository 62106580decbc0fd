// Judge of recognizer_lazy.test.

#include "ros/recognizer_on_graph.h"

#include <gtest/gtest.h>

namespace pi_speech
{
namespace
{

constexpr int OK = diagnostic_msgs::DiagnosticStatus::OK;

TEST(RecognizerLazy, SubscribesSoundOnlyWhileSomebodyListensIfAskedTo)
{
  const SourceOnGraph source("lazy");
  const DiagnosticCollector diagnostics;
  const auto heard = [&source](uint32_t number)
  { return until(TIMEOUT_S, [&source, number] { return source.listeners() == number; }); };
  ros::param::set("/lazy/recognizer/always_on", false);
  ros::param::set("/lazy/recognizer/diagnostic_period", 0.1);
  ros::param::set("/lazy/recognizer/commands", "/no/such/commands.yaml");
  ASSERT_TRUE(loadNodelet("/lazy/recognizer", "pi_speech/recognizer"));
  ASSERT_TRUE(
      diagnostics.waitForSummary("lazy/recognizer: sound", OK, "/lazy/audio_stamped is not subscribed: nobody listens"))
      << diagnostics.text();
  EXPECT_EQ(0u, source.listeners());
  {
    const Collector<VoiceCommand> commands("/lazy/command");
    EXPECT_TRUE(heard(1)) << diagnostics.text();
    const Collector<std_msgs::String> output("/lazy/recognizer/output");
    ASSERT_TRUE(output.waitForPublisher());
    EXPECT_EQ(1u, source.listeners());
  }
  EXPECT_TRUE(heard(0)) << diagnostics.text();
  {
    const Collector<VoiceCommand> rejected("/lazy/recognizer/rejected");
    EXPECT_TRUE(heard(1)) << diagnostics.text();
  }
  EXPECT_TRUE(heard(0)) << diagnostics.text();
  EXPECT_TRUE(unloadNodelet("/lazy/recognizer"));
}

TEST(RecognizerLazy, SubscribesSoundAlwaysByDefault)
{
  const SourceOnGraph source("always");
  ASSERT_TRUE(loadNodelet("/always/recognizer", "pi_speech/recognizer"));
  EXPECT_TRUE(source.waitForListener());
  EXPECT_TRUE(unloadNodelet("/always/recognizer"));
}

}  // namespace
}  // namespace pi_speech

int main(int argc, char** argv)
{
  return pi_speech::runOnGraph(argc, argv, "recognizer_lazy_test");
}
