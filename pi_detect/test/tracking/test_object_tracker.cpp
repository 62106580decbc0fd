#include <gtest/gtest.h>
#include <pi_detect/object_tracker.h>

#include <cmath>
#include <limits>
#include <random>
#include <set>
#include <stdexcept>

namespace
{

using namespace pi_detect;

constexpr int PERSON = 1;
constexpr int BICYCLE = 2;
constexpr int64_t SECOND = 1000000000;
constexpr int64_t STEP = SECOND / 10;
constexpr int64_t START = 1400000000 * SECOND;

/// Of 40 x 100 px around a centre.
Detection person(double x, double y, float score = 0.9F, int class_id = PERSON)
{
  return {class_id,
          score,
          {static_cast<float>(x - 20.0), static_cast<float>(y - 50.0), static_cast<float>(x + 20.0),
           static_cast<float>(y + 50.0)}};
}

double centreX(const ObjectTrack& track)
{
  return 0.5 * (static_cast<double>(track.box.x1) + track.box.x2);
}

/// The message of the exception that options cause, or an empty text.
std::string refusal(const ObjectTrackerOptions& options)
{
  try
  {
    ObjectTracker tracker(options);
  }
  catch (const std::invalid_argument& error)
  {
    return error.what();
  }
  return "";
}

class StandingPerson : public ::testing::Test
{
protected:
  /// Shows the person in a number of pictures.
  std::vector<ObjectTrack> show(int pictures, float score = 0.9F)
  {
    std::vector<ObjectTrack> tracks;
    for (int i = 0; i < pictures; ++i)
    {
      stamp_ += STEP;
      tracks = tracker_.update(stamp_, {person(200.0, 200.0, score)});
    }
    return tracks;
  }

  ObjectTracker tracker_;
  int64_t stamp_ = START;
};

TEST_F(StandingPerson, IsPublishedAfterEnoughDetections)
{
  EXPECT_TRUE(show(2).empty());
  const std::vector<ObjectTrack> tracks = show(1);
  ASSERT_EQ(tracks.size(), 1U);
  EXPECT_EQ(tracks[0].id, 1);
  EXPECT_EQ(tracks[0].class_id, PERSON);
  EXPECT_EQ(tracks[0].hits, 3);
  EXPECT_EQ(tracks[0].first_seen_ns, START + STEP);
  EXPECT_EQ(tracks[0].last_seen_ns, START + 3 * STEP);
}

TEST_F(StandingPerson, NeverBeginsWithWeakDetections)
{
  EXPECT_TRUE(show(20, 0.5F).empty());
}

TEST_F(StandingPerson, ContinuesWithWeakDetections)
{
  show(5);
  const std::vector<ObjectTrack> tracks = show(30, 0.5F);
  ASSERT_EQ(tracks.size(), 1U);
  EXPECT_EQ(tracks[0].id, 1);
  EXPECT_EQ(tracks[0].last_seen_ns, stamp_);
  EXPECT_FLOAT_EQ(tracks[0].score, 0.5F);
}

TEST_F(StandingPerson, IsNotContinuedBelowTheLowScore)
{
  show(5);
  const int64_t last_seen_ns = stamp_;
  const std::vector<ObjectTrack> tracks = show(3, 0.3F);
  ASSERT_EQ(tracks.size(), 1U);
  EXPECT_EQ(tracks[0].last_seen_ns, last_seen_ns);
}

TEST_F(StandingPerson, KeepsItsIdWhenMissedForLessThanTheTimeToLive)
{
  show(5);
  stamp_ += 9 * STEP;
  EXPECT_EQ(tracker_.update(stamp_, {}).size(), 1U);
  const std::vector<ObjectTrack> tracks = show(1);
  ASSERT_EQ(tracks.size(), 1U);
  EXPECT_EQ(tracks[0].id, 1);
}

TEST_F(StandingPerson, EndsAfterTheTimeToLiveAndComesBackWithANewId)
{
  show(5);
  stamp_ += 11 * STEP;
  EXPECT_TRUE(tracker_.update(stamp_, {}).empty());
  const std::vector<ObjectTrack> tracks = show(3);
  ASSERT_EQ(tracks.size(), 1U);
  EXPECT_EQ(tracks[0].id, 2);
}

TEST_F(StandingPerson, EndsAtAGapBetweenPictures)
{
  ObjectTrackerOptions options;
  options.time_to_live_s = 10.0;
  ObjectTracker tracker(options);
  for (int i = 0; i < 5; ++i)
  {
    tracker.update(START + i * STEP, {person(200.0, 200.0)});
  }
  EXPECT_TRUE(tracker.update(START + 4 * STEP + 21 * STEP, {person(200.0, 200.0)}).empty());
}

TEST_F(StandingPerson, IsTheSameAfterPicturesThatAreNotNewer)
{
  show(4);
  const std::vector<ObjectTrack> tracks = show(1);
  for (const int64_t older_ns : {int64_t{0}, STEP, 15 * STEP})
  {
    const std::vector<ObjectTrack> again = tracker_.update(stamp_ - older_ns, {person(600.0, 200.0)});
    ASSERT_EQ(again.size(), 1U);
    EXPECT_EQ(again[0].hits, tracks[0].hits);
    EXPECT_EQ(again[0].last_seen_ns, tracks[0].last_seen_ns);
    EXPECT_FLOAT_EQ(again[0].box.x1, tracks[0].box.x1);
  }
}

TEST_F(StandingPerson, BeginsAnewWithANewIdWhenTimeGoesBackFar)
{
  show(5);
  stamp_ -= 100 * SECOND;
  EXPECT_TRUE(show(2).empty());
  const std::vector<ObjectTrack> tracks = show(1);
  ASSERT_EQ(tracks.size(), 1U);
  EXPECT_EQ(tracks[0].id, 2);
  EXPECT_EQ(tracks[0].last_seen_ns, stamp_);
}

TEST_F(StandingPerson, EndsWhenClearedAndComesBackWithANewId)
{
  show(5);
  tracker_.restart(ObjectTrackerOptions());
  EXPECT_TRUE(tracker_.update(stamp_, {}).empty());
  EXPECT_EQ(show(3).at(0).id, 2);
}

TEST_F(StandingPerson, TakesTheClassWithMostVotes)
{
  show(6);
  stamp_ += STEP;
  std::vector<ObjectTrack> tracks = tracker_.update(stamp_, {person(200.0, 200.0, 0.95F, BICYCLE)});
  ASSERT_EQ(tracks.size(), 1U);
  EXPECT_EQ(tracks[0].id, 1);
  EXPECT_EQ(tracks[0].class_id, PERSON);
  for (int i = 0; i < 20; ++i)
  {
    stamp_ += STEP;
    tracks = tracker_.update(stamp_, {person(200.0, 200.0, 0.95F, BICYCLE)});
  }
  ASSERT_EQ(tracks.size(), 1U);
  EXPECT_EQ(tracks[0].id, 1);
  EXPECT_EQ(tracks[0].class_id, BICYCLE);
}

TEST_F(StandingPerson, IsOneTrackWhenDetectedTwice)
{
  std::vector<ObjectTrack> tracks;
  for (int i = 0; i < 10; ++i)
  {
    Detection torso = person(200.0, 200.0, 0.8F);
    torso.box.y2 = 190.0F;
    stamp_ += STEP;
    tracks = tracker_.update(stamp_, {person(200.0, 200.0), torso, person(201.0, 200.0, 0.7F, BICYCLE)});
  }
  ASSERT_EQ(tracks.size(), 1U);
  EXPECT_NEAR(tracks[0].box.height(), 100.0F, 2.0F);
}

TEST_F(StandingPerson, IsNotDisturbedByBoxesThatAreEmptyOrNotFinite)
{
  constexpr float NOT_A_NUMBER = std::numeric_limits<float>::quiet_NaN();
  constexpr float INFINITE = std::numeric_limits<float>::infinity();
  std::vector<ObjectTrack> tracks;
  for (int i = 0; i < 5; ++i)
  {
    stamp_ += STEP;
    tracks = tracker_.update(stamp_, {person(200.0, 200.0),
                                      {PERSON, 0.9F, {200.0F, 200.0F, 200.0F, 300.0F}},
                                      {PERSON, 0.9F, {300.0F, 200.0F, 200.0F, 300.0F}},
                                      {PERSON, 0.9F, {NOT_A_NUMBER, 200.0F, 200.0F, 300.0F}},
                                      {PERSON, 0.9F, {0.0F, 200.0F, INFINITE, 300.0F}},
                                      {PERSON, NOT_A_NUMBER, {600.0F, 200.0F, 700.0F, 300.0F}}});
  }
  ASSERT_EQ(tracks.size(), 1U);
  EXPECT_NEAR(centreX(tracks[0]), 200.0, 0.5);
}

TEST(ObjectTracker, GivesNothingForNoDetections)
{
  ObjectTracker tracker;
  for (int i = 0; i < 10; ++i)
  {
    EXPECT_TRUE(tracker.update(START + i * STEP, {}).empty());
  }
}

TEST(ObjectTracker, KeepsIdsWhenPeopleCross)
{
  // Both walk at 150 px/s towards each other, 20 px apart in height; only the front one is detected while they overlap
  // by more than half.
  ObjectTracker tracker;
  int64_t left_id = 0;
  int64_t right_id = 0;
  std::vector<ObjectTrack> tracks;
  for (int i = 0; i <= 40; ++i)
  {
    const double x = 15.0 * i;
    Detections detections{person(100.0 + x, 200.0)};
    if (std::abs(600.0 - 2.0 * x) > 20.0)
    {
      detections.push_back(person(700.0 - x, 180.0));
    }
    tracks = tracker.update(START + i * STEP, detections);
    if (i == 10)
    {
      ASSERT_EQ(tracks.size(), 2U);
      left_id = centreX(tracks[0]) < 400.0 ? tracks[0].id : tracks[1].id;
      right_id = centreX(tracks[0]) < 400.0 ? tracks[1].id : tracks[0].id;
    }
  }
  ASSERT_EQ(tracks.size(), 2U);
  for (const ObjectTrack& track : tracks)
  {
    EXPECT_NEAR(centreX(track), track.id == left_id ? 700.0 : 100.0, 5.0);
    EXPECT_NEAR(track.velocity_x, track.id == left_id ? 150.0 : -150.0, 15.0);
  }
  EXPECT_NE(left_id, right_id);
}

TEST(ObjectTracker, PredictsWhatIsNotSeen)
{
  ObjectTracker tracker;
  int i = 0;
  for (; i < 30; ++i)
  {
    tracker.update(START + i * STEP, {person(100.0 + 10.0 * i, 200.0)});
  }
  i += 4;
  const std::vector<ObjectTrack> tracks = tracker.update(START + i * STEP, {});
  ASSERT_EQ(tracks.size(), 1U);
  EXPECT_NEAR(centreX(tracks[0]), 100.0 + 10.0 * i, 4.0);
  EXPECT_EQ(tracks[0].last_seen_ns, START + 29 * STEP);
}

TEST(ObjectTracker, GivesTheSameVelocityAtAnyPictureRate)
{
  for (const int64_t step_ns : {SECOND / 30, SECOND / 10, SECOND / 5})
  {
    ObjectTracker tracker;
    std::vector<ObjectTrack> tracks;
    for (int64_t time_ns = 0; time_ns <= 4 * SECOND; time_ns += step_ns)
    {
      const double time_s = 1e-9 * static_cast<double>(time_ns);
      tracks = tracker.update(START + time_ns, {person(100.0 + 80.0 * time_s, 200.0 - 30.0 * time_s)});
    }
    ASSERT_EQ(tracks.size(), 1U) << step_ns;
    EXPECT_NEAR(tracks[0].velocity_x, 80.0, 2.0) << step_ns;
    EXPECT_NEAR(tracks[0].velocity_y, -30.0, 2.0) << step_ns;
  }
}

TEST(ObjectTracker, FollowsBoxesThatDoNotOverlapFromPictureToPictureByTheirMargin)
{
  // 40 px wide, 42 px further in each picture.
  for (const double margin : {0.0, 0.3})
  {
    ObjectTrackerOptions options;
    options.margin = margin;
    ObjectTracker tracker(options);
    std::vector<ObjectTrack> tracks;
    for (int i = 0; i < 12; ++i)
    {
      tracks = tracker.update(START + i * STEP, {person(50.0 + 42.0 * i, 200.0)});
    }
    ASSERT_EQ(tracks.size(), margin > 0.0 ? 1U : 0U);
    EXPECT_EQ(tracks.empty() ? 0 : tracks[0].hits, margin > 0.0 ? 12 : 0);
  }
}

/// People who stand 60 px apart before a camera that looks around: 45 px to the left or right from picture to picture.
class LookingAround : public ::testing::Test
{
protected:
  /// @return the tracks of the last of 12 pictures.
  std::vector<ObjectTrack> look(ObjectTracker* tracker, bool known) const
  {
    std::vector<ObjectTrack> tracks;
    double pan = 0.0;
    for (int i = 0; i < 12; ++i)
    {
      const double way = i % 4 < 2 ? 45.0 : -45.0;
      pan += way;
      TrackerView view;
      if (known)
      {
        view.motion = [way](const Eigen::Vector2d& point) -> Eigen::Vector2d
        { return point + Eigen::Vector2d(way, 0.0); };
      }
      tracks = tracker->update(START + i * STEP, {person(200.0 + pan, 200.0), person(260.0 + pan, 200.0)}, view);
    }
    return tracks;
  }
};

TEST_F(LookingAround, KeepsIdsIfTheTrackerKnows)
{
  ObjectTracker tracker;
  const std::vector<ObjectTrack> tracks = look(&tracker, true);
  ASSERT_EQ(tracks.size(), 2U);
  EXPECT_EQ(tracks[0].hits, 12);
  EXPECT_EQ(tracks[1].hits, 12);
  EXPECT_NEAR(centreX(tracks[0]), 200.0, 1.0);
  EXPECT_NEAR(tracks[0].velocity_x, -450.0, 5.0) << "velocity is that in the picture";

  ObjectTracker ignorant;
  const std::vector<ObjectTrack> lost = look(&ignorant, false);
  EXPECT_TRUE(lost.size() != 2U || lost[0].hits < 12 || lost[1].hits < 12) << "else this test shows nothing";
}

TEST_F(LookingAround, PlacesOfLostObjectsTurnAsWell)
{
  ObjectTracker tracker;
  int i = 0;
  for (; i < 5; ++i)
  {
    tracker.update(START + i * STEP, {person(200.0, 200.0)});
  }
  TrackerView view;
  view.motion = [](const Eigen::Vector2d& point) -> Eigen::Vector2d { return point + Eigen::Vector2d(80.0, 0.0); };
  for (; i < 10; ++i)
  {
    tracker.update(START + i * STEP, {}, view);
  }
  const std::vector<ObjectTrack> tracks = tracker.update(START + i * STEP, {person(600.0, 200.0)});
  ASSERT_EQ(tracks.size(), 1U);
  EXPECT_EQ(tracks[0].last_seen_ns, START + i * STEP);
}

TEST_F(LookingAround, IsNotDisturbedByAMotionThatIsNotFinite)
{
  ObjectTracker tracker;
  TrackerView view;
  view.motion = [](const Eigen::Vector2d&) -> Eigen::Vector2d
  { return Eigen::Vector2d::Constant(std::numeric_limits<double>::quiet_NaN()); };
  std::vector<ObjectTrack> tracks;
  for (int i = 0; i < 5; ++i)
  {
    tracks = tracker.update(START + i * STEP, {person(200.0, 200.0)}, view);
  }
  ASSERT_EQ(tracks.size(), 1U);
  EXPECT_EQ(tracks[0].hits, 5);
}

TEST(ObjectTracker, TellsObjectsThatMeetApartByTheirColours)
{
  // A dark and a bright one stand 25 px apart and change places from one picture to the next.
  for (const bool looks : {false, true})
  {
    std::vector<uint8_t> pixels(400 * 400);
    PictureView picture{pixels.data(), 400, 400, 400, PictureView::Format::MONO8};
    TrackerView view;
    view.picture = looks ? &picture : nullptr;
    ObjectTracker tracker;
    std::vector<ObjectTrack> tracks;
    for (int i = 0; i < 10; ++i)
    {
      const bool changed = i >= 5;
      for (size_t at = 0; at < pixels.size(); ++at)
      {
        pixels[at] = (at % 400 < 200) == changed ? 200 : 40;
      }
      Detection left = person(187.5, 200.0);
      Detection right = person(212.5, 200.0);
      left.box.x1 -= 5.0F;
      right.box.x2 += 5.0F;
      tracks = tracker.update(START + i * STEP, {left, right}, view);
    }
    ASSERT_EQ(tracks.size(), 2U);
    EXPECT_EQ(centreX(tracks[0]) > 200.0, looks) << "the dark one came first";
  }
}

TEST(ObjectTracker, NeverUsesAnIdAgainAndSortsById)
{
  ObjectTracker tracker;
  std::set<int64_t> ended;
  std::set<int64_t> before;
  std::mt19937 random(3);
  std::uniform_real_distribution<double> place(50.0, 1000.0);
  for (int round = 0; round < 20; ++round)
  {
    Detections detections;
    for (int k = 0; k < 5; ++k)
    {
      detections.push_back(person(place(random), 200.0 + 150.0 * k));
    }
    std::set<int64_t> now;
    for (int i = 0; i < 4; ++i)
    {
      int64_t last = 0;
      now.clear();
      for (const ObjectTrack& track : tracker.update(START + (20 * round + i) * STEP, detections))
      {
        EXPECT_GT(track.id, last);
        EXPECT_EQ(ended.count(track.id), 0U);
        last = track.id;
        now.insert(track.id);
      }
    }
    ASSERT_EQ(now.size(), 5U);
    for (const int64_t id : before)
    {
      if (now.count(id) == 0)
      {
        ended.insert(id);
      }
    }
    before = now;
  }
  EXPECT_GT(ended.size(), 80U);
}

TEST(ObjectTracker, LooksAtTheBestOfThousandsOfDetections)
{
  ObjectTrackerOptions options;
  options.max_objects = 50;
  ObjectTracker tracker(options);
  std::mt19937 random(4);
  std::uniform_real_distribution<double> place(0.0, 1.0e5);
  for (int i = 0; i < 20; ++i)
  {
    Detections detections;
    for (int k = 0; k < 5000; ++k)
    {
      detections.push_back(person(place(random), place(random), 0.8F));
    }
    detections.push_back(person(-500.0, 200.0, 0.9F));
    const std::vector<ObjectTrack> tracks = tracker.update(START + i * STEP, detections);
    EXPECT_LE(tracks.size(), 50U);
    if (i >= 2)
    {
      ASSERT_FALSE(tracks.empty());
      EXPECT_EQ(tracks[0].last_seen_ns, START + i * STEP);
      EXPECT_NEAR(centreX(tracks[0]), -500.0, 1.0);
    }
  }
}

TEST(ObjectTracker, RefusesOptionsOutOfRange)
{
  ObjectTrackerOptions options;
  EXPECT_EQ(refusal(options), "");
  options.confirm_hits = 0;
  EXPECT_EQ(refusal(options), "confirm_hits = 0, must be in [1, 100]");
  options = ObjectTrackerOptions();
  options.scores.low = 0.7;
  EXPECT_EQ(refusal(options), "low_score = 0.7, must be in [0, 0.6]");
  options = ObjectTrackerOptions();
  options.time_to_live_s = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(refusal(options), "time_to_live_s = nan, must be in [0, 60]");
  options = ObjectTrackerOptions();
  options.min_overlap = 0.0;
  EXPECT_NE(refusal(options), "");
}

}  // namespace
