#include <gtest/gtest.h>
#include <pi_detect/detection.h>

namespace pi_detect
{
namespace
{

TEST(Detection, OverlapIsIntersectionOverUnion)
{
  EXPECT_FLOAT_EQ(1.0F, overlap(Box{0, 0, 4, 2}, Box{0, 0, 4, 2}));
  EXPECT_FLOAT_EQ(1.0F / 3.0F, overlap(Box{0, 0, 4, 2}, Box{2, 0, 6, 2}));
  EXPECT_FLOAT_EQ(0.0F, overlap(Box{0, 0, 1, 1}, Box{1, 0, 2, 1}));
  EXPECT_FLOAT_EQ(0.0F, overlap(Box{0, 0, 0, 0}, Box{0, 0, 0, 0}));
}

TEST(Detection, ABoxTurnedInsideOutIsEmpty)
{
  EXPECT_FLOAT_EQ(0.0F, (Box{4, 0, 2, 2}.area()));
}

TEST(Detection, AcrossClassesTheBestOfOverlappingBoxesStays)
{
  Detections detections = {{1, 0.4F, {0, 0, 10, 10}}, {3, 0.9F, {1, 0, 11, 10}}, {1, 0.5F, {20, 0, 30, 10}}};
  suppressAcrossClasses(0.5F, &detections);
  ASSERT_EQ(2u, detections.size());
  EXPECT_EQ(3, detections[0].class_id);
  EXPECT_FLOAT_EQ(0.5F, detections[1].score);
}

TEST(Detection, ABoxSuppressedItselfSuppressesNoOther)
{
  // The middle one overlaps both others, which hardly overlap each other.
  Detections detections = {{1, 0.9F, {0, 0, 10, 10}}, {1, 0.8F, {4, 0, 14, 10}}, {1, 0.7F, {8, 0, 18, 10}}};
  suppressAcrossClasses(0.4F, &detections);
  ASSERT_EQ(2u, detections.size());
  EXPECT_FLOAT_EQ(0.7F, detections[1].score);
}

}  // namespace
}  // namespace pi_detect
