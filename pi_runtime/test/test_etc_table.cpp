#include <pi_runtime/etc_table.h>

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <random>
#include <sstream>

#include "fake_executor.h"

namespace pi_runtime
{
namespace
{

const char* const HEADER = "codelet,bucket,column,count,mean_s,deviation_s\n";

EtcTable::Entry entry(const std::string& codelet, int bucket, const std::string& column, double mean_s,
                      uint64_t count = 3)
{
  EtcTable::Cell cell;
  cell.count = count;
  cell.mean_s = mean_s;
  return {codelet, bucket, column, cell};
}

TEST(EtcTable, BucketsAreQuarterOctaves)
{
  EXPECT_EQ(0, EtcTable::sizeBucket(1.0));
  EXPECT_EQ(4, EtcTable::sizeBucket(2.0));
  EXPECT_EQ(4, EtcTable::sizeBucket(2.0 * 1.08));
  EXPECT_EQ(5, EtcTable::sizeBucket(2.0 * 1.2));
  EXPECT_EQ(-4, EtcTable::sizeBucket(0.5));
  EXPECT_EQ(0, EtcTable::sizeBucket(0.0));
  EXPECT_EQ(0, EtcTable::sizeBucket(-3.0));
  EXPECT_EQ(0, EtcTable::sizeBucket(std::nan("")));
  EXPECT_EQ(0, EtcTable::sizeBucket(INFINITY));
}

TEST(EtcTable, KnowsNothingAtFirst)
{
  EtcTable table;
  const EtcTable::Column column = table.column("cpu0/native");
  EXPECT_EQ(column, table.column("cpu0/native"));
  EXPECT_EQ(nullptr, table.find("blur"));
  const EtcTable::Estimate estimate = table.row("blur").predict(0, column);
  EXPECT_FALSE(estimate.known);
  EXPECT_FALSE(estimate.measured);
  EXPECT_EQ(0.0, estimate.seconds);
  EXPECT_NE(nullptr, table.find("blur"));
}

TEST(EtcTable, MeanAndDeviationConverge)
{
  EtcTable table;
  const EtcTable::Column column = table.column("cpu0/native");
  EtcTable::Row& row = table.row("blur");
  std::mt19937 random(3);
  std::normal_distribution<double> time(5e-3, 1e-3);
  for (int i = 0; i < 60; ++i)
  {
    table.record(row, 0, column, time(random));
  }
  EXPECT_NEAR(5e-3, row.predict(0, column).seconds, 4e-4) << "3 standard errors of 60 samples";
  EXPECT_NEAR(1e-3, row.predict(0, column).deviation_s, 3e-4);
  EXPECT_EQ(60u, row.samples(column));
}

TEST(EtcTable, FewSamplesGiveThePlainMeanAndVariance)
{
  EtcTable table;
  const EtcTable::Column column = table.column("c");
  EtcTable::Row& row = table.row("x");
  for (const double seconds : {1.0, 2.0, 6.0})
  {
    table.record(row, 0, column, seconds);
  }
  EXPECT_NEAR(3.0, row.predict(0, column).seconds, 1e-12);
  EXPECT_NEAR(std::sqrt(14.0 / 3.0), row.predict(0, column).deviation_s, 1e-12);
}

TEST(EtcTable, FollowsAUnitThatSlowsDown)
{
  EtcTable table;
  const EtcTable::Column column = table.column("c");
  EtcTable::Row& row = table.row("x");
  for (int i = 0; i < 10000; ++i)
  {
    table.record(row, 0, column, 1.0);
  }
  for (int i = 0; i < 200; ++i)
  {
    table.record(row, 0, column, 2.0);
  }
  EXPECT_NEAR(2.0, row.predict(0, column).seconds, 0.05);
}

TEST(EtcTable, OtherSizesArePredictedInProportionFromTheNearest)
{
  EtcTable table;
  const EtcTable::Column column = table.column("c");
  table.set(entry("x", 0, "c", 1.0));
  table.set(entry("x", 8, "c", 5.0));
  const EtcTable::Row& row = *table.find("x");
  EXPECT_NEAR(2.0, row.predict(4, column).seconds, 1e-12) << "equally near: the smaller";
  EXPECT_NEAR(5.0 * std::exp2(-0.25), row.predict(7, column).seconds, 1e-12);
  EXPECT_NEAR(10.0, row.predict(12, column).seconds, 1e-12);
  EXPECT_NEAR(0.5, row.predict(-4, column).seconds, 1e-12);
  EXPECT_TRUE(row.predict(12, column).measured);
}

TEST(EtcTable, OtherColumnsStandInForAnUnknownOne)
{
  EtcTable table;
  table.set(entry("x", 0, "a", 1.0));
  table.set(entry("x", 0, "b", 3.0));
  const EtcTable::Estimate estimate = table.find("x")->predict(0, table.column("new"));
  EXPECT_NEAR(2.0, estimate.seconds, 1e-12);
  EXPECT_TRUE(estimate.known);
  EXPECT_FALSE(estimate.measured);
}

TEST(EtcTable, PredictionsStayFiniteAndAboveZero)
{
  EtcTable table;
  const EtcTable::Column column = table.column("c");
  table.set(entry("x", -4400, "c", 1e9));
  EXPECT_EQ(1e9, table.find("x")->predict(EtcTable::sizeBucket(1e300), column).seconds);
  EXPECT_EQ(0.0, table.find("x")->predict(EtcTable::sizeBucket(1e300), column).deviation_s);
  table.set(entry("y", 4400, "c", 1e-9));
  EXPECT_EQ(1e-9, table.find("y")->predict(EtcTable::sizeBucket(1e-300), column).seconds);
}

TEST(EtcTable, ImpossibleEntriesAreRefused)
{
  EtcTable table;
  for (const EtcTable::Entry& wrong :
       {entry("", 0, "c", 1.0), entry("x", 0, "", 1.0), entry("x,y", 0, "c", 1.0), entry("x", 0, "a b", 1.0),
        entry("x", 0, "c", 0.0), entry("x", 0, "c", -1.0), entry("x", 0, "c", INFINITY), entry("x", 0, "c", 1e10),
        entry("x", 0, "c", std::nan("")), entry("x", 0, "c", 1.0, 0), entry("x", 0, "c", 1.0, UINT64_MAX),
        entry("x", INT32_MAX, "c", 1.0), entry("x", INT32_MIN, "c", 1.0)})
  {
    EXPECT_THROW(table.set(wrong), std::invalid_argument) << wrong.codelet << " " << wrong.column;
  }
  EtcTable::Entry wrong = entry("x", 0, "c", 1.0);
  wrong.cell.variance_s2 = -1.0;
  EXPECT_THROW(table.set(wrong), std::invalid_argument);
  EXPECT_TRUE(table.entries().empty());
}

TEST(EtcTable, WhatIsSavedIsLoadedAgain)
{
  EtcTable table;
  const EtcTable::Column column = table.column("cpu0/opencl");
  std::mt19937 random(5);
  for (int i = 0; i < 500; ++i)
  {
    const double seconds = 1e-6 * static_cast<double>(1 + random() % 100000);
    table.record(table.row("c" + std::to_string(random() % 5)), static_cast<int>(random() % 9), column, seconds);
  }
  std::stringstream file;
  table.save(file);
  EtcTable copy;
  copy.column("another/native");  // columns need not have the same numbers
  copy.load(file);
  const std::vector<EtcTable::Entry> before = table.entries();
  const std::vector<EtcTable::Entry> after = copy.entries();
  ASSERT_EQ(before.size(), after.size());
  for (size_t i = 0; i < before.size(); ++i)
  {
    EXPECT_EQ(before[i].codelet, after[i].codelet);
    EXPECT_EQ(before[i].bucket, after[i].bucket);
    EXPECT_EQ(before[i].column, after[i].column);
    EXPECT_EQ(before[i].cell.count, after[i].cell.count);
    EXPECT_NEAR(before[i].cell.mean_s, after[i].cell.mean_s, 1e-8 * before[i].cell.mean_s);
    EXPECT_NEAR(before[i].cell.deviation_s(), after[i].cell.deviation_s(), 1e-8 * before[i].cell.mean_s);
  }
}

TEST(EtcTable, ADamagedFileNamesTheLineAndChangesNothing)
{
  for (const std::string line :
       {"x,0,c,3,1e-3", "x,0,c,3,1e-3,0,7", "x,zero,c,3,1e-3,0", "x,0,c,3,1e-3ms,0", "x,0,c,-1,1e-3,0", "x,0,c,3,nan,0",
        "x,0,c,3,0,0", "x,99999999999,c,3,1e-3,0", "x,0,c,3,1e-999,0", "x,2147483647,c,3,1e-3,0"})
  {
    EtcTable table;
    table.set(entry("kept", 0, "c", 1.0));
    std::stringstream file(HEADER + std::string("y,0,c,3,1e-3,0\n") + line + "\n");
    try
    {
      table.load(file);
      FAIL() << line;
    }
    catch (const std::runtime_error& error)
    {
      EXPECT_NE(std::string::npos, std::string(error.what()).find("line 3")) << error.what();
    }
    EXPECT_EQ(1u, table.entries().size());
  }
  EtcTable table;
  std::stringstream other("some other file\n");
  EXPECT_THROW(table.load(other), std::runtime_error);
  EXPECT_THROW(table.load(std::string("/does/not/exist")), std::runtime_error);
  EXPECT_THROW(table.save(std::string("/does/not/exist")), std::runtime_error);
}

TEST(EtcTable, TellsHowGoodPredictionsAre)
{
  EtcTable table;
  EXPECT_EQ(0u, table.predictionError().count);
  table.recordPrediction(0.0, 1.0);  // none was made
  for (int i = 0; i < 10000; ++i)
  {
    table.recordPrediction(1.0 + (i % 100) * 0.01, 1.0);
  }
  EXPECT_EQ(10000u, table.predictionError().count);
  EXPECT_NEAR(0.50, table.predictionError().p50, 0.02);
  EXPECT_NEAR(0.95, table.predictionError().p95, 0.02);
}

class EtcLearning : public testing::Test
{
protected:
  EtcLearning()
  {
    char name[] = "/tmp/test_etc_table.XXXXXX";
    folder_ = mkdtemp(name);
    file_ = folder_ + "/etc.csv";
  }
  ~EtcLearning() override { std::filesystem::remove_all(folder_); }

  std::string folder_;
  std::string file_;
};

TEST_F(EtcLearning, TheFirstRunInAProcessIsNotCounted)
{
  FakeRuntime runtime(1);
  runtime.device(0).serveAll([](const FakeDevice::Start&) { return ExecutionReport(); });
  const CodeletPtr codelet = fakeCodelet("work");
  EXPECT_EQ(0.0, runtime->submit(requestOf(codelet)).wait().predicted_s);
  EXPECT_TRUE(runtime->etcEntries().empty());
  runtime->submit(requestOf(codelet)).wait();
  ASSERT_EQ(1u, runtime->etcEntries().size());
  EXPECT_EQ(1u, runtime->etcEntries()[0].cell.count);
  EXPECT_EQ("fake0/fake", runtime->etcEntries()[0].column);
  EXPECT_GT(runtime->submit(requestOf(codelet)).wait().predicted_s, 0.0);
  EXPECT_EQ(1u, runtime->statistics().prediction_error.count);
  runtime->clearEtc();
  EXPECT_TRUE(runtime->etcEntries().empty());
}

TEST_F(EtcLearning, FailedAndCancelledRunsAreNotCounted)
{
  FakeRuntime runtime(1);
  const CodeletPtr codelet = fakeCodelet("work");
  for (int i = 0; i < 2; ++i)
  {
    runtime->submit(requestOf(codelet));
    runtime.device(0).fail(Outcome::EXECUTION_FAILED, "no");
    const TaskHandle task = runtime->submit(requestOf(codelet));
    task.cancel();
    runtime.device(0).finish();
  }
  EXPECT_TRUE(runtime->etcEntries().empty());
}

TEST_F(EtcLearning, CalibrationRunsEveryUnitTheGivenNumberOfTimes)
{
  FakeRuntime runtime(3, nullptr, {nullptr, [](const Codelet&) { return false; }, nullptr});
  for (size_t unit = 0; unit < 3; ++unit)
  {
    runtime.device(unit).serveAll([](const FakeDevice::Start&) { return ExecutionReport(); });
  }
  const std::vector<TaskResult> results = runtime->calibrate(requestOf(fakeCodelet("work")), 4);
  ASSERT_EQ(2u, results.size());
  EXPECT_EQ("fake0", results[0].unit);
  EXPECT_EQ("fake2", results[1].unit);
  for (const EtcTable::Entry& entry : runtime->etcEntries())
  {
    EXPECT_EQ(4u, entry.cell.count);
  }
  EXPECT_EQ(5u, runtime.device(0).started());
  EXPECT_EQ(1u, runtime->calibrate(requestOf(fakeCodelet("work"), "fake2"), -3).size());
  EXPECT_TRUE(runtime->calibrate(TaskRequest()).empty());
}

TEST_F(EtcLearning, TheFileIsReadAtTheStartAndWrittenAtTheEnd)
{
  std::ofstream(file_) << HEADER << "work,0,fake0/fake,3,0.25,0\nwork,0,gpu9/opencl,5,0.5,0\n";
  const CodeletPtr codelet = fakeCodelet("work");
  {
    FakeRuntime runtime(1, [this](RuntimeOptions& options) { options.etc_file = file_; });
    EXPECT_EQ(0.25, runtime->predict(codelet, 1.0, "fake0")) << "before any task of it was seen";
    EXPECT_THROW(runtime->predict(codelet, 1.0, "gpu9"), std::invalid_argument);
    EXPECT_THROW(runtime->predict(nullptr, 1.0, "fake0"), std::invalid_argument);
    runtime.setTimes(codelet, {0.125});
  }
  EtcTable table;
  table.load(file_);
  ASSERT_EQ(2u, table.entries().size()) << "what is known of units that are not here is kept";
  EXPECT_EQ(0.125, table.find("work")->predict(0, table.column("fake0/fake")).seconds);
  EXPECT_EQ(0.5, table.find("work")->predict(0, table.column("gpu9/opencl")).seconds);
}

TEST_F(EtcLearning, ADamagedFileIsAWarningOnly)
{
  std::ofstream(file_) << HEADER << "work,0,fake0/fake,3,fast,0\n";
  FakeRuntime runtime(1, [this](RuntimeOptions& options) { options.etc_file = file_; });
  EXPECT_EQ(1u, runtime.logged("the runtime learns anew"));
  EXPECT_EQ(1u, runtime.logged(file_));
  runtime.device(0).serveAll([](const FakeDevice::Start&) { return ExecutionReport(); });
  EXPECT_TRUE(runtime->submit(requestOf(fakeCodelet("work"))).wait().ok());
}

}  // namespace
}  // namespace pi_runtime
