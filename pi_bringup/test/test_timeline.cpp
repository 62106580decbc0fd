#include <gtest/gtest.h>
#include <pi_bringup/timeline.h>

#include <algorithm>
#include <stdexcept>

using pi_bringup::EurocDataset;
using pi_bringup::Stream;
using pi_bringup::Timeline;
using pi_bringup::TimelineItem;
using pi_bringup::TimelineOptions;

namespace
{

constexpr int64_t S = 1000000000LL;

/// IMU and ground truth at 0, 1, .. 5 s, pictures at 2, 3, 4 s.
EurocDataset dataset()
{
  EurocDataset dataset;
  dataset.left.calibration.rate_hz = 1.0;
  dataset.right.emplace();
  dataset.imu.emplace();
  for (int64_t t = 0; t <= 5; ++t)
  {
    dataset.imu->samples.emplace_back();
    dataset.imu->samples.back().stamp_ns = t * S;
    dataset.ground_truth.emplace_back();
    dataset.ground_truth.back().stamp_ns = t * S;
  }
  for (int64_t t = 2; t <= 4; ++t)
  {
    dataset.left.images.push_back({t * S, ""});
    dataset.right->images.push_back({t * S, ""});
  }
  return dataset;
}

}  // namespace

TEST(Timeline, OrdersByStampAndThenByStream)
{
  const Timeline timeline = Timeline::build(dataset(), {});
  ASSERT_EQ(18U, timeline.items.size());
  EXPECT_TRUE(std::is_sorted(timeline.items.begin(), timeline.items.end(),
                             [](const TimelineItem& a, const TimelineItem& b) { return a.stamp_ns < b.stamp_ns; }));
  EXPECT_EQ(Stream::IMU, timeline.items[4].stream);
  EXPECT_EQ(Stream::GROUND_TRUTH, timeline.items[5].stream);
  EXPECT_EQ(Stream::LEFT, timeline.items[6].stream);
  EXPECT_EQ(Stream::RIGHT, timeline.items[7].stream);
  EXPECT_EQ(0U, timeline.items[6].index);
  EXPECT_EQ(0, timeline.start_ns);
  EXPECT_EQ(6 * S, timeline.period_ns);
}

TEST(Timeline, StartsAtTheFirstPictureIfAsked)
{
  TimelineOptions options;
  options.start_at_first_image = true;
  const Timeline timeline = Timeline::build(dataset(), options);
  EXPECT_EQ(2 * S, timeline.start_ns);
  EXPECT_EQ(2 * S, timeline.items.front().stamp_ns);
  EXPECT_EQ(4 * S, timeline.period_ns);
  EXPECT_EQ(2U, timeline.items.front().index);
}

TEST(Timeline, KeepsTheAskedForPart)
{
  TimelineOptions options;
  options.start_s = 1.0;
  options.duration_s = 2.0;
  const Timeline timeline = Timeline::build(dataset(), options);
  EXPECT_EQ(1 * S, timeline.items.front().stamp_ns);
  EXPECT_EQ(2 * S, timeline.items.back().stamp_ns);  // 3 s is already the end
}

TEST(Timeline, RefusesOptionsOutOfRangeAndEmptyParts)
{
  TimelineOptions options;
  options.start_s = -1.0;
  EXPECT_THROW(Timeline::build(dataset(), options), std::invalid_argument);
  options.start_s = 6.0;
  EXPECT_THROW(Timeline::build(dataset(), options), std::invalid_argument);
  options.start_s = 0.0;
  options.duration_s = -0.1;
  EXPECT_THROW(Timeline::build(dataset(), options), std::invalid_argument);
}
