#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>
#include "topic_monitor/topic_report.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <limits>
#include <random>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

using pi_os_transport::beginsWithHeader;
using pi_os_transport::DurationHistogram;
using pi_os_transport::formatJson;
using pi_os_transport::formatTable;
using pi_os_transport::parseTopicList;
using pi_os_transport::readHeader;
using pi_os_transport::SequenceTracker;
using pi_os_transport::TopicFigures;
using pi_os_transport::TopicReport;
using pi_os_transport::TopicStatistics;
using pi_os_transport::writeFileAtomically;

namespace
{

constexpr int64_t MS = 1000000;

}  // namespace

TEST(DurationHistogram, IsZeroWhenEmpty)
{
  const DurationHistogram histogram;
  EXPECT_EQ(0U, histogram.count());
  EXPECT_EQ(0, histogram.quantileNs(0.5));
  EXPECT_EQ(0.0, histogram.meanNs());
}

TEST(DurationHistogram, StaysWithinItsPromisedErrorOfExactQuantiles)
{
  std::mt19937_64 random(1);
  std::lognormal_distribution<double> durations(std::log(200e3), 1.5);  // around 200 us, with a long tail
  DurationHistogram histogram;
  std::vector<int64_t> exact;
  for (int i = 0; i < 20000; ++i)
  {
    exact.push_back(static_cast<int64_t>(durations(random)));
    histogram.record(exact.back());
  }
  std::sort(exact.begin(), exact.end());
  for (const double q : {0.01, 0.5, 0.9, 0.99, 0.999})
  {
    const auto rank = static_cast<size_t>(std::ceil(q * static_cast<double>(exact.size()))) - 1;
    EXPECT_GE(histogram.quantileNs(q), exact[rank]) << q;
    EXPECT_LE(static_cast<double>(histogram.quantileNs(q)), static_cast<double>(exact[rank]) * (1.0 + 1.0 / 64)) << q;
  }
  EXPECT_EQ(exact.back(), histogram.quantileNs(1.0));
  EXPECT_EQ(exact.back(), histogram.maxNs());
}

TEST(DurationHistogram, HoldsSmallestAndLargestValues)
{
  DurationHistogram histogram;
  histogram.record(0);
  histogram.record(63);
  histogram.record(64);
  histogram.record(std::numeric_limits<int64_t>::max());
  EXPECT_EQ(0, histogram.quantileNs(0.25));
  EXPECT_EQ(63, histogram.quantileNs(0.5));
  EXPECT_EQ(64, histogram.quantileNs(0.75));
  EXPECT_EQ(std::numeric_limits<int64_t>::max(), histogram.quantileNs(1.0));
}

TEST(DurationHistogram, CountsNegativeDurationsAsZero)
{
  DurationHistogram histogram;
  histogram.record(-5);
  EXPECT_EQ(1U, histogram.count());
  EXPECT_EQ(1U, histogram.negativeCount());
  EXPECT_EQ(0, histogram.maxNs());
}

TEST(SequenceTracker, CountsGapsButNotTheFirstNumber)
{
  SequenceTracker tracker;
  for (const uint32_t seq : {7U, 8U, 11U, 12U})
  {
    tracker.record(seq, 1);
  }
  EXPECT_EQ(2U, tracker.lost());
  EXPECT_EQ(0U, tracker.outOfOrder());
}

TEST(SequenceTracker, TakesLateMessagesOffTheLoss)
{
  SequenceTracker tracker;
  for (const uint32_t seq : {1U, 3U, 2U, 4U})
  {
    tracker.record(seq, 1);
  }
  EXPECT_EQ(0U, tracker.lost());
  EXPECT_EQ(1U, tracker.outOfOrder());
}

TEST(SequenceTracker, SeesNoGapInTheWrapAround)
{
  SequenceTracker tracker;
  tracker.record(std::numeric_limits<uint32_t>::max(), 1);
  tracker.record(0, 1);
  tracker.record(2, 1);
  EXPECT_EQ(1U, tracker.lost());
}

TEST(SequenceTracker, StartsAgainWithANewConnection)
{
  SequenceTracker tracker;
  tracker.record(100, 1);
  tracker.record(0, 2);
  tracker.record(1, 2);
  EXPECT_EQ(0U, tracker.lost());
  EXPECT_EQ(0U, tracker.outOfOrder());
}

TEST(SequenceTracker, CountsTheGapAcrossAReconnectionOfTheSamePublisher)
{
  SequenceTracker tracker;
  tracker.record(100, 1);
  tracker.record(105, 2);
  EXPECT_EQ(4U, tracker.lost());
}

TEST(Header, IsReadFromTheStartOfAMessage)
{
  const uint8_t bytes[] = {5, 0, 0, 0, 2, 0, 0, 0, 3, 0, 0, 0, 0, 0, 0, 0};
  const auto header = readHeader(bytes, sizeof(bytes));
  ASSERT_TRUE(header);
  EXPECT_EQ(5U, header->seq);
  EXPECT_EQ(2000000003LL, header->stamp_ns);
  EXPECT_FALSE(readHeader(bytes, sizeof(bytes) - 1));
  EXPECT_FALSE(readHeader(nullptr, 0));
}

TEST(Header, IsRecognisedOnlyAsTheFirstField)
{
  EXPECT_TRUE(beginsWithHeader("# comment\n\nHeader header  # text\nuint32 height\n"));
  EXPECT_TRUE(beginsWithHeader("std_msgs/Header header\nstring x\n"));
  EXPECT_TRUE(beginsWithHeader("uint8 A=1\nuint8 B = 2\nstring C=Header header\nstd_msgs/Header header\n"));
  EXPECT_FALSE(beginsWithHeader("string data\nHeader header\n"));
  EXPECT_FALSE(beginsWithHeader("geometry_msgs/TransformStamped[] transforms\n===\nMSG: x\nHeader header\n"));
  EXPECT_FALSE(beginsWithHeader("================\nMSG: std_msgs/Header\nHeader header\n"));
  EXPECT_FALSE(beginsWithHeader("Header[] headers\n"));
  EXPECT_FALSE(beginsWithHeader(""));
}

TEST(TopicStatistics, DerivesRateAndBandwidthFromIntervals)
{
  TopicStatistics statistics;
  for (int i = 0; i < 11; ++i)
  {
    statistics.record(1000 * MS + i * 100 * MS, 500, 2 * MS, static_cast<uint32_t>(i), "/a", 1);
  }
  const TopicFigures total = statistics.total();
  EXPECT_EQ(11U, total.messages);
  EXPECT_EQ(5500U, total.bytes);
  EXPECT_DOUBLE_EQ(1.0, total.span_s);
  EXPECT_DOUBLE_EQ(10.0, total.rate_hz);
  EXPECT_DOUBLE_EQ(5000.0, total.bytes_per_second);
  EXPECT_TRUE(total.has_stamps);
  EXPECT_DOUBLE_EQ(2.0, total.latency_max_ms);
  EXPECT_TRUE(total.has_sequence);
  EXPECT_EQ(0U, total.lost);
}

TEST(TopicStatistics, TracksPublishersApart)
{
  TopicStatistics statistics;
  for (uint32_t i = 0; i < 10; ++i)
  {
    statistics.record(i * MS + 1, 1, std::nullopt, i, "/a", 1);
    statistics.record(i * MS + 2, 1, std::nullopt, 1000 + 2 * i, "/b", 2);
  }
  EXPECT_EQ(9U, statistics.total().lost);
  EXPECT_FALSE(statistics.total().has_stamps);
}

TEST(TopicStatistics, WindowsStartAnewAndKeepTheLoss)
{
  TopicStatistics statistics;
  EXPECT_EQ(0.0, statistics.takeWindow(5 * MS).rate_hz);
  statistics.record(1000 * MS, 10, 1 * MS, 0U, "/a", 1);
  statistics.record(1500 * MS, 10, 9 * MS, 2U, "/a", 1);
  const TopicFigures first = statistics.takeWindow(2000 * MS);
  EXPECT_EQ(2U, first.messages);
  EXPECT_DOUBLE_EQ(2.0, first.rate_hz);
  EXPECT_DOUBLE_EQ(9.0, first.latency_max_ms);
  const TopicFigures second = statistics.takeWindow(3000 * MS);
  EXPECT_EQ(0U, second.messages);
  EXPECT_DOUBLE_EQ(1.0, second.span_s);
  EXPECT_EQ(0.0, second.rate_hz);
  EXPECT_FALSE(second.has_stamps);
  EXPECT_EQ(1U, second.lost);
}

TEST(TopicList, IsReadAsTheCommandLineGivesIt)
{
  using List = std::vector<std::string>;
  EXPECT_EQ((List{"/imu/data", "/left/image_raw"}), parseTopicList("[/imu/data, /left/image_raw]"));
  EXPECT_EQ((List{"/imu/data", "left/image_raw"}), parseTopicList(" /imu/data,left/image_raw "));
  EXPECT_EQ((List{"/a", "/b"}), parseTopicList("['/a', \"/b\"]"));
  EXPECT_EQ(List{"/a"}, parseTopicList("/a"));
  EXPECT_EQ(List{}, parseTopicList(""));
  EXPECT_EQ(List{}, parseTopicList("[ ]"));
}

TEST(TopicList, RefusesWhatIsNoListAndSaysWhy)
{
  for (const char* text : {"[/a", "/a]", "[", "]", "/a,,/b", "[/a,]", ",", "/a /b", "['/a]", "[[/a], [/b]]", "''"})
  {
    try
    {
      parseTopicList(text);
      ADD_FAILURE() << text;
    }
    catch (const std::invalid_argument& error)
    {
      EXPECT_EQ(0u, std::string(error.what()).find("topics = \"" + std::string(text) + "\": ")) << error.what();
    }
  }
}

TEST(Report, NamesTransportsAndMarksWhatIsUnknown)
{
  TopicReport report;
  report.topic = "/tf";
  report.transports = {{"SHMROS", 2}, {"TCPROS", 1}};
  const std::string table = formatTable({report});
  EXPECT_NE(std::string::npos, table.find("SHMROS x2, TCPROS")) << table;
  const std::string json = formatJson("/monitor", 1.0, {report});
  EXPECT_NE(std::string::npos, json.find("\"latency_ms\": null")) << json;
  EXPECT_NE(std::string::npos, json.find("\"lost\": null")) << json;
  EXPECT_NE(std::string::npos, json.find("\"SHMROS\": 2")) << json;
}

TEST(Report, EscapesJsonStrings)
{
  EXPECT_NE(std::string::npos, formatJson("a\"b\\c\n", 0.0, {}).find("\"a\\\"b\\\\c\\n\""));
}

TEST(Report, IsWrittenAtomicallyOrNotAtAll)
{
  char folder[] = "/tmp/pi_os_transport_report_XXXXXX";
  ASSERT_NE(nullptr, mkdtemp(folder));
  const std::string path = std::string(folder) + "/report.json";
  EXPECT_EQ("", writeFileAtomically(path, "old"));
  EXPECT_EQ("", writeFileAtomically(path, "new content"));
  std::ifstream file(path);
  EXPECT_EQ("new content", std::string((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>()));

  // A target that cannot be replaced: the reason names it, and no temporary file stays.
  const std::string blocked = std::string(folder) + "/blocked";
  ASSERT_EQ(0, mkdir(blocked.c_str(), 0700));
  EXPECT_NE(std::string::npos, writeFileAtomically(blocked, "x").find(blocked));
  EXPECT_NE(std::string::npos, writeFileAtomically(std::string(folder) + "/no/such", "x").find("No such file"));

  // rmdir succeeds on empty folders only.
  EXPECT_EQ(0, rmdir(blocked.c_str()));
  EXPECT_EQ(0, unlink(path.c_str()));
  EXPECT_EQ(0, rmdir(folder));
}
