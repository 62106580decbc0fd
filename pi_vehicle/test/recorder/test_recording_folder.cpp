#include "recorder/recording_folder.h"

#include <gtest/gtest.h>
#include <pi_node/test_support/message_of.h>
#include <pi_node/test_support/temporary_folder.h>
#include <unistd.h>

#include <stdexcept>

namespace pi_vehicle::recorder
{
namespace
{

using pi_node::test_support::messageOf;
using pi_node::test_support::TemporaryFolder;

constexpr int64_t STAMP_NS = 1764354249 * int64_t{1000000000};
constexpr char NAME[] = "incident_2025-11-28T18-24-09Z_watchdog";

TEST(RecordingFolder, NamesFilesByTimeAndCauseAndNoneTwice)
{
  const TemporaryFolder temporary;
  const RecordingFolder folder(temporary.path());
  EXPECT_EQ(NAME, folder.unusedName(RecordingFolder::INCIDENT, STAMP_NS, "watchdog"));
  temporary.file(std::string(NAME) + ".bag", "");
  temporary.file(std::string(NAME) + "_2.bag.active", "");
  EXPECT_EQ(std::string(NAME) + "_3", folder.unusedName(RecordingFolder::INCIDENT, STAMP_NS, "watchdog"));
  EXPECT_EQ("slim_1970-01-01T00-00-00Z", folder.unusedName(RecordingFolder::SLIM, 0, ""));
}

TEST(RecordingFolder, IsMadeAndHeldByOneRecorder)
{
  const TemporaryFolder temporary;
  const std::string path = temporary.path() + "/a/b";
  RecordingFolder first(path);
  first.open();
  first.open();
  {
    RecordingFolder second(path);
    const std::string text = messageOf<std::runtime_error>([&] { second.open(); });
    EXPECT_EQ(path +
                  " is used by another recorder; end that one, or give this one a folder of its own by the parameter "
                  "folder",
              text);
  }
}

TEST(RecordingFolder, NamesAFolderThatCannotBeMade)
{
  const TemporaryFolder temporary;
  temporary.file("file", "");
  RecordingFolder folder(temporary.path() + "/file/folder");
  EXPECT_NE(std::string::npos, messageOf<std::runtime_error>([&] { folder.open(); }).find("cannot be created: Not a "));
}

TEST(RecordingFolder, DeletesTheOldestFinishedFilesOfAKind)
{
  const TemporaryFolder temporary;
  const std::filesystem::path oldest = temporary.file("slim_a.bag", std::string(1000, 'x'));
  const std::filesystem::path active = temporary.file("slim_b.bag.active", std::string(1000, 'x'));
  const std::filesystem::path older = temporary.file("slim_c.bag", std::string(1000, 'x'));
  const std::filesystem::path newest = temporary.file("slim_d.bag", std::string(1000, 'x'));
  const std::filesystem::path incident = temporary.file("incident_a.bag", std::string(5000, 'x'));
  const RecordingFolder folder(temporary.path());
  EXPECT_EQ(4000u, folder.usage(RecordingFolder::SLIM).bytes);
  EXPECT_EQ((std::vector<std::filesystem::path>{oldest, older}), folder.keepWithin(RecordingFolder::SLIM, 2500));
  EXPECT_TRUE(std::filesystem::exists(active));
  EXPECT_TRUE(std::filesystem::exists(newest));
  EXPECT_TRUE(std::filesystem::exists(incident)) << "incidents have a budget of their own";
  EXPECT_EQ(std::vector<std::filesystem::path>{incident}, folder.keepWithin(RecordingFolder::INCIDENT, 0));
}

TEST(RecordingFolder, ListsWhatARecorderLeftUnfinished)
{
  const TemporaryFolder temporary;
  const std::filesystem::path left = temporary.file("incident_a.bag.active", "x");
  temporary.file("slim_own.bag.active", "x");
  temporary.file("slim_a.bag", "x");
  temporary.file("other.bag.active", "x");
  EXPECT_EQ(std::vector<std::filesystem::path>{left}, RecordingFolder(temporary.path()).unfinished({"slim_own"}));
}

TEST(RecordingFolder, RecoveryDeletesWhatHoldsNothing)
{
  const TemporaryFolder temporary;
  const std::filesystem::path left = temporary.file("slim_a.bag.active", "#ROSBAG V2.0\n");
  recoverFile(left, [](const std::filesystem::path&) { return std::nullopt; });
  EXPECT_FALSE(std::filesystem::exists(left));
}

TEST(RecordingFolder, RecoveryRenamesWhatWasCompleteButForItsName)
{
  const TemporaryFolder temporary;
  const std::filesystem::path left = temporary.file("slim_a.bag.active", std::string(10000, 'x'));
  recoverFile(left, [](const std::filesystem::path&) { return 5; });
  EXPECT_TRUE(std::filesystem::exists(temporary.path() + "/slim_a.bag"));
  EXPECT_FALSE(std::filesystem::exists(left));
}

TEST(RecordingFolder, RecoveryThatWasKilledAtItsEndIsNotDoneTwice)
{
  const TemporaryFolder temporary;
  const std::filesystem::path left = temporary.file("slim_a.bag.active", std::string(10000, 'x'));
  temporary.file("slim_a.bag", "recovered");
  recoverFile(left, [](const std::filesystem::path&) { return 5; });
  EXPECT_FALSE(std::filesystem::exists(left));
  EXPECT_EQ(9u, std::filesystem::file_size(temporary.path() + "/slim_a.bag"));
}

TEST(RecordingFolder, RecoveryKeepsWhatItCannotRead)
{
  const TemporaryFolder temporary;
  const std::filesystem::path left = temporary.file("slim_a.bag.active", std::string(10000, 'x'));
  const std::string text = messageOf<std::runtime_error>(
      [&] { recoverFile(left, [](const std::filesystem::path&) { return std::nullopt; }); });
  EXPECT_NE(std::string::npos, text.find("slim_a.bag.active cannot be recovered now: rosbag reindex says: ")) << text;
  EXPECT_TRUE(std::filesystem::exists(left));
}

}  // namespace
}  // namespace pi_vehicle::recorder
