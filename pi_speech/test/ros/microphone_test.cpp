// Judge of microphone.test.

#include "audio/sound_bytes.h"
#include "ros/sound_on_graph.h"

#include <gtest/gtest.h>
#include <pi_node/test_support/temporary_folder.h>

#include <string>
#include <vector>

namespace pi_speech
{

using namespace pi_node::test_support;
namespace
{

constexpr int OK = diagnostic_msgs::DiagnosticStatus::OK;
constexpr int WARN = diagnostic_msgs::DiagnosticStatus::WARN;
constexpr int ERROR = diagnostic_msgs::DiagnosticStatus::ERROR;

TEST(MicrophoneNode, GivesWhatItsDeviceRecords)
{
  const TemporaryFolder folder;
  const std::vector<int16_t> recorded = counting(30000, 1);
  const std::string file = folder.file("recorded.raw", sampleBytes(recorded));
  ros::param::set("/recording/microphone/device", "recording:FILE='" + file + "'");
  ros::param::set("/recording/microphone/frame_id", "mast");
  ros::param::set("/recording/microphone/buffer_s", 0.1);  // that much may come before the connection is there
  ros::param::set("/recording/microphone/diagnostic_period", 0.1);
  ros::param::set("/recording/microphone/check/silent_s", 1.0);
  ros::param::set("/recording/microphone/check/window_s", 0.5);
  const SoundCollector sound("recording");
  const DiagnosticCollector diagnostics;
  LogCollector log;
  ASSERT_TRUE(log.waitForNode());
  const ros::Time before = ros::Time::now();
  ASSERT_TRUE(loadNodelet("/recording/microphone", "pi_speech/microphone"));

  ASSERT_TRUE(sound.waitFor(40000)) << log.text() << diagnostics.text();
  ASSERT_EQ(1u, sound.info().messages().size());
  EXPECT_EQ(AudioFormat(), fromMsg(*sound.info().last()));

  // Those before the connection was there are lost; what came then has its order, and silence after its end.
  const std::vector<int16_t> samples = sound.samples();
  const auto first = static_cast<size_t>(samples.front() - 1);
  ASSERT_LT(first, recorded.size());
  const size_t rest = recorded.size() - first;
  EXPECT_EQ(std::vector<int16_t>(recorded.begin() + static_cast<std::ptrdiff_t>(first), recorded.end()),
            std::vector<int16_t>(samples.begin(), samples.begin() + static_cast<std::ptrdiff_t>(rest)));
  EXPECT_EQ(std::vector<int16_t>(samples.size() - rest),
            std::vector<int16_t>(samples.begin() + static_cast<std::ptrdiff_t>(rest), samples.end()));

  const auto messages = sound.messages();
  for (size_t i = 0; i < messages.size(); ++i)
  {
    EXPECT_EQ(640u, messages[i]->audio.data.size());
    EXPECT_EQ("mast", messages[i]->header.frame_id);
    EXPECT_TRUE(i == 0 || messages[i]->header.stamp > messages[i - 1]->header.stamp) << i;
  }
  // What a device without a clock gives first counts as recorded before, one buffer long.
  EXPECT_GT(messages.front()->header.stamp, before - ros::Duration(1.0));
  EXPECT_LT(messages.back()->header.stamp, ros::Time::now() + ros::Duration(1.0));

  EXPECT_TRUE(diagnostics.waitForSummary("recording/microphone: microphone", OK, "16000 Hz, 1 channel"))
      << diagnostics.text();
  EXPECT_TRUE(diagnostics.waitForSummary("recording/microphone: sound", WARN, "is the microphone muted or unplugged?"))
      << diagnostics.text();
  EXPECT_TRUE(log.waitForText("is the microphone muted or unplugged?")) << log.text();
  EXPECT_TRUE(unloadNodelet("/recording/microphone"));
}

TEST(MicrophoneNode, DeviceThatIsNotThereIsNamedAndTheNodeStays)
{
  DiagnosticCollector diagnostics;
  const std::string status = "missing/missing: microphone";
  const std::string problem = "no device Nobody's microphone; there ";
  ASSERT_TRUE(diagnostics.waitForSummary(status, ERROR, problem)) << diagnostics.text();
  for (int i = 0; i < 10; ++i)  // as long as ten tries it is still there, and says so
  {
    diagnostics.clear();
    ASSERT_TRUE(diagnostics.waitForSummary(status, ERROR, problem)) << diagnostics.text();
  }
}

}  // namespace
}  // namespace pi_speech

int main(int argc, char** argv)
{
  return pi_speech::runOnGraph(argc, argv, "microphone_test");
}
