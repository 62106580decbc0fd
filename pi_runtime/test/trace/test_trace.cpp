#include <pi_runtime/trace.h>

#include <gtest/gtest.h>

#include <limits>
#include <sstream>
#include <thread>
#include <vector>

#include "trace/trace_reader.h"

namespace pi_runtime
{
namespace
{

TaskTrace makeRecord(uint64_t task)
{
  TaskTrace record;
  record.task = task;
  record.codelet = "detect";
  record.implementation = "detect.cl";
  record.unit = 1;
  record.slice = 2;
  record.slices = 4;
  record.submitted_ns = 1000;
  record.queued_ns = 2000;
  record.started_ns = 5'000'123;
  record.transfer_ns = 1'000'001;
  record.finished_ns = 9'000'456;
  record.deadline_ns = 9'000'455;
  record.outcome = TaskOutcome::FAILED;
  record.stolen = true;
  record.predicted_s = 0.1;
  return record;
}

std::string written(const std::vector<TaskTrace>& records, const std::vector<std::string>& units = {})
{
  std::ostringstream stream;
  writeChromeTrace(stream, records, units);
  return stream.str();
}

ChromeTrace readBack(const std::string& text)
{
  std::istringstream stream(text);
  return readChromeTrace(stream);
}

/// The events whose text contains all of `parts`; the writer puts each on a line.
std::vector<std::string> events(const std::string& text, const std::vector<std::string>& parts)
{
  std::vector<std::string> found;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);)
  {
    bool has_all = true;
    for (const std::string& part : parts)
    {
      has_all = has_all && line.find(part) != std::string::npos;
    }
    if (has_all)
    {
      found.push_back(line);
    }
  }
  return found;
}

void expectEqual(const TaskTrace& expected, const TaskTrace& actual)
{
  EXPECT_EQ(expected.task, actual.task);
  EXPECT_EQ(expected.codelet, actual.codelet);
  EXPECT_EQ(expected.implementation, actual.implementation);
  EXPECT_EQ(expected.unit, actual.unit);
  EXPECT_EQ(expected.slice, actual.slice);
  EXPECT_EQ(expected.slices, actual.slices);
  EXPECT_EQ(expected.submitted_ns, actual.submitted_ns);
  EXPECT_EQ(expected.queued_ns, actual.queued_ns);
  EXPECT_EQ(expected.started_ns, actual.started_ns);
  EXPECT_EQ(expected.transfer_ns, actual.transfer_ns);
  EXPECT_EQ(expected.finished_ns, actual.finished_ns);
  EXPECT_EQ(expected.deadline_ns, actual.deadline_ns);
  EXPECT_EQ(expected.outcome, actual.outcome);
  EXPECT_EQ(expected.stolen, actual.stolen);
  EXPECT_EQ(expected.predicted_s, actual.predicted_s);
}

TEST(TraceRecorder, KeepsRecordsInOrder)
{
  TraceRecorder recorder(10);
  EXPECT_TRUE(recorder.snapshot().empty());
  recorder.record(makeRecord(1));
  recorder.record(makeRecord(2));
  const std::vector<TaskTrace> records = recorder.snapshot();
  ASSERT_EQ(2U, records.size());
  expectEqual(makeRecord(1), records[0]);
  expectEqual(makeRecord(2), records[1]);
  EXPECT_EQ(0U, recorder.dropped());
}

TEST(TraceRecorder, DropsTheOldestWhenFull)
{
  TraceRecorder recorder(3);
  for (uint64_t task = 0; task < 8; ++task)
  {
    recorder.record(makeRecord(task));
  }
  const std::vector<TaskTrace> records = recorder.snapshot();
  ASSERT_EQ(3U, records.size());
  EXPECT_EQ(5U, records[0].task);
  EXPECT_EQ(6U, records[1].task);
  EXPECT_EQ(7U, records[2].task);
  EXPECT_EQ(5U, recorder.dropped());
}

TEST(TraceRecorder, KeepsMoreFromThenOn)
{
  TraceRecorder recorder(3);
  recorder.setEnabled(false);
  recorder.keepAtLeast(2);  // no less than before
  EXPECT_TRUE(recorder.enabled());
  for (uint64_t task = 0; task < 5; ++task)
  {
    recorder.record(makeRecord(task));
  }
  recorder.keepAtLeast(6);
  EXPECT_EQ(2u, recorder.dropped());
  for (uint64_t task = 5; task < 9; ++task)
  {
    recorder.record(makeRecord(task));
  }
  const std::vector<TaskTrace> records = recorder.snapshot();
  ASSERT_EQ(6u, records.size());
  for (size_t i = 0; i < records.size(); ++i)
  {
    EXPECT_EQ(i + 3, records[i].task);
  }
  EXPECT_EQ(3u, recorder.dropped());
}

TEST(TraceRecorder, KeepsNamesThatEndedAtTheCaller)
{
  TraceRecorder recorder(2);
  {
    const std::string name = "a name longer than a string keeps without the heap";
    TaskTrace record = makeRecord(1);
    record.codelet = name;
    recorder.record(record);
  }
  EXPECT_EQ("a name longer than a string keeps without the heap", recorder.snapshot()[0].codelet);
}

TEST(TraceRecorder, BoundsTheMemoryOfNames)
{
  TraceRecorder recorder(1);
  TaskTrace record = makeRecord(1);
  record.implementation = "same";
  for (size_t number = 0; number < TraceRecorder::MAX_NAMES + 10; ++number)
  {
    const std::string name = "codelet " + std::to_string(number);
    record.codelet = name;
    recorder.record(record);
  }
  EXPECT_EQ("(other)", recorder.snapshot()[0].codelet);
  EXPECT_EQ("same", recorder.snapshot()[0].implementation) << "a name it knew before";
}

TEST(TraceRecorder, RecordsNothingWhileOff)
{
  TraceRecorder recorder(2);
  recorder.setEnabled(false);
  recorder.record(makeRecord(1));
  EXPECT_TRUE(recorder.snapshot().empty());
  EXPECT_EQ(0U, recorder.dropped());
  recorder.setEnabled(true);
  recorder.record(makeRecord(2));
  EXPECT_EQ(1U, recorder.snapshot().size());
  EXPECT_THROW(TraceRecorder(0), std::invalid_argument);
}

TEST(TraceRecorder, TakesRecordsOfManyThreads)
{
  TraceRecorder recorder(1000);
  constexpr uint64_t PER_THREAD = 2000;
  std::vector<std::thread> threads;
  for (uint64_t thread = 0; thread < 4; ++thread)
  {
    threads.emplace_back(
        [&recorder, thread]
        {
          for (uint64_t index = 0; index < PER_THREAD; ++index)
          {
            const std::string name = "codelet " + std::to_string(index % 7);
            TaskTrace record = makeRecord(thread * PER_THREAD + index);
            record.codelet = name;
            recorder.record(record);
          }
        });
  }
  for (int round = 0; round < 50; ++round)
  {
    for (const TaskTrace& record : recorder.snapshot())
    {
      ASSERT_EQ(record.task % PER_THREAD % 7, static_cast<uint64_t>(record.codelet.back() - '0'));
    }
  }
  for (std::thread& thread : threads)
  {
    thread.join();
  }
  EXPECT_EQ(4 * PER_THREAD - 1000, recorder.dropped());
  std::vector<uint64_t> last(4, 0);
  for (const TaskTrace& record : recorder.snapshot())
  {
    EXPECT_LE(last[record.task / PER_THREAD], record.task) << "the records of one thread changed places";
    last[record.task / PER_THREAD] = record.task;
  }
}

TEST(ChromeTrace, ComesBackAsItWas)
{
  std::vector<TaskTrace> records = {makeRecord(0), makeRecord(std::numeric_limits<uint64_t>::max())};
  records[1].unit = 0;
  records[1].transfer_ns = 0;
  records[1].started_ns = 4'611'686'018'427'387'905;  // not exact as a double
  records[1].finished_ns = records[1].started_ns + 1;
  records[1].outcome = TaskOutcome::OK;
  records[1].stolen = false;
  records[1].predicted_s = 1e-300;
  const ChromeTrace trace = readBack(written(records, {"CPU cores 0-3", "GPU"}));
  ASSERT_EQ(2U, trace.records.size());
  expectEqual(records[0], trace.records[0]);
  expectEqual(records[1], trace.records[1]);
  EXPECT_EQ((std::vector<std::string>{"CPU cores 0-3", "GPU"}), trace.units);
}

TEST(ChromeTrace, WritesTheEventsOfATask)
{
  const std::string text = written({makeRecord(42)}, {"CPU", "GPU"});
  EXPECT_EQ(1U, events(text, {R"("name":"thread_name")", R"("tid":2)", R"("name":"GPU")"}).size());
  const auto begin = events(text, {R"("ph":"b")", R"("id":"42.2")", R"("ts":2.000)"});
  const auto end = events(text, {R"("ph":"e")", R"("id":"42.2")", R"("ts":4000.122)"});
  EXPECT_EQ(1U, begin.size()) << text;
  EXPECT_EQ(1U, end.size()) << text;
  const auto transfer = events(text, {R"("ph":"X")", R"("cat":"transfer")", R"("ts":4000.122,"dur":1000.001)"});
  EXPECT_EQ(1U, transfer.size()) << text;
  const auto run = events(
      text, {R"("ph":"X")", R"("cat":"run")", R"("tid":2)", R"("ts":5000.123,"dur":4000.333)", R"("deadline":"missed")",
             R"("outcome":"failed")", R"("stolen":true)", R"("predicted_s":0.1)", R"("real_s":0.004000333)"});
  EXPECT_EQ(1U, run.size()) << text;
}

TEST(ChromeTrace, TellsDeadlinesMetFromMissedAndNone)
{
  TaskTrace met = makeRecord(1);
  met.deadline_ns = met.finished_ns;
  TaskTrace none = makeRecord(2);
  none.deadline_ns = 0;
  const std::string text = written({met, none, makeRecord(3)});
  EXPECT_EQ(1U, events(text, {R"("task":1,)", R"("deadline":"met")"}).size());
  EXPECT_EQ(1U, events(text, {R"("task":2,)", R"("deadline":"none")"}).size());
  EXPECT_EQ(1U, events(text, {R"("task":3,)", R"("deadline":"missed")"}).size());
}

TEST(ChromeTrace, ATaskThatNeverRanIsAnInstant)
{
  TaskTrace record = makeRecord(1);
  record.started_ns = 0;
  record.outcome = TaskOutcome::CANCELLED;
  const std::string text = written({record});
  EXPECT_EQ(1U, events(text, {R"("ph":"i")", R"("ts":9000.456)", R"("outcome":"cancelled")", R"("real_s":0)"}).size());
  EXPECT_EQ(0U, events(text, {R"("ph":"X")"}).size());
  ASSERT_EQ(1U, readBack(text).records.size());
  expectEqual(record, readBack(text).records[0]);
}

TEST(ChromeTrace, EscapesOddNames)
{
  const std::string odd =
      "quote\" backslash\\ newline\n tab\t nul" + std::string(1, '\0') + " \x7f </script> grün 雪 🚗";
  TaskTrace record = makeRecord(1);
  record.codelet = odd;
  const std::string text = written({record}, {odd});
  for (const char character : text)
  {
    EXPECT_TRUE(character == '\n' || static_cast<uint8_t>(character) >= 0x20) << "a control character is not allowed";
  }
  const ChromeTrace trace = readBack(text);
  EXPECT_EQ(odd, trace.records.at(0).codelet);
  EXPECT_EQ(odd, trace.units.at(0));
}

TEST(ChromeTrace, ReplacesBytesThatAreNoUtf8)
{
  const std::vector<std::string> invalid = {
      "\xff",              // never occurs
      "\x80",              // continuation without a start
      "\xc3",              // cut off
      "\xc0\xaf",          // too long a form
      "\xe0\x80\xaf",      // too long a form
      "\xed\xa0\x80",      // surrogate
      "\xf4\x90\x80\x80",  // above U+10FFFF
      "\xf5\x80\x80\x80",  // above U+10FFFF
  };
  for (const std::string& bytes : invalid)
  {
    std::string replaced;
    for (size_t index = 0; index < bytes.size(); ++index)
    {
      replaced += "\xef\xbf\xbd";
    }
    TaskTrace record = makeRecord(1);
    const std::string name = "a" + bytes + "z";
    record.codelet = name;
    EXPECT_EQ("a" + replaced + "z", readBack(written({record})).records.at(0).codelet);
  }
}

TEST(ChromeTrace, WritesNoNumbersThatJsonDoesNotKnow)
{
  TaskTrace record = makeRecord(1);
  record.predicted_s = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(0, readBack(written({record})).records.at(0).predicted_s);
  record.predicted_s = std::numeric_limits<double>::infinity();
  EXPECT_EQ(0, readBack(written({record})).records.at(0).predicted_s);
}

TEST(ChromeTrace, NamesUnitsThatHaveNone)
{
  EXPECT_EQ((std::vector<std::string>{"CPU", "unit 1"}), readBack(written({makeRecord(1)}, {"CPU"})).units);
  EXPECT_TRUE(readBack(written({})).records.empty());
  EXPECT_TRUE(readBack(written({})).units.empty());
}

TEST(ChromeTrace, SkipsEventsOfOthers)
{
  const ChromeTrace trace = readBack(R"({"traceEvents":[{"ph":"X","cat":"run","name":"x"},{"ph":"C"},{}]})");
  EXPECT_TRUE(trace.records.empty());
}

TEST(ChromeTrace, RefusesWhatItCannotRead)
{
  const auto error = [](const std::string& text) -> std::string
  {
    try
    {
      readBack(text);
    }
    catch (const std::runtime_error& error)
    {
      return error.what();
    }
    return "no error";
  };
  EXPECT_NE(std::string::npos, error("{").find("not a trace of pi_runtime"));
  EXPECT_NE(std::string::npos, error("{}").find("traceEvents"));
  EXPECT_NE(std::string::npos, error(R"({"traceEvents":[{"cat":"run","args":{"task":1}}]})").find("codelet"));
  EXPECT_NE(std::string::npos,
            error(R"({"traceEvents":[{"ph":"M","name":"thread_name","tid":4000000000}]})").find("tid 4000000000"));
  std::string text = written({makeRecord(1)});
  text.replace(text.find("\"failed\""), 8, "\"absurd\"");
  EXPECT_NE(std::string::npos, error(text).find("\"absurd\"")) << error(text);
}

}  // namespace
}  // namespace pi_runtime
