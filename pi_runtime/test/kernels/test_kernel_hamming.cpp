#include <gtest/gtest.h>

#include <bitset>
#include <opencv2/features2d.hpp>

#include <pi_runtime/kernels/hamming.h>
#include "kernels/codelet_runner.h"
#include "kernels/kernel_pictures.h"

namespace pi_runtime::kernels
{
namespace
{

/// Descriptors of which many are close to each other, so that there are ties.
cv::Mat someDescriptors(int count, uint64_t seed)
{
  cv::RNG random(seed);
  cv::Mat centres(7, HAMMING_BYTES, CV_8U);
  cv::RNG(99).fill(centres, cv::RNG::UNIFORM, 0, 256);
  cv::Mat descriptors(count, HAMMING_BYTES, CV_8U);
  for (int i = 0; i < count; ++i)
  {
    centres.row(random.uniform(0, 7)).copyTo(descriptors.row(i));
    for (int flip = random.uniform(0, 6); flip > 0; --flip)
    {
      descriptors.at<uint8_t>(i, random.uniform(0, HAMMING_BYTES)) ^= 1 << random.uniform(0, 8);
    }
  }
  return descriptors;
}

class Hamming : public testing::Test
{
protected:
  using Matches = std::vector<HammingMatch>;

  static std::vector<Argument> argumentsFor(const cv::Mat& queries, const cv::Mat& trains, const HammingShape& shape)
  {
    const auto in = [](const cv::Mat& mat) { return Argument::in(mat.empty() ? Buffer::allocate(1) : wrapMat(mat)); };
    const size_t bytes = std::max(1, shape.queries) * sizeof(HammingMatch);
    return {in(queries), in(trains), Argument::out(Buffer::allocate(bytes)), Argument::value(shape)};
  }

  static Matches result(const std::vector<Argument>& arguments, int count)
  {
    const auto* matches = arguments[2].buffer()->hostAs<const HammingMatch>(Access::READ);
    return Matches(matches, matches + count);
  }

  /// The matches, which both implementations must agree on.
  static Matches match(const cv::Mat& queries, const cv::Mat& trains, const HammingShape& shape)
  {
    const std::vector<Argument> native = argumentsFor(queries, trains, shape);
    const std::vector<Argument> opencl = argumentsFor(queries, trains, shape);
    CodeletRunner::shared().native(hammingCodelet(), native, shape.queries);
    CodeletRunner::shared().opencl(hammingCodelet(), opencl, shape.queries);
    expectEqual(result(native, shape.queries), result(opencl, shape.queries));
    return result(native, shape.queries);
  }

  static void expectEqual(const Matches& a, const Matches& b)
  {
    ASSERT_EQ(a.size(), b.size());
    for (size_t i = 0; i < a.size(); ++i)
    {
      EXPECT_EQ(a[i].best, b[i].best) << "query " << i;
      EXPECT_EQ(a[i].second, b[i].second) << "query " << i;
      EXPECT_EQ(a[i].best_distance, b[i].best_distance) << "query " << i;
      EXPECT_EQ(a[i].second_distance, b[i].second_distance) << "query " << i;
    }
  }
};

TEST_F(Hamming, FindsTheTwoNearestAsOpenCvDoes)
{
  for (const cv::Size sizes : {cv::Size(500, 500), cv::Size(37, 1001), cv::Size(1, 2)})
  {
    const cv::Mat queries = someDescriptors(sizes.width, 1);
    const cv::Mat trains = someDescriptors(sizes.height, 2);
    const Matches ours = match(queries, trains, {sizes.width, sizes.height});
    std::vector<std::vector<cv::DMatch>> theirs;
    cv::BFMatcher(cv::NORM_HAMMING).knnMatch(queries, trains, theirs, 2);
    for (int i = 0; i < sizes.width; ++i)
    {
      ASSERT_EQ(ours[i].best, theirs[i][0].trainIdx) << "query " << i;
      ASSERT_EQ(ours[i].second, theirs[i][1].trainIdx) << "query " << i;
      ASSERT_EQ(ours[i].best_distance, static_cast<int>(theirs[i][0].distance));
      ASSERT_EQ(ours[i].second_distance, static_cast<int>(theirs[i][1].distance));
    }
  }
}

TEST_F(Hamming, TiesGoToTheLowestIndex)
{
  const cv::Mat same(9, HAMMING_BYTES, CV_8U, cv::Scalar(0x5A));
  for (const HammingMatch& found : match(same, same, {9, 9}))
  {
    EXPECT_EQ(found.best, 0);
    EXPECT_EQ(found.second, 1);
    EXPECT_EQ(found.second_distance, 0);
  }
}

TEST_F(Hamming, CountsUpTo256Bits)
{
  const cv::Mat zeros(1, HAMMING_BYTES, CV_8U, cv::Scalar(0));
  const cv::Mat ones(1, HAMMING_BYTES, CV_8U, cv::Scalar(255));
  EXPECT_EQ(match(zeros, ones, {1, 1})[0].best_distance, 256);
}

TEST_F(Hamming, SaysSoIfThereIsNobody)
{
  const cv::Mat queries = someDescriptors(3, 1);
  const HammingMatch none = match(queries, cv::Mat(), {3, 0})[2];
  EXPECT_EQ(none.best, HAMMING_NOBODY);
  EXPECT_EQ(none.best_distance, HAMMING_FAR);
  const HammingMatch one = match(queries, queries.row(1), {3, 1})[1];
  EXPECT_EQ(one.best, 0);
  EXPECT_EQ(one.second, HAMMING_NOBODY);
  EXPECT_EQ(one.second_distance, HAMMING_FAR);
}

TEST_F(Hamming, InSlicesEqualsTheWhole)
{
  const cv::Mat queries = someDescriptors(101, 1);
  const cv::Mat trains = someDescriptors(77, 2);
  const auto fresh = [&] { return argumentsFor(queries, trains, {101, 77}); };
  const std::vector<Argument> whole = fresh();
  const std::vector<Argument> native = fresh();
  const std::vector<Argument> opencl = fresh();
  CodeletRunner::shared().native(hammingCodelet(), whole, 101);
  CodeletRunner::shared().nativeSliced(hammingCodelet(), native, 101, 9);
  CodeletRunner::shared().openclSliced(hammingCodelet(), opencl, 101, 30);
  expectEqual(result(whole, 101), result(native, 101));
  expectEqual(result(whole, 101), result(opencl, 101));
}

TEST_F(Hamming, RefusesBuffersThatAreTooSmall)
{
  const cv::Mat descriptors = someDescriptors(20, 1);
  for (size_t index = 0; index < 3; ++index)
  {
    std::vector<Argument> arguments = argumentsFor(descriptors, descriptors, {20, 20});
    arguments[index] = Argument::out(Buffer::allocate(arguments[index].buffer()->bytes() - 1));
    EXPECT_THROW(CodeletRunner::shared().native(hammingCodelet(), arguments, 20), std::runtime_error)
        << "argument " << index;
    EXPECT_THROW(CodeletRunner::shared().opencl(hammingCodelet(), arguments, 20), std::runtime_error)
        << "argument " << index;
  }
}

}  // namespace
}  // namespace pi_runtime::kernels
