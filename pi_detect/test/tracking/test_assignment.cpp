#include <gtest/gtest.h>
#include "tracking/assignment.h"

#include <algorithm>
#include <limits>
#include <numeric>
#include <random>
#include <set>
#include <stdexcept>

namespace
{

using pi_detect::assign;

constexpr double FORBIDDEN = 10.0;

/// Sum of costs; fails if a column is used twice or a pair is not allowed.
double sumOf(const Eigen::MatrixXd& cost, double forbidden, const std::vector<int>& columns)
{
  EXPECT_EQ(columns.size(), static_cast<size_t>(cost.rows()));
  double sum = 0.0;
  std::set<int> used;
  for (size_t row = 0; row < columns.size(); ++row)
  {
    if (columns[row] < 0)
    {
      sum += forbidden;
      continue;
    }
    EXPECT_TRUE(used.insert(columns[row]).second) << "column " << columns[row] << " twice";
    const double value = cost(static_cast<Eigen::Index>(row), columns[row]);
    EXPECT_LT(value, forbidden);
    sum += value;
  }
  return sum;
}

/// The least sum, by trying everything.
double leastSum(const Eigen::MatrixXd& cost, double forbidden, Eigen::Index row = 0, unsigned used = 0)
{
  if (row == cost.rows())
  {
    return 0.0;
  }
  double least = forbidden + leastSum(cost, forbidden, row + 1, used);
  for (Eigen::Index column = 0; column < cost.cols(); ++column)
  {
    if ((used & (1U << column)) == 0 && cost(row, column) < forbidden)
    {
      least = std::min(least, cost(row, column) + leastSum(cost, forbidden, row + 1, used | (1U << column)));
    }
  }
  return least;
}

TEST(Assignment, TakesTheLeastSumNotTheLeastPair)
{
  Eigen::MatrixXd cost(2, 2);
  cost << 1.0, 2.0,  //
      2.0, 9.0;
  EXPECT_EQ(assign(cost, FORBIDDEN), (std::vector<int>{1, 0}));
}

TEST(Assignment, LeavesARowWithoutColumnWhenThatCostsLess)
{
  Eigen::MatrixXd cost(2, 1);
  cost << 9.0,  //
      3.0;
  EXPECT_EQ(assign(cost, FORBIDDEN), (std::vector<int>{-1, 0}));

  // Both rows assigned cost 9.5 + 9.5, one alone 0 + 10.
  Eigen::MatrixXd detour(2, 2);
  detour << 0.0, 9.5,  //
      9.5, 20.0;
  EXPECT_EQ(assign(detour, FORBIDDEN), (std::vector<int>{0, -1}));
}

TEST(Assignment, NeverUsesForbiddenPairs)
{
  Eigen::MatrixXd cost(3, 3);
  cost << 10.0, std::numeric_limits<double>::infinity(), 11.0,  //
      std::numeric_limits<double>::quiet_NaN(), 9.9, 12.0,      //
      1e9, -std::numeric_limits<double>::infinity(), 10.0;
  EXPECT_EQ(assign(cost, FORBIDDEN), (std::vector<int>{-1, 1, -1}));
}

TEST(Assignment, WorksWithoutRowsOrColumns)
{
  EXPECT_TRUE(assign(Eigen::MatrixXd(0, 0), FORBIDDEN).empty());
  EXPECT_TRUE(assign(Eigen::MatrixXd(0, 4), FORBIDDEN).empty());
  EXPECT_EQ(assign(Eigen::MatrixXd(3, 0), FORBIDDEN), (std::vector<int>{-1, -1, -1}));
}

TEST(Assignment, RefusesAForbiddenCostThatIsNotFinite)
{
  const Eigen::MatrixXd cost = Eigen::MatrixXd::Ones(1, 1);
  EXPECT_THROW(assign(cost, std::numeric_limits<double>::infinity()), std::invalid_argument);
  EXPECT_THROW(assign(cost, std::numeric_limits<double>::quiet_NaN()), std::invalid_argument);
}

TEST(Assignment, FindsTheLeastSumOfRandomMatrices)
{
  std::mt19937 random(1);
  std::uniform_int_distribution<int> size(0, 6);
  std::uniform_real_distribution<double> value(-10.0, 20.0);
  for (int i = 0; i < 2000; ++i)
  {
    Eigen::MatrixXd cost(size(random), size(random));
    // Half of the matrices in whole numbers: many ties.
    std::generate(cost.data(), cost.data() + cost.size(),
                  [&] { return i % 2 == 0 ? value(random) : std::floor(value(random) / 4.0); });
    const double forbidden = i % 3 == 0 ? 3.0 : FORBIDDEN;
    ASSERT_NEAR(sumOf(cost, forbidden, assign(cost, forbidden)), leastSum(cost, forbidden), 1e-9) << cost;
  }
}

TEST(Assignment, FindsAHiddenPermutationInALargeMatrix)
{
  constexpr int SIZE = 400;
  std::mt19937 random(2);
  std::uniform_real_distribution<double> value(1.0, 9.0);
  Eigen::MatrixXd cost(SIZE, SIZE);
  std::generate(cost.data(), cost.data() + cost.size(), [&] { return value(random); });
  std::vector<int> hidden(SIZE);
  std::iota(hidden.begin(), hidden.end(), 0);
  std::shuffle(hidden.begin(), hidden.end(), random);
  for (int row = 0; row < SIZE; ++row)
  {
    cost(row, hidden[static_cast<size_t>(row)]) = 0.5;
  }
  EXPECT_EQ(assign(cost, FORBIDDEN), hidden);
}

TEST(Assignment, IsBoundedWhenThousandsCompeteInSmallGroups)
{
  // Rows and columns along a line, each pair within 2 allowed: every row has its column at no cost.
  constexpr int SIZE = 3000;
  Eigen::MatrixXd cost = Eigen::MatrixXd::Constant(SIZE, SIZE, 2.0 * FORBIDDEN);
  std::vector<int> expected(SIZE);
  for (int row = 0; row < SIZE; ++row)
  {
    for (int column = std::max(0, row - 2); column <= std::min(SIZE - 1, row + 2); ++column)
    {
      cost(row, column) = std::abs(row - column);
    }
    expected[static_cast<size_t>(row)] = row;
  }
  EXPECT_EQ(assign(cost, FORBIDDEN), expected);
}

}  // namespace
