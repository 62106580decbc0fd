#include "ros/recorder/recorder_ros_options.h"

#include <pi_node/test_support/options_reader.h>

namespace pi_vehicle
{
namespace
{

using pi_node::test_support::OptionsReader;

const OptionsReader<RecorderRosOptions> READER("/recorder/");

TEST(RecorderRosOptions, FileHoldsTheDefaults)
{
  OptionsReader<RecorderRosOptions>::expectDefaultsOf(RECORDER_YAML);
}

TEST(RecorderRosOptions, RefusalsNameParameterValueAndBound)
{
  EXPECT_EQ("parameter /recorder/memory_mb = 0, must be in [1, 4000]", READER.refusal("{memory_mb: 0}"));
  EXPECT_EQ("parameter /recorder/folder = \"\", must be a path", READER.refusal("{folder: ''}"));
  EXPECT_EQ("parameter /recorder/longest_s = 70, must be in [75, 3600]", READER.refusal("{longest_s: 70.0}"));
  EXPECT_EQ("parameter /recorder/jpeg_quality = 101, must be in [1, 100]", READER.refusal("{jpeg_quality: 101}"));
  EXPECT_EQ("parameter /recorder/picture_rate_hz = 0, must be in [0.01, 60]", READER.refusal("{picture_rate_hz: 0}"));
  EXPECT_EQ("parameter /recorder/slim/thinned_topics = \"imu\", must be in slim/topics",
            READER.refusal("{slim: {thinned_topics: [imu]}}"));
  EXPECT_EQ("parameter /recorder/topics = \"\", must be names of topics: one is empty",
            READER.refusal("{topics: ['']}"));
  EXPECT_NE(std::string::npos, READER.refusal("{topics: ['no topic']}").find("\"no topic\", must be names of topics"));
}

}  // namespace
}  // namespace pi_vehicle
