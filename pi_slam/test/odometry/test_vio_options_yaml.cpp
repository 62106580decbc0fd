#include <gtest/gtest.h>
#include <pi_node/test_support/message_of.h>
#include <pi_node/test_support/temporary_folder.h>
#include "odometry/vio_options_yaml.h"

#include <set>

namespace
{

using namespace pi_slam;
using pi_node::test_support::messageOf;
using pi_node::test_support::TemporaryFolder;

class VioOptionsYaml : public testing::Test
{
protected:
  void load(const std::string& text, const std::vector<std::string>& foreign = {})
  {
    loadOptionsYaml(folder_.file("options.yaml", text), &vio_, &mapper_, foreign);
  }

  std::string errorOf(const std::string& text)
  {
    return messageOf<OptionsError>([&] { load(text); });
  }

  TemporaryFolder folder_;
  VioOptions vio_;
  MapperOptions mapper_;
};

TEST_F(VioOptionsYaml, ReadsEveryTypeOfValue)
{
  load(
      "tracker: {max_features: 210, epipolar_px: 2, kernel_tasks: true}\n"
      "imu:\n  time_offset_s: -0.0125\n  gyro_scale: [1.02, 1, 0.99]\n"
      "map: {max_keyframes: 500, tile_folder: /var/tiles}\n"
      "vio: {max_speed: 12.5}\n");
  EXPECT_EQ(vio_.tracker.max_features, 210);
  EXPECT_DOUBLE_EQ(vio_.tracker.epipolar_px, 2.0);
  EXPECT_TRUE(vio_.tracker.kernel_tasks);
  EXPECT_DOUBLE_EQ(vio_.imu.time_offset_s, -0.0125);
  EXPECT_EQ(vio_.imu.gyro_scale, (std::vector<double>{1.02, 1.0, 0.99}));
  EXPECT_EQ(mapper_.max_keyframes, 500u);
  EXPECT_EQ(mapper_.tile_folder, "/var/tiles");
  EXPECT_DOUBLE_EQ(vio_.max_speed, 12.5);
  EXPECT_EQ(vio_.tracker.levels, StereoTrackerOptions().levels);  // as it was
}

TEST_F(VioOptionsYaml, ReadsKeysWithSlashes)
{
  load("tracker/max_features: 99\nwindow/keyframes: 7\n");
  EXPECT_EQ(vio_.tracker.max_features, 99);
  EXPECT_EQ(vio_.window.keyframes, 7);
}

TEST_F(VioOptionsYaml, LeavesOptionsAloneForAnEmptyFile)
{
  vio_.tracker.max_features = 77;
  load("# nothing\n");
  EXPECT_EQ(vio_.tracker.max_features, 77);
}

TEST_F(VioOptionsYaml, ReachesEveryFieldByItsOwnKey)
{
  // A table that named a field twice, or two fields alike, would lose a value.
  const std::vector<OptionField> fields = optionFields(&vio_, &mapper_);
  std::set<std::string> keys;
  std::set<const void*> places;
  for (const OptionField& field : fields)
  {
    keys.insert(field.key);
    std::visit([&](const auto* value) { places.insert(value); }, field.value);
  }
  EXPECT_EQ(keys.size(), fields.size());
  EXPECT_EQ(places.size(), fields.size());
}

TEST_F(VioOptionsYaml, NamesAnUnknownKeyAndTheNearestOne)
{
  const std::string error = errorOf("tracker: {max_feature: 3}\n");
  EXPECT_NE(error.find("options.yaml: tracker/max_feature is not known; did you mean tracker/max_features?"),
            std::string::npos)
      << error;
  EXPECT_NE(errorOf("max_blind_s: 3\n").find("did you mean vio/max_blind_s?"), std::string::npos);
  EXPECT_NE(errorOf("tracker: {deep: {er: 3}}\n").find("tracker/deep/er is not known"), std::string::npos);
}

TEST_F(VioOptionsYaml, RefusesValuesOfAnotherType)
{
  EXPECT_NE(errorOf("tracker: {max_features: 2.5}\n").find("tracker/max_features is \"2.5\", expected a whole number"),
            std::string::npos);
  EXPECT_NE(errorOf("tracker: {kernel_tasks: 3}\n").find("expected true or false"), std::string::npos);
  EXPECT_NE(errorOf("imu: {rate_hz: fast}\n").find("imu/rate_hz is \"fast\", expected a number"), std::string::npos);
  EXPECT_NE(errorOf("imu: {rate_hz: .nan}\n").find("expected a finite number"), std::string::npos);
  EXPECT_NE(errorOf("imu: {rate_hz: [1, 2]}\n").find("is no single value, expected a number"), std::string::npos);
  EXPECT_NE(errorOf("imu: {rate_hz: }\n").find("expected a number"), std::string::npos);
  EXPECT_NE(errorOf("map: {max_keyframes: -4}\n").find("is -4, expected a whole number, 0 or more"), std::string::npos);
  EXPECT_NE(errorOf("tracker: {max_features: 99999999999}\n").find("expected a whole number"), std::string::npos);
}

TEST_F(VioOptionsYaml, RefusesAKeyThatIsThereTwice)
{
  EXPECT_NE(errorOf("tracker: {levels: 3}\ntracker/levels: 2\n").find("tracker/levels is there twice"),
            std::string::npos);
}

TEST_F(VioOptionsYaml, ChangesNothingOnAnError)
{
  EXPECT_NE(errorOf("tracker: {max_features: 33}\nwindow: {nonsense: 1}\n"), "");
  EXPECT_EQ(vio_.tracker.max_features, VioOptions().tracker.max_features);
}

TEST_F(VioOptionsYaml, RefusesFilesThatAreNoMap)
{
  EXPECT_NE(messageOf<OptionsError>([&] { loadOptionsYaml("/nowhere.yaml", &vio_, &mapper_); }).find("missing"),
            std::string::npos);
  EXPECT_NE(errorOf("- 1\n- 2\n").find("is no map"), std::string::npos);
  EXPECT_NE(errorOf("{a: [1\n").find("is no YAML"), std::string::npos);
  EXPECT_NE(errorOf("? [1, 2]\n: 3\n").find("a key is no word"), std::string::npos);
}

TEST_F(VioOptionsYaml, PassesOverForeignKeys)
{
  load("odom_frame: odom\ncalibration: {source: file, tracker: 3}\ntracker: {levels: 3}\n",
       {"odom_frame", "calibration"});
  EXPECT_EQ(vio_.tracker.levels, 3);
}

}  // namespace
