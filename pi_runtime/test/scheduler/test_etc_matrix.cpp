#include <pi_runtime/etc_matrix.h>

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>

#include "scheduler/inter_core_problem.h"

namespace pi_runtime
{
namespace
{

EtcMatrix parse(const std::string& text)
{
  std::istringstream stream(text);
  return readEtcCsv(stream);
}

template <typename Exception, typename Function>
std::string messageOf(Function function)
{
  try
  {
    function();
  }
  catch (const Exception& error)
  {
    return error.what();
  }
  ADD_FAILURE() << "nothing was thrown";
  return "";
}

TEST(EtcMatrix, StartsWithNothingFeasible)
{
  const EtcMatrix matrix(2, 3);
  EXPECT_EQ(2U, matrix.tasks());
  EXPECT_EQ(3U, matrix.units());
  EXPECT_EQ(INF, matrix.at(1, 2));
  EXPECT_NO_THROW(matrix.validate());
}

TEST(EtcMatrix, StoresRowsOneAfterTheOther)
{
  EtcMatrix matrix(2, 3, {1, 2, 3, 4, 5, 6});
  EXPECT_EQ(3.0, matrix.at(0, 2));
  EXPECT_EQ(4.0, matrix.at(1, 0));
  EXPECT_EQ(5.0, matrix.row(1)[1]);
  matrix.at(1, 1) = 9.0;
  EXPECT_EQ(9.0, matrix.row(1)[1]);
}

TEST(EtcMatrix, RefusesAnotherNumberOfValues)
{
  EXPECT_EQ("ETC matrix: 3 values for 2 tasks x 2 units, expected 4", messageOf<std::invalid_argument>(
                                                                          [] {
                                                                            EtcMatrix(2, 2, {1, 2, 3});
                                                                          }));
}

TEST(EtcMatrix, ValidateNamesTaskUnitAndValue)
{
  EtcMatrix matrix(3, 2, {1, 2, 3, 4, 5, 6});
  for (const auto& [value, text] : {std::pair(-2.5, "-2.5"), std::pair(0.0, "0"), std::pair(std::nan(""), "nan")})
  {
    matrix.at(2, 1) = value;
    EXPECT_EQ(std::string("ETC matrix: task 2 on unit 1 = ") + text + ", must be > 0 (inf: the task cannot run there)",
              messageOf<std::invalid_argument>([&matrix] { matrix.validate(); }));
  }
}

TEST(EtcMatrix, ReadsCsvWithHeaderCommentsBlankLinesAndInfinity)
{
  const EtcMatrix matrix = parse("cpu,gpu\r\n# measured\n\n 1.5 , inf\r\n2e-3,4\n");
  ASSERT_EQ(2U, matrix.tasks());
  ASSERT_EQ(2U, matrix.units());
  EXPECT_EQ(1.5, matrix.at(0, 0));
  EXPECT_EQ(INF, matrix.at(0, 1));
  EXPECT_EQ(0.002, matrix.at(1, 0));
  EXPECT_EQ(4.0, matrix.at(1, 1));
}

TEST(EtcMatrix, ReadsASingleColumnAndALastLineWithoutEnd)
{
  const EtcMatrix matrix = parse("1\n2\n3");
  EXPECT_EQ(3U, matrix.tasks());
  EXPECT_EQ(1U, matrix.units());
  EXPECT_EQ(3.0, matrix.at(2, 0));
}

TEST(EtcMatrix, ReadsNothingFromEmptyText)
{
  EXPECT_EQ(0U, parse("").tasks());
  EXPECT_EQ(0U, parse("# only a comment\n\n").tasks());
  EXPECT_EQ(0U, parse("cpu,gpu\n").tasks());
}

TEST(EtcMatrix, RefusesRaggedLinesByNumber)
{
  EXPECT_EQ("line 3 \"3,4,5\": expected 2 fields as before, found 3",
            messageOf<std::runtime_error>([] { parse("# two units\n1,2\n3,4,5\n"); }));
  EXPECT_EQ("line 2 \"3\": expected 2 fields as before, found 1",
            messageOf<std::runtime_error>([] { parse("1,2\n3\n"); }));
}

TEST(EtcMatrix, RefusesGarbageByLineAndText)
{
  EXPECT_EQ("line 2 \"3,4x\": expected numbers or inf separated by commas, not \"4x\"",
            messageOf<std::runtime_error>([] { parse("1,2\n3,4x\n"); }));
  EXPECT_EQ("line 2 \"3,\": expected numbers or inf separated by commas, not \"\"",
            messageOf<std::runtime_error>([] { parse("1,2\n3,\n"); }));
  EXPECT_EQ("line 2 \"a,b\": expected numbers or inf separated by commas",
            messageOf<std::runtime_error>([] { parse("1,2\na,b\n"); }));
  EXPECT_EQ("line 2 \"c,d\": expected numbers or inf separated by commas",
            messageOf<std::runtime_error>([] { parse("a,b\nc,d\n"); }));
}

TEST(EtcMatrix, ReadsFilesAndNamesThemInErrors)
{
  const std::string path = ::testing::TempDir() + "/test_etc_matrix.csv";
  std::ofstream(path) << "1,2\n3,4\n";
  EXPECT_EQ(4.0, readEtcCsv(path).at(1, 1));
  std::ofstream(path) << "1,2\n3\n";
  EXPECT_EQ(path + ": line 2 \"3\": expected 2 fields as before, found 1",
            messageOf<std::runtime_error>([&path] { readEtcCsv(path); }));
  std::remove(path.c_str());
  EXPECT_EQ(path + ": No such file or directory", messageOf<std::runtime_error>([&path] { readEtcCsv(path); }));
}

}  // namespace
}  // namespace pi_runtime
