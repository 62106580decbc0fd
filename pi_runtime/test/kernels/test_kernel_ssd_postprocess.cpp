#include <gtest/gtest.h>

#include <algorithm>

#include "kernels/codelet_runner.h"
#include "kernels/ssd_outputs.h"

namespace pi_runtime::kernels
{
namespace
{

const SsdVariances VARIANCES{0.1F, 0.1F, 0.2F, 0.2F};

using Detections = std::vector<SsdDetection>;

double overlapOf(const SsdDetection& a, const SsdDetection& b)
{
  const cv::Rect2d first(cv::Point2d(a.x1, a.y1), cv::Point2d(a.x2, a.y2));
  const cv::Rect2d second(cv::Point2d(b.x1, b.y1), cv::Point2d(b.x2, b.y2));
  const double both = (first & second).area();
  return both / (first.area() + second.area() - both);
}

/// The definition, in double precision and without any thought of speed.
Detections reference(const SsdOutputs& outputs, const SsdShape& shape)
{
  std::vector<std::pair<double, SsdDetection>> candidates;
  for (int p = 0; p < shape.priors; ++p)
  {
    const float* row = &outputs.confidences[static_cast<size_t>(p) * shape.classes];
    const float* l = &outputs.locations[static_cast<size_t>(p) * 4];
    const SsdPrior& prior = outputs.priors[p];
    double sum = 0.0;
    for (int c = 0; c < shape.classes; ++c)
    {
      sum += std::exp(static_cast<double>(row[c]));
    }
    for (int c = 0; c < shape.classes; ++c)
    {
      double score = row[c];
      score = (shape.flags & SSD_SOFTMAX) != 0 ? std::exp(score) / sum : score;
      score = (shape.flags & SSD_SIGMOID) != 0 ? 1.0 / (1.0 + std::exp(-score)) : score;
      if (c == shape.background || score < shape.score_threshold)
      {
        continue;
      }
      const double cx = prior.cx + l[0] * VARIANCES.x * prior.width;
      const double cy = prior.cy + l[1] * VARIANCES.y * prior.height;
      const double w = prior.width * std::exp(l[2] * VARIANCES.width) / 2;
      const double h = prior.height * std::exp(l[3] * VARIANCES.height) / 2;
      candidates.push_back(
          {score, SsdDetection{0, static_cast<float>(c), static_cast<float>(score), static_cast<float>(cx - w),
                               static_cast<float>(cy - h), static_cast<float>(cx + w), static_cast<float>(cy + h)}});
    }
  }
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const auto& a, const auto& b) { return a.first > b.first; });
  const bool agnostic = (shape.flags & SSD_CLASS_AGNOSTIC) != 0;
  std::vector<int> looked_at(shape.classes, 0);
  Detections kept;
  for (const auto& [score, candidate] : candidates)
  {
    if (looked_at[agnostic ? 0 : static_cast<int>(candidate.class_id)]++ >= shape.top_k)
    {
      continue;
    }
    const bool suppressed = std::any_of(
        kept.begin(), kept.end(),
        [&, box = candidate](const SsdDetection& better)
        { return (agnostic || better.class_id == box.class_id) && overlapOf(better, box) > shape.overlap_threshold; });
    if (!suppressed)
    {
      kept.push_back(candidate);
    }
  }
  kept.resize(std::min(kept.size(), static_cast<size_t>(shape.keep_top_k)));
  return kept;
}

class SsdPostprocess : public testing::Test
{
protected:
  template <typename T>
  static Argument in(const std::vector<T>& values)
  {
    const auto owner = std::make_shared<std::vector<T>>(values);
    return Argument::in(Buffer::wrap(static_cast<void*>(owner->data()), owner->size() * sizeof(T), owner));
  }

  static std::vector<Argument> argumentsFor(const SsdOutputs& outputs, const SsdShape& shape)
  {
    return {in(outputs.locations),
            in(outputs.confidences),
            in(outputs.priors),
            Argument::out(Buffer::allocate(ssdWorkBytes(shape))),
            Argument::out(Buffer::allocate(shape.keep_top_k * sizeof(SsdDetection))),
            Argument::out(Buffer::allocate(sizeof(int32_t))),
            Argument::value(shape),
            Argument::value(VARIANCES)};
  }

  /// The detections, on whose bits both implementations must agree.
  static Detections run(const SsdOutputs& outputs, const SsdShape& shape)
  {
    const std::vector<Argument> native = argumentsFor(outputs, shape);
    const std::vector<Argument> opencl = argumentsFor(outputs, shape);
    CodeletRunner::shared().native(ssdPostprocessCodelet(), native, 1);
    CodeletRunner::shared().opencl(ssdPostprocessCodelet(), opencl, 1);
    const int count = *native[5].buffer()->hostAs<const int32_t>(Access::READ);
    EXPECT_EQ(*opencl[5].buffer()->hostAs<const int32_t>(Access::READ), count);
    const auto* rows = native[4].buffer()->hostAs<const SsdDetection>(Access::READ);
    EXPECT_EQ(std::memcmp(rows, opencl[4].buffer()->host(Access::READ), count * sizeof(SsdDetection)), 0);
    return Detections(rows, rows + count);
  }

  static SsdShape shapeOf(const SsdOutputs& outputs, int flags, float threshold)
  {
    return {static_cast<int32_t>(outputs.priors.size()), outputs.classes, 0, 400, 100, threshold, 0.45F, flags};
  }

  static void expectNear(const SsdDetection& a, const SsdDetection& b, size_t row)
  {
    EXPECT_EQ(a.image, 0.0F);
    EXPECT_EQ(a.class_id, b.class_id) << "row " << row;
    EXPECT_NEAR(a.score, b.score, 2e-6) << "row " << row;
    EXPECT_NEAR(a.x1, b.x1, 2e-6) << "row " << row;
    EXPECT_NEAR(a.y1, b.y1, 2e-6) << "row " << row;
    EXPECT_NEAR(a.x2, b.x2, 2e-6) << "row " << row;
    EXPECT_NEAR(a.y2, b.y2, 2e-6) << "row " << row;
  }

  static void expectReference(const SsdOutputs& outputs, const SsdShape& shape)
  {
    const Detections ours = run(outputs, shape);
    const Detections expected = reference(outputs, shape);
    ASSERT_EQ(ours.size(), expected.size());
    for (size_t i = 0; i < ours.size(); ++i)
    {
      expectNear(ours[i], expected[i], i);
    }
  }
};

TEST_F(SsdPostprocess, FollowsItsDefinitionWithSoftmax)
{
  for (const float threshold : {0.01F, 0.3F})
  {
    const SsdOutputs ssd300 = makeSsdOutputs(ssd300Priors(), 21, 1);
    expectReference(ssd300, shapeOf(ssd300, SSD_SOFTMAX, threshold));
    const SsdOutputs mobilenet = makeSsdOutputs(mobilenetSsdPriors(), 91, 2);
    expectReference(mobilenet, shapeOf(mobilenet, SSD_SOFTMAX, threshold));
  }
}

TEST_F(SsdPostprocess, FollowsItsDefinitionWithSigmoidAndWithoutBackground)
{
  SsdOutputs outputs = makeSsdOutputs(mobilenetSsdPriors(), 9, 3);
  for (float& value : outputs.confidences)
  {
    value -= 4.0F;
  }
  SsdShape shape = shapeOf(outputs, SSD_SIGMOID, 0.2F);
  expectReference(outputs, shape);
  shape.background = -1;
  expectReference(outputs, shape);
  shape.background = 8;
  expectReference(outputs, shape);
}

TEST_F(SsdPostprocess, SuppressesAcrossClassesIfAgnostic)
{
  const SsdOutputs outputs = makeSsdOutputs(mobilenetSsdPriors(), 91, 4);
  const SsdShape shape = shapeOf(outputs, SSD_SOFTMAX | SSD_CLASS_AGNOSTIC, 0.02F);
  expectReference(outputs, shape);
  const Detections found = run(outputs, shape);
  for (size_t i = 0; i < found.size(); ++i)
  {
    for (size_t k = 0; k < i; ++k)
    {
      EXPECT_LE(overlapOf(found[i], found[k]), 0.45 + 1e-5);
    }
  }
}

TEST_F(SsdPostprocess, LooksAtTopKCandidatesAndKeepsTopKDetections)
{
  const SsdOutputs outputs = makeSsdOutputs(ssd300Priors(), 21, 5);
  SsdShape shape = shapeOf(outputs, SSD_SOFTMAX, 0.01F);
  shape.top_k = 3;
  shape.keep_top_k = 7;
  expectReference(outputs, shape);
  EXPECT_EQ(run(outputs, shape).size(), 7U);
}

TEST_F(SsdPostprocess, FindsNothingWhereThereIsNothing)
{
  SsdOutputs outputs = makeSsdOutputs(mobilenetSsdPriors(), 21, 6);
  for (size_t row = 0; row < outputs.confidences.size(); row += 21)
  {
    outputs.confidences[row] = 60.0F;
  }
  EXPECT_TRUE(run(outputs, shapeOf(outputs, SSD_SOFTMAX, 0.01F)).empty());
}

TEST_F(SsdPostprocess, EqualScoresComeInTheOrderOfClassAndPrior)
{
  SsdOutputs outputs = makeSsdOutputs(ssd300Priors(), 3, 7);
  std::fill(outputs.confidences.begin(), outputs.confidences.end(), 0.5F);
  SsdShape shape = shapeOf(outputs, SSD_RAW, 0.5F);
  shape.overlap_threshold = 1.0F;
  shape.keep_top_k = 1000;
  shape.top_k = 20;
  const Detections found = run(outputs, shape);
  ASSERT_EQ(found.size(), 40U);
  for (int i = 0; i < 40; ++i)
  {
    EXPECT_EQ(found[i].class_id, i < 20 ? 1.0F : 2.0F);
    const SsdPrior& prior = outputs.priors[i % 20];
    EXPECT_NEAR((found[i].x1 + found[i].x2) / 2, prior.cx + outputs.locations[4 * (i % 20)] * 0.1F * prior.width, 1e-6);
  }
}

TEST_F(SsdPostprocess, CutsBoxesAtTheBorderIfAskedTo)
{
  const SsdOutputs outputs = makeSsdOutputs(ssd300Priors(), 21, 8);
  const Detections free = run(outputs, shapeOf(outputs, SSD_SOFTMAX, 0.1F));
  const Detections cut = run(outputs, shapeOf(outputs, SSD_SOFTMAX | SSD_CLIP, 0.1F));
  ASSERT_EQ(free.size(), cut.size());
  ASSERT_FALSE(cut.empty());
  const auto clip = [](float value) { return std::min(std::max(value, 0.0F), 1.0F); };
  for (size_t i = 0; i < cut.size(); ++i)
  {
    EXPECT_EQ(cut[i].x1, clip(free[i].x1));
    EXPECT_EQ(cut[i].y2, clip(free[i].y2));
  }
}

TEST_F(SsdPostprocess, AgreesWithTheDetectionOutputLayerOfOpenCv)
{
  SsdOutputs outputs = makeSsdOutputs(ssd300Priors(), 21, 9);
  softmaxRows(&outputs);
  const SsdShape shape = shapeOf(outputs, SSD_RAW, 0.02F);
  const cv::Mat theirs = OpenCvDetectionOutput(outputs, shape, VARIANCES).run();
  Detections expected(theirs.rows);
  std::memcpy(expected.data(), theirs.data, expected.size() * sizeof(SsdDetection));
  std::stable_sort(expected.begin(), expected.end(),
                   [](const SsdDetection& a, const SsdDetection& b) { return a.score > b.score; });
  const Detections ours = run(outputs, shape);
  ASSERT_EQ(ours.size(), expected.size());
  ASSERT_GT(ours.size(), 20U);
  for (size_t i = 0; i < ours.size(); ++i)
  {
    expectNear(ours[i], expected[i], i);
  }
}

TEST_F(SsdPostprocess, AgreesWithNmsBoxesOfOpenCv)
{
  SsdOutputs outputs = makeSsdOutputs(mobilenetSsdPriors(), 2, 10);
  for (float& value : outputs.confidences)
  {
    value -= 6.0F;
  }
  SsdShape shape = shapeOf(outputs, SSD_SIGMOID, 0.3F);
  shape.top_k = 5000;
  shape.keep_top_k = 1000;
  SsdShape unsuppressed = shape;
  unsuppressed.overlap_threshold = 1.0F;
  std::vector<cv::Rect2d> boxes;
  std::vector<float> scores;
  const Detections candidates = run(outputs, unsuppressed);
  ASSERT_LT(candidates.size(), 1000U);
  ASSERT_GT(candidates.size(), 50U);
  for (const SsdDetection& d : candidates)
  {
    boxes.emplace_back(cv::Point2d(d.x1, d.y1), cv::Point2d(d.x2, d.y2));
    scores.push_back(d.score);
  }
  std::vector<int> kept;
  cv::dnn::NMSBoxes(boxes, scores, 0.3F, 0.45F, kept);
  const Detections ours = run(outputs, shape);
  ASSERT_EQ(ours.size(), kept.size());
  for (size_t i = 0; i < ours.size(); ++i)
  {
    EXPECT_EQ(ours[i].score, scores[kept[i]]);
    EXPECT_EQ(ours[i].x1, candidates[kept[i]].x1);
  }
}

TEST_F(SsdPostprocess, RefusesWhatDoesNotFit)
{
  const SsdOutputs outputs = makeSsdOutputs(mobilenetSsdPriors(), 5, 11);
  const SsdShape good = shapeOf(outputs, SSD_SOFTMAX, 0.1F);
  const auto refuses = [&](const std::vector<Argument>& arguments)
  {
    EXPECT_THROW(CodeletRunner::shared().native(ssdPostprocessCodelet(), arguments, 1), std::runtime_error);
    EXPECT_THROW(CodeletRunner::shared().opencl(ssdPostprocessCodelet(), arguments, 1), std::runtime_error);
  };
  for (size_t index = 0; index < 6; ++index)
  {
    std::vector<Argument> arguments = argumentsFor(outputs, good);
    arguments[index] = Argument::out(Buffer::allocate(arguments[index].buffer()->bytes() - 1));
    refuses(arguments);
  }
  std::vector<SsdShape> bad(4, good);
  bad[0].score_threshold = 0.0F;
  bad[1].background = 5;
  bad[2].flags = SSD_SOFTMAX | SSD_SIGMOID;
  bad[3].keep_top_k = 0;
  for (const SsdShape& shape : bad)
  {
    std::vector<Argument> arguments = argumentsFor(outputs, good);
    arguments[6] = Argument::value(shape);
    refuses(arguments);
  }
}

TEST(SsdPriors, HaveTheNumbersOfTheKnownNetworks)
{
  EXPECT_EQ(ssd300Priors().size(), 8732U);
  EXPECT_EQ(mobilenetSsdPriors().size(), 1917U);
}

TEST(SsdPriors, ComeByRowColumnAndBox)
{
  const std::vector<SsdPrior> priors = makeSsdPriors({{3, 2, {{0.2F, 0.1F}, {0.4F, 0.4F}}}}, false);
  ASSERT_EQ(priors.size(), 12U);
  EXPECT_FLOAT_EQ(priors[0].cx, 0.5F / 3);
  EXPECT_FLOAT_EQ(priors[0].cy, 0.25F);
  EXPECT_FLOAT_EQ(priors[1].width, 0.4F);
  EXPECT_FLOAT_EQ(priors[2].cx, 1.5F / 3);
  EXPECT_FLOAT_EQ(priors[6].cy, 0.75F);
}

TEST(SsdPriors, HaveTheSizesOfThePaper)
{
  const std::vector<SsdBoxSize> sizes = ssdBoxSizes(0.2F, 0.45F, {1.0F, 4.0F});
  ASSERT_EQ(sizes.size(), 3U);
  EXPECT_FLOAT_EQ(sizes[0].width, 0.2F);
  EXPECT_FLOAT_EQ(sizes[1].width, 0.3F);
  EXPECT_FLOAT_EQ(sizes[2].width, 0.4F);
  EXPECT_FLOAT_EQ(sizes[2].height, 0.1F);
}

TEST(SsdPriors, AreCutAtTheBorder)
{
  const std::vector<SsdPrior> priors = makeSsdPriors({{1, 1, {{1.5F, 0.5F}}}}, true);
  EXPECT_FLOAT_EQ(priors[0].width, 1.0F);
  EXPECT_FLOAT_EQ(priors[0].height, 0.5F);
}

TEST(SsdPriors, RefuseEmptyFeatureMaps)
{
  EXPECT_THROW(makeSsdPriors({{1, 1, {}}}, false), std::invalid_argument);
  EXPECT_THROW(makeSsdPriors({{0, 1, {{1.0F, 1.0F}}}}, false), std::invalid_argument);
}

}  // namespace
}  // namespace pi_runtime::kernels
