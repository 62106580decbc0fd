#include <gtest/gtest.h>

#include <random>

#include "map/place_index.h"

namespace
{

using namespace pi_slam::map;

FeatureSetPtr makeFeatures(uint64_t seed, size_t count = 200)
{
  auto set = std::make_shared<FeatureSet>();
  std::mt19937_64 random(seed);
  set->features.resize(count);
  set->descriptors.resize(count * DESCRIPTOR_BYTES);
  for (uint8_t& byte : set->descriptors)
  {
    byte = static_cast<uint8_t>(random());
  }
  return set;
}

/// The same features with every bit turned over with some probability.
FeatureSet disturbed(const FeatureSet& set, double probability, uint64_t seed)
{
  FeatureSet result = set;
  std::mt19937_64 random(seed);
  std::bernoulli_distribution flip(probability);
  for (uint8_t& byte : result.descriptors)
  {
    for (int bit = 0; bit < 8; ++bit)
    {
      byte = static_cast<uint8_t>(byte ^ (flip(random) ? 1 << bit : 0));
    }
  }
  return result;
}

TEST(PlaceIndex, FindsThePlaceAmongManyThoughDescriptorsAreDisturbed)
{
  PlaceIndex index;
  std::vector<FeatureSetPtr> places;
  for (uint32_t i = 0; i < 200; ++i)
  {
    places.push_back(makeFeatures(i + 1));
    index.add(i, places.back());
  }
  for (const uint32_t i : {0U, 17U, 199U})
  {
    // One bit in ten: as between pictures some metres apart.
    const auto votes = index.query(disturbed(*places[i], 0.1, 5));
    ASSERT_FALSE(votes.empty());
    EXPECT_EQ(i, votes.front().keyframe);
    // Random descriptors of 256 bits are never within 56 bits of each other.
    EXPECT_EQ(1u, votes.size());
    EXPECT_GT(votes.front().weight, 100.0F);
  }
}

TEST(PlaceIndex, CountsWhatIsSeenEverywhereLittle)
{
  PlaceIndex index;
  const FeatureSetPtr everywhere = makeFeatures(1, 100);
  for (uint32_t i = 0; i < 16; ++i)
  {
    index.add(i, everywhere);
  }
  const FeatureSetPtr rare = makeFeatures(2, 100);
  index.add(16, rare);
  FeatureSet both = *everywhere;
  both.features.insert(both.features.end(), rare->features.begin(), rare->features.end());
  both.descriptors.insert(both.descriptors.end(), rare->descriptors.begin(), rare->descriptors.end());
  const auto votes = index.query(both);
  ASSERT_EQ(17u, votes.size());
  EXPECT_EQ(16u, votes[0].keyframe);
  EXPECT_NEAR(4.0F, votes[0].weight / votes[1].weight, 1e-3F);  // root of 16 places
}

TEST(PlaceIndex, ForgetsWhatIsRemoved)
{
  PlaceIndex index;
  const size_t empty = index.bytes();
  const FeatureSetPtr a = makeFeatures(1);
  index.add(3, a);
  EXPECT_GT(index.bytes(), empty);
  index.add(4, makeFeatures(2));
  index.remove(3);
  EXPECT_TRUE(index.query(*a).empty());
  index.remove(3);  // not there: nothing to do
  index.add(3, makeFeatures(7));
  EXPECT_TRUE(index.query(*a).empty());
  index.add(9, a);
  EXPECT_EQ(9u, index.query(*a).front().keyframe);
  index.clear();
  EXPECT_TRUE(index.query(*a).empty());
  EXPECT_EQ(empty, index.bytes());
}

TEST(PlaceIndex, AnswersAnEmptyPictureOrAnEmptyMapWithNothing)
{
  PlaceIndex index;
  EXPECT_TRUE(index.query(*makeFeatures(1)).empty());
  index.add(0, makeFeatures(1));
  EXPECT_TRUE(index.query(FeatureSet()).empty());
}

TEST(PlaceIndex, IgnoresBucketsThatTellNothing)
{
  PlaceIndex index;
  auto same = std::make_shared<FeatureSet>();
  same->features.resize(500);
  same->descriptors.assign(500 * DESCRIPTOR_BYTES, 0);  // one wall without texture
  index.add(0, same);
  FeatureSet query;
  query.features.resize(1);
  query.descriptors.assign(DESCRIPTOR_BYTES, 0);
  EXPECT_TRUE(index.query(query).empty());
}

}  // namespace
