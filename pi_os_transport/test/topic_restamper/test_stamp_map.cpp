#include "topic_restamper/stamp_map.h"

#include <gtest/gtest.h>

using pi_os_transport::StampMap;

namespace
{

constexpr int64_t MS = 1000000;
constexpr int64_t RECORDED = 1403636579763555584LL;  // more than 2^53: a double would round
constexpr int64_t NOW = 1795503316908676678LL;

}  // namespace

TEST(StampMap, MovesTheFirstStampToNow)
{
  StampMap stamps(false);
  EXPECT_EQ(NOW, stamps.stampOf(RECORDED, NOW));
}

TEST(StampMap, KeepsRecordedDistancesToTheNanosecond)
{
  StampMap stamps(false);
  stamps.stampOf(RECORDED, NOW);
  EXPECT_EQ(NOW + 5 * MS, stamps.stampOf(RECORDED + 5 * MS, NOW + 900 * MS));
  EXPECT_EQ(NOW + 10000000000000001LL, stamps.stampOf(RECORDED + 10000000000000001LL, NOW + 7));
}

TEST(StampMap, KeepsTheDistanceOfWhatComesAgainstTheOrder)
{
  StampMap stamps(false);
  stamps.stampOf(RECORDED, NOW);
  stamps.stampOf(RECORDED + 400 * MS, NOW + 400 * MS);
  EXPECT_EQ(NOW + 350 * MS, stamps.stampOf(RECORDED + 350 * MS, NOW + 401 * MS));
}

TEST(StampMap, MovesEachLapToNow)
{
  StampMap stamps(false);
  for (int64_t t = 0; t <= 1000; t += 5)
  {
    stamps.stampOf(RECORDED + t * MS, NOW + t * MS);
  }
  EXPECT_EQ(NOW + 1050 * MS, stamps.stampOf(RECORDED, NOW + 1050 * MS));
  EXPECT_EQ(NOW + 1055 * MS, stamps.stampOf(RECORDED + 5 * MS, NOW + 1060 * MS));
}

TEST(StampMap, GivesWhatIsLateFromTheLastLapItsOldDistance)
{
  StampMap stamps(false);
  for (int64_t t = 0; t <= 1000; t += 5)
  {
    stamps.stampOf(RECORDED + t * MS, NOW + t * MS);
  }
  stamps.stampOf(RECORDED, NOW + 1060 * MS);
  EXPECT_EQ(NOW + 995 * MS, stamps.stampOf(RECORDED + 995 * MS, NOW + 1061 * MS));
  EXPECT_EQ(NOW + 1065 * MS, stamps.stampOf(RECORDED + 5 * MS, NOW + 1065 * MS));
}

TEST(StampMap, StampsAtHandoverWhatWasRecordedTogetherOnce)
{
  StampMap stamps(true);
  EXPECT_EQ(NOW, stamps.stampOf(RECORDED, NOW));
  EXPECT_EQ(NOW + 9 * MS, stamps.stampOf(RECORDED + 5 * MS, NOW + 9 * MS));
  EXPECT_EQ(NOW, stamps.stampOf(RECORDED, NOW + 11 * MS));
}

TEST(StampMap, ForgetsHandoversOfLongAgo)
{
  StampMap stamps(true);
  for (int64_t i = 0; i <= static_cast<int64_t>(StampMap::REMEMBERED); ++i)
  {
    stamps.stampOf(RECORDED + i, NOW + i);
  }
  EXPECT_EQ(NOW + 1, stamps.stampOf(RECORDED + 1, NOW + MS));
  EXPECT_EQ(NOW + 2 * MS, stamps.stampOf(RECORDED, NOW + 2 * MS));
}

TEST(StampMap, CountsDelaysAndTakesEarlyAsPunctual)
{
  StampMap stamps(false);
  stamps.stampOf(RECORDED, NOW);
  EXPECT_EQ(0, stamps.latenessNs());
  stamps.stampOf(RECORDED + 5 * MS, NOW + 8 * MS);
  EXPECT_EQ(3 * MS, stamps.latenessNs());
  stamps.stampOf(RECORDED + 10 * MS, NOW + 9 * MS);
  EXPECT_EQ(0, stamps.latenessNs());
}
