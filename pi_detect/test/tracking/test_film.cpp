#include "tracking/film.h"

#include <gtest/gtest.h>

namespace
{

using namespace pi_detect;

/// A person of 20 x 40 px who stands at x = 100 to 120.
TruthTracks standingPerson(size_t pictures)
{
  TruthTracks truth;
  truth.first_frame = 7;
  truth.pictures.resize(pictures);
  for (TruthTracks::Picture& picture : truth.pictures)
  {
    picture.boxes.push_back({5, {100.0F, 10.0F, 120.0F, 50.0F}});
  }
  return truth;
}

TEST(ThroughWindow, BoxesMoveAgainstTheWindowAndAreCutAtItsEdges)
{
  const TruthTracks seen = throughWindow(standingPerson(2), {80, 105}, 100);
  EXPECT_EQ(seen.first_frame, 7);
  ASSERT_EQ(seen.pictures.size(), 2U);
  EXPECT_EQ(seen.pictures[0].boxes.at(0).box.x1, 20.0F);
  EXPECT_EQ(seen.pictures[1].boxes.at(0).box.x1, 0.0F);
  EXPECT_EQ(seen.pictures[1].boxes.at(0).box.x2, 15.0F);
  EXPECT_EQ(seen.pictures[0].boxes[0].id, seen.pictures[1].boxes[0].id);
}

TEST(ThroughWindow, WhatIsMostlyOutsideIsIgnoredAndComesBackAsAnother)
{
  const TruthTracks seen = throughWindow(standingPerson(3), {80, 112, 80}, 100);
  EXPECT_TRUE(seen.pictures[1].boxes.empty());
  ASSERT_EQ(seen.pictures[1].ignored.size(), 1U);
  EXPECT_EQ(seen.pictures[1].ignored[0].x2, 8.0F);
  EXPECT_NE(seen.pictures[0].boxes.at(0).id, seen.pictures[2].boxes.at(0).id);
}

TEST(Film, KnowsHowItsWindowMovedThePicture)
{
  Film film;
  film.left = {10, 25, 40};
  const Eigen::Vector2d moved = film.motion(0, 2)(Eigen::Vector2d(100.0, 50.0));
  EXPECT_EQ(moved, Eigen::Vector2d(70.0, 50.0));
}

}  // namespace
