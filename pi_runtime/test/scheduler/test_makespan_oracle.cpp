#include "makespan_oracle.h"

#include <glpk.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <utility>
#include <vector>

#include "scheduler/inter_core_problem.h"

namespace pi_runtime_bench
{
namespace
{

using pi_runtime::EtcMatrix;
using pi_runtime::INF;

constexpr uint64_t MANY_NODES = 1000000;

EtcMatrix randomEtc(size_t tasks, size_t units, bool whole, double share_of_infinity, std::mt19937_64* random)
{
  EtcMatrix etc(tasks, units);
  std::uniform_real_distribution<double> time(1.0, 31.0);
  std::bernoulli_distribution infinite(share_of_infinity);
  for (size_t i = 0; i < tasks; ++i)
  {
    for (size_t j = 0; j < units; ++j)
    {
      const double value = time(*random);
      etc.at(i, j) = j != i % units && infinite(*random) ? INF : whole ? std::floor(value) : value;
    }
  }
  return etc;
}

double makespanOf(const EtcMatrix& etc, const std::vector<uint32_t>& unit)
{
  std::vector<double> load(etc.units(), 0.0);
  for (size_t i = 0; i < unit.size(); ++i)
  {
    load[unit[i]] += etc.at(i, unit[i]);
  }
  return *std::max_element(load.begin(), load.end());
}

double smallestByEnumeration(const EtcMatrix& etc)
{
  std::vector<uint32_t> unit(etc.tasks(), 0);
  double smallest = INF;
  while (true)
  {
    smallest = std::min(smallest, makespanOf(etc, unit));
    size_t i = 0;
    while (i < unit.size() && ++unit[i] == etc.units())
    {
      unit[i++] = 0;
    }
    if (i == unit.size())
    {
      return smallest;
    }
  }
}

/// The textbook integer program, minimise C with sum_j x_ij = 1 and sum_i time_ij x_ij <= C, solved by GLPK.
double smallestByIntegerProgram(const EtcMatrix& etc)
{
  const auto tasks = static_cast<int>(etc.tasks());
  const auto units = static_cast<int>(etc.units());
  glp_prob* program = glp_create_prob();
  glp_add_rows(program, tasks + units);
  glp_add_cols(program, tasks * units + 1);
  const int makespan = tasks * units + 1;
  glp_set_obj_coef(program, makespan, 1.0);
  glp_set_col_bnds(program, makespan, GLP_LO, 0.0, 0.0);
  std::vector<int> rows{0};
  std::vector<int> columns{0};
  std::vector<double> values{0.0};
  const auto add = [&](int row, int column, double value)
  {
    rows.push_back(row);
    columns.push_back(column);
    values.push_back(value);
  };
  for (int j = 0; j < units; ++j)
  {
    glp_set_row_bnds(program, tasks + j + 1, GLP_UP, 0.0, 0.0);
    add(tasks + j + 1, makespan, -1.0);
  }
  for (int i = 0; i < tasks; ++i)
  {
    glp_set_row_bnds(program, i + 1, GLP_FX, 1.0, 1.0);
    for (int j = 0; j < units; ++j)
    {
      const int column = i * units + j + 1;
      glp_set_col_kind(program, column, GLP_BV);
      add(i + 1, column, 1.0);
      add(tasks + j + 1, column, etc.at(static_cast<size_t>(i), static_cast<size_t>(j)));
    }
  }
  glp_load_matrix(program, static_cast<int>(values.size()) - 1, rows.data(), columns.data(), values.data());
  glp_iocp parameters;
  glp_init_iocp(&parameters);
  parameters.presolve = GLP_ON;
  parameters.msg_lev = GLP_MSG_OFF;
  const int failure = glp_intopt(program, &parameters);
  const double result = failure == 0 && glp_mip_status(program) == GLP_OPT ? glp_mip_obj_val(program) : -1.0;
  glp_delete_prob(program);
  return result;
}

TEST(MakespanOracle, EqualsEnumerationOnSmallProblems)
{
  std::mt19937_64 random(21);
  MakespanOracle oracle;
  for (int round = 0; round < 200; ++round)
  {
    const size_t units = 1 + random() % 4;
    const size_t tasks = 1 + random() % 7;
    const EtcMatrix etc = randomEtc(tasks, units, round % 2 == 0, round % 3 == 0 ? 0.4 : 0.0, &random);
    const OracleResult result = oracle.solve(etc, {}, MANY_NODES);
    ASSERT_TRUE(result.proven);
    ASSERT_NEAR(smallestByEnumeration(etc), result.makespan, 1e-7) << "round " << round;
    ASSERT_EQ(makespanOf(etc, result.unit), result.makespan) << "the mapping belongs to the makespan";
  }
}

TEST(MakespanOracle, EqualsAnIntegerProgramSolver)
{
  std::mt19937_64 random(22);
  MakespanOracle oracle;
  for (const auto& [tasks, units] : {std::pair<size_t, size_t>(10, 3), {20, 3}, {30, 3}, {10, 4}, {12, 5}, {10, 6}})
  {
    for (bool whole : {true, false})
    {
      const EtcMatrix etc = randomEtc(tasks, units, whole, 0.0, &random);
      const OracleResult result = oracle.solve(etc, {}, MANY_NODES);
      ASSERT_TRUE(result.proven);
      EXPECT_NEAR(smallestByIntegerProgram(etc), result.makespan, 1e-5) << tasks << " x " << units;
    }
  }
}

TEST(MakespanOracle, DoesNotDependOnTheStart)
{
  std::mt19937_64 random(23);
  MakespanOracle oracle;
  for (int round = 0; round < 10; ++round)
  {
    const EtcMatrix etc = randomEtc(30, 4, true, 0.1, &random);
    const OracleResult cold = oracle.solve(etc, {}, MANY_NODES);
    const OracleResult warm = oracle.solve(etc, cold.unit, MANY_NODES);
    EXPECT_TRUE(cold.proven && warm.proven);
    EXPECT_EQ(cold.makespan, warm.makespan);
  }
}

TEST(MakespanOracle, SaysWhenItGivesUp)
{
  std::mt19937_64 random(24);
  const EtcMatrix etc = randomEtc(50, 6, false, 0.0, &random);
  MakespanOracle oracle;
  const OracleResult result = oracle.solve(etc, {}, 3);
  EXPECT_FALSE(result.proven);
  EXPECT_EQ(makespanOf(etc, result.unit), result.makespan);
  EXPECT_LE(oracle.solve(etc, {}, MANY_NODES).makespan, result.makespan);
}

}  // namespace
}  // namespace pi_runtime_bench
