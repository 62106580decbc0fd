#include <gtest/gtest.h>
#include "tracking/mot_metrics.h"

#include <filesystem>
#include <fstream>
#include <stdexcept>

namespace
{

using namespace pi_detect;

/// 10 x 10 px, at x, moved by parts of its width.
IdentifiedBox at(int64_t id, float x)
{
  return {id, {x, 0.0F, x + 10.0F, 10.0F}};
}

TEST(MotMetrics, ArePerfectForTheTruthItself)
{
  MotEvaluation evaluation;
  for (int i = 0; i < 5; ++i)
  {
    const float x = static_cast<float>(i);
    evaluation.add({at(1, x), at(2, 100.0F + x)}, {at(7, x), at(9, 100.0F + x)});
  }
  const MotMetrics metrics = evaluation.metrics();
  EXPECT_EQ(metrics.pictures, 5);
  EXPECT_EQ(metrics.matches, 10);
  EXPECT_DOUBLE_EQ(metrics.mota, 1.0);
  EXPECT_DOUBLE_EQ(metrics.motp, 1.0);
  EXPECT_DOUBLE_EQ(metrics.idf1, 1.0);
}

TEST(MotMetrics, CountMissesFalsePositivesAndFragments)
{
  // Object 1 is found, missed, found again; a track elsewhere in the second picture.
  MotEvaluation evaluation;
  evaluation.add({at(1, 0.0F)}, {at(5, 0.0F)});
  evaluation.add({at(1, 0.0F)}, {at(6, 50.0F)});
  evaluation.add({at(1, 0.0F)}, {at(5, 0.0F)});
  evaluation.add({at(1, 0.0F)}, {at(5, 0.0F)});
  const MotMetrics metrics = evaluation.metrics();
  EXPECT_EQ(metrics.misses, 1);
  EXPECT_EQ(metrics.false_positives, 1);
  EXPECT_EQ(metrics.fragments, 1);
  EXPECT_EQ(metrics.switches, 0);
  EXPECT_DOUBLE_EQ(metrics.precision, 3.0 / 4.0);
  EXPECT_DOUBLE_EQ(metrics.recall, 3.0 / 4.0);
  EXPECT_DOUBLE_EQ(metrics.mota, 1.0 - 2.0 / 4.0);
  EXPECT_DOUBLE_EQ(metrics.idf1, 2.0 * 3.0 / (4.0 + 4.0));
}

TEST(MotMetrics, CountSwitches)
{
  // Two objects exchange their tracks after three of four pictures: 2 switches, of 8 boxes 6 agree.
  MotEvaluation evaluation;
  for (int i = 0; i < 4; ++i)
  {
    const bool exchanged = i == 3;
    evaluation.add({at(1, 0.0F), at(2, 100.0F)}, {at(exchanged ? 6 : 5, 0.0F), at(exchanged ? 5 : 6, 100.0F)});
  }
  const MotMetrics metrics = evaluation.metrics();
  EXPECT_EQ(metrics.switches, 2);
  EXPECT_EQ(metrics.fragments, 0);
  EXPECT_DOUBLE_EQ(metrics.mota, 1.0 - 2.0 / 8.0);
  EXPECT_DOUBLE_EQ(metrics.idf1, 2.0 * 6.0 / (8.0 + 8.0));
}

TEST(MotMetrics, CountASwitchAcrossAGap)
{
  MotEvaluation evaluation;
  evaluation.add({at(1, 0.0F)}, {at(5, 0.0F)});
  evaluation.add({at(1, 0.0F)}, {});
  evaluation.add({at(1, 0.0F)}, {at(6, 0.0F)});
  const MotMetrics metrics = evaluation.metrics();
  EXPECT_EQ(metrics.switches, 1);
  EXPECT_EQ(metrics.fragments, 1);
  EXPECT_DOUBLE_EQ(metrics.idf1, 2.0 * 1.0 / (3.0 + 2.0));
}

TEST(MotMetrics, KeepTheTrackOfThePictureBeforeThoughAnotherFitsBetter)
{
  MotEvaluation evaluation;
  evaluation.add({at(1, 0.0F)}, {at(5, 0.0F)});
  evaluation.add({at(1, 0.0F)}, {at(5, 2.5F), at(6, 0.0F)});  // overlaps 0.6 and 1
  const MotMetrics metrics = evaluation.metrics();
  EXPECT_EQ(metrics.switches, 0);
  EXPECT_EQ(metrics.false_positives, 1);
  EXPECT_NEAR(metrics.motp, (1.0 + 0.6) / 2.0, 1e-6);
}

TEST(MotMetrics, MatchAsManyAsPossible)
{
  // Track 5 overlaps both objects, track 6 the first one only.
  MotEvaluation evaluation(0.3);
  evaluation.add({at(1, 0.0F), at(2, 6.0F)}, {at(5, 2.0F), at(6, -4.0F)});
  EXPECT_EQ(evaluation.metrics().matches, 2);
}

TEST(MotMetrics, NeedEnoughOverlap)
{
  MotEvaluation strict(0.7);
  strict.add({at(1, 0.0F)}, {at(5, 2.5F)});  // 7.5 / 12.5 = 0.6
  EXPECT_EQ(strict.metrics().misses, 1);
  EXPECT_EQ(strict.metrics().false_positives, 1);
  MotEvaluation lenient(0.55);
  lenient.add({at(1, 0.0F)}, {at(5, 2.5F)});
  EXPECT_EQ(lenient.metrics().matches, 1);
}

TEST(MotMetrics, LeaveTracksInIgnoredRegionsOut)
{
  const Box region{100.0F, 0.0F, 200.0F, 100.0F};
  MotEvaluation evaluation;
  evaluation.add({at(1, 120.0F)}, {at(5, 120.0F), at(6, 150.0F), at(7, 94.0F), at(8, 96.0F)}, {region});
  const MotMetrics metrics = evaluation.metrics();
  EXPECT_EQ(metrics.matches, 1);
  EXPECT_EQ(metrics.false_positives, 1);  // 7 is inside by 40 %, 6 and 8 by more than half
  EXPECT_EQ(metrics.track_boxes, 2);
}

TEST(MotMetrics, AreZeroWithoutPictures)
{
  const MotMetrics metrics = MotEvaluation().metrics();
  EXPECT_DOUBLE_EQ(metrics.mota, 0.0);
  EXPECT_DOUBLE_EQ(metrics.motp, 0.0);
  EXPECT_DOUBLE_EQ(metrics.idf1, 0.0);
}

TEST(MotMetrics, RefuseIdsThatAreTwiceInAPicture)
{
  MotEvaluation evaluation;
  EXPECT_THROW(evaluation.add({at(1, 0.0F), at(1, 50.0F)}, {}), std::invalid_argument);
  EXPECT_THROW(evaluation.add({}, {at(1, 0.0F), at(1, 50.0F)}), std::invalid_argument);
  EXPECT_EQ(evaluation.metrics().pictures, 0);
  EXPECT_THROW(MotEvaluation(0.0), std::invalid_argument);
  EXPECT_THROW(MotEvaluation(1.1), std::invalid_argument);
}

/// A file of truth for a test, removed afterwards.
class TruthFile : public ::testing::Test
{
protected:
  TruthFile()
    : path_(std::filesystem::temp_directory_path() /
            ("pi_detect_truth_" + std::to_string(::testing::UnitTest::GetInstance()->random_seed()) + "_" +
             ::testing::UnitTest::GetInstance()->current_test_info()->name()))
  {
  }
  ~TruthFile() override { std::filesystem::remove(path_); }

  TruthTracks load(const std::string& text) const
  {
    std::ofstream(path_) << text;
    return TruthTracks::load(path_.string());
  }

  std::string refusal(const std::string& text) const
  {
    try
    {
      load(text);
    }
    catch (const std::runtime_error& error)
    {
      return error.what();
    }
    return "";
  }

  std::filesystem::path path_;
};

TEST_F(TruthFile, IsInterpolatedBetweenKeyFrames)
{
  const TruthTracks truth = load("# a comment\n# frames 10 15\n14,3,8,0,18,14\n10,3,0,0,10,10\n12,0,1,2,3,4\n");
  EXPECT_EQ(truth.first_frame, 10);
  ASSERT_EQ(truth.pictures.size(), 6U);
  ASSERT_EQ(truth.pictures[1].boxes.size(), 1U);
  EXPECT_EQ(truth.pictures[1].boxes[0].id, 3);
  EXPECT_FLOAT_EQ(truth.pictures[1].boxes[0].box.x1, 2.0F);
  EXPECT_FLOAT_EQ(truth.pictures[1].boxes[0].box.y2, 11.0F);
  EXPECT_FLOAT_EQ(truth.pictures[4].boxes.at(0).box.x2, 18.0F);
  EXPECT_TRUE(truth.pictures[5].boxes.empty());
  EXPECT_EQ(truth.pictures[2].ignored.size(), 1U);
  EXPECT_TRUE(truth.pictures[1].ignored.empty());
}

TEST_F(TruthFile, IsRefusedWithTheLineThatIsWrong)
{
  EXPECT_NE(refusal("1,1,0,0,1,1\n").find(":1: a box before"), std::string::npos);
  EXPECT_NE(refusal("# frames 5 4\n").find(":1: "), std::string::npos);
  EXPECT_NE(refusal("# frames 0 4\n1,1,0,0,1\n").find(":2: '1,1,0,0,1', must be frame,id"), std::string::npos);
  EXPECT_NE(refusal("# frames 0 4\n1,1,0,0,1,1,9\n").find(":2: "), std::string::npos);
  EXPECT_NE(refusal("# frames 0 4\n5,1,0,0,1,1\n").find("frame 5, must be in [0, 4]"), std::string::npos);
  EXPECT_NE(refusal("# frames 0 4\n1,1,0,0,0,1\n").find("x1 < x2"), std::string::npos);
  EXPECT_NE(refusal("# frames 0 4\n1,1,0,0,1,1\n1,1,0,0,2,2\n").find(":3: id 1 is twice"), std::string::npos);
  EXPECT_NE(refusal("# only a comment\n").find("no line '# frames"), std::string::npos);
  EXPECT_THROW(TruthTracks::load("/no/such/file.csv"), std::runtime_error);
}

TEST(TruthTracks, OfThisPackageAreCompleteAndInsideTheirPictures)
{
  const std::string folder = std::string(PI_DETECT_TEST_DATA) + "/";
  const struct
  {
    const char* file;
    float width;
    float height;
    size_t people;
  } recordings[] = {{"vtest_tracks.csv", 768.0F, 576.0F, 10}, {"one_by_one_tracks.csv", 768.0F, 432.0F, 2}};
  for (const auto& recording : recordings)
  {
    const TruthTracks truth = TruthTracks::load(folder + recording.file);
    EXPECT_EQ(truth.pictures.size(), 200U);
    std::map<int64_t, Box> last;
    for (const TruthTracks::Picture& picture : truth.pictures)
    {
      for (const IdentifiedBox& object : picture.boxes)
      {
        EXPECT_GE(object.box.x1, 0.0F);
        EXPECT_GE(object.box.y1, 0.0F);
        EXPECT_LE(object.box.x2, recording.width);
        EXPECT_LE(object.box.y2, recording.height);
        const auto before = last.find(object.id);
        if (before != last.end())
        {
          EXPECT_GT(overlap(before->second, object.box), 0.3F) << recording.file << ", id " << object.id;
        }
        last[object.id] = object.box;
      }
    }
    EXPECT_EQ(last.size(), recording.people);
  }
}

}  // namespace
