#include "decision/saved_pose_file.h"

#include <gtest/gtest.h>
#include <pi_node/test_support/temporary_folder.h>

#include <fstream>
#include <regex>
#include <sstream>
#include <stdexcept>
#include <string>

namespace pi_vehicle
{
namespace
{

using pi_node::test_support::TemporaryFolder;

std::string contentOf(const std::string& file)
{
  std::ostringstream text;
  text << std::ifstream(file).rdbuf();
  return text.str();
}

std::string refusal(const std::string& file, const std::string& content)
{
  std::ofstream(file) << content;
  try
  {
    readSavedPose(file, "map", 3600.0);
  }
  catch (const std::invalid_argument& error)
  {
    return error.what();
  }
  return "";
}

class SavedPoseFile : public ::testing::Test
{
protected:
  SavedPoseFile()
  {
    pose_.T_map_base = Eigen::Translation3d(123.456, -7.5, 0.25) *
                       Eigen::AngleAxisd(2.0, Eigen::Vector3d(0.05, 0.0, 1.0).normalized());
    pose_.speed = 1.25;
    pose_.count = 4000000000U;
  }

  const TemporaryFolder folder_;
  const std::string file_ = folder_.path() + "/pose.yaml";
  SavedPose pose_;
};

TEST_F(SavedPoseFile, GivesWhatWasWritten)
{
  EXPECT_FALSE(readSavedPose(file_, "map", 3600.0));
  writeSavedPose(file_, "map", pose_);
  const auto read = readSavedPose(file_, "map", 3600.0);
  ASSERT_TRUE(read);
  EXPECT_LT((read->T_map_base.matrix() - pose_.T_map_base.matrix()).norm(), 1e-6);
  EXPECT_EQ(1.25, read->speed);
  EXPECT_EQ(4000000000U, read->count);
  EXPECT_GE(read->age_s, 0.0);
  EXPECT_LT(read->age_s, 600.0);
}

TEST_F(SavedPoseFile, SaysWhatIsWrongWithAFile)
{
  writeSavedPose(file_, "map", pose_);
  const std::string good = contentOf(file_);
  const auto with = [&good](const char* field, const std::string& value)
  { return std::regex_replace(good, std::regex(std::string(field) + ": .*"), std::string(field) + ": " + value); };
  EXPECT_EQ("", refusal(file_, good));
  EXPECT_EQ(file_ + ": map_frame = \"world\", must be map_frame of this node, \"map\"",
            refusal(file_, with("map_frame", "world")));
  EXPECT_NE(std::string::npos, refusal(file_, with("\ntime", "1000")).find("must be below max_file_age_s = 3600 s"));
  EXPECT_NE(std::string::npos, refusal(file_, with("\ntime", "1e11")).find("in the future"));
  EXPECT_NE("", refusal(file_, with("\ntime", ".nan")));
  EXPECT_NE("", refusal(file_, with("position", "[.nan, 0, 0]")));
  EXPECT_NE("", refusal(file_, with("position", "[1, 0]")));
  EXPECT_NE("", refusal(file_, with("orientation", "[0, 0, 0, 0]")));
  EXPECT_NE("", refusal(file_, with("speed", "fast")));
  EXPECT_NE("", refusal(file_, good.substr(0, good.size() / 2)));
  EXPECT_NE("", refusal(file_, ""));
  EXPECT_NE("", refusal(file_, "\x01\x02: ["));
}

TEST_F(SavedPoseFile, SaysWhyItCannotBeWritten)
{
  const std::string nowhere = folder_.path() + "/none/pose.yaml";
  try
  {
    writeSavedPose(nowhere, "map", pose_);
    FAIL() << "written";
  }
  catch (const std::runtime_error& error)
  {
    EXPECT_EQ("file = " + nowhere +
                  " cannot be written: No such file or directory; name one in a folder that exists, "
                  "with space, and may be written to",
              std::string(error.what()));
  }
}

}  // namespace
}  // namespace pi_vehicle
