#include "trace/gantt.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <random>
#include <string>
#include <vector>

namespace pi_runtime
{
namespace
{

constexpr int64_t MS = 1'000'000;
constexpr int64_t ORIGIN = 123'456'789'012'345;  // as a steady clock may say

using Colour = std::array<uint8_t, 3>;
constexpr Colour RED = {30, 30, 220};
constexpr Colour FIRST = {178, 114, 0};  // blue: the busiest codelet
constexpr Colour SECOND = {0, 159, 230};

TaskTrace makeTask(uint32_t unit, int64_t start_ms, int64_t end_ms, std::string_view codelet = "detect")
{
  TaskTrace task;
  task.codelet = codelet;
  task.unit = unit;
  task.submitted_ns = task.queued_ns = ORIGIN;
  task.started_ns = ORIGIN + start_ms * MS;
  task.finished_ns = ORIGIN + end_ms * MS;
  return task;
}

std::map<Colour, int> colours(const GanttImage& image)
{
  std::map<Colour, int> counts;
  for (size_t index = 0; index < image.bgr.size(); index += 3)
  {
    ++counts[{image.bgr[index], image.bgr[index + 1], image.bgr[index + 2]}];
  }
  return counts;
}

/// Pixels of a colour in the line that has most of it, and where the first is.
struct Stretch
{
  int length = 0;
  int first = 0;
};
Stretch longestLine(const GanttImage& image, const Colour& colour)
{
  Stretch best;
  for (int y = 0; y < image.height; ++y)
  {
    Stretch run;
    for (int x = 0; x < image.width; ++x)
    {
      const uint8_t* pixel = &image.bgr[static_cast<size_t>((y * image.width + x) * 3)];
      if (std::equal(colour.begin(), colour.end(), pixel))
      {
        run.first = run.length == 0 ? x : run.first;
        ++run.length;
      }
    }
    best = run.length > best.length ? run : best;
  }
  return best;
}

TEST(UnitUtilisation, IsTheUnionOfTransfersAndRuns)
{
  TaskTrace with_transfer = makeTask(0, 20, 30);
  with_transfer.transfer_ns = 5 * MS;
  const std::vector<TaskTrace> records = {makeTask(0, 0, 10), makeTask(0, 5, 12), with_transfer, makeTask(2, 90, 200)};
  const std::vector<double> busy = unitUtilisation(records, 4, ORIGIN, ORIGIN + 100 * MS);
  ASSERT_EQ(4U, busy.size());
  EXPECT_DOUBLE_EQ(0.27, busy[0]);
  EXPECT_DOUBLE_EQ(0, busy[1]);
  EXPECT_DOUBLE_EQ(0.1, busy[2]) << "cut at the end of the time asked for";
  EXPECT_EQ(3U, unitUtilisation(records, 0, ORIGIN, ORIGIN + MS).size()) << "records may name more units";
}

TEST(UnitUtilisation, OfNoTimeOrNoRunIsZero)
{
  TaskTrace never = makeTask(0, 0, 10);
  never.started_ns = 0;
  EXPECT_EQ(0, unitUtilisation({never}, 1, ORIGIN, ORIGIN + MS).at(0));
  EXPECT_EQ(0, unitUtilisation({makeTask(0, 0, 10)}, 1, ORIGIN, ORIGIN).at(0));
}

TEST(Gantt, BarsAreAsLongAsTheTasks)
{
  const GanttImage image = drawGantt(
      {makeTask(0, 0, 750), makeTask(1, 250, 500, "blur"), makeTask(2, 990, 1000, "last")}, {"CPU 0", "CPU 1", "GPU"});
  const Stretch blue = longestLine(image, FIRST);
  const Stretch orange = longestLine(image, SECOND);
  constexpr int OUTLINE = 2;  // pixels of each bar
  EXPECT_NEAR(3.0, static_cast<double>(blue.length + OUTLINE) / (orange.length + OUTLINE), 0.02);
  EXPECT_NEAR(orange.length + OUTLINE, orange.first - blue.first, 2) << "the second starts at a quarter";
}

TEST(Gantt, AMissedDeadlineIsRed)
{
  TaskTrace task = makeTask(0, 0, 100);
  task.deadline_ns = task.finished_ns;
  EXPECT_EQ(0, colours(drawGantt({task}, {}))[RED]);
  task.deadline_ns = task.finished_ns - 50 * MS;
  const GanttImage image = drawGantt({task}, {});
  EXPECT_NEAR(0.5, static_cast<double>(longestLine(image, RED).length) / longestLine(image, FIRST).length, 0.02);
}

TEST(Gantt, AMissShowsAmongThousandsOfTasks)
{
  std::vector<TaskTrace> tasks;
  for (int index = 0; index < 5000; ++index)
  {
    tasks.push_back(makeTask(0, index * 10, index * 10 + 1));
  }
  EXPECT_EQ(0, colours(drawGantt(tasks, {}))[RED]);
  tasks[2500].deadline_ns = tasks[2500].finished_ns - 1;
  EXPECT_GT(colours(drawGantt(tasks, {}))[RED], 0);
}

TEST(Gantt, TransfersAndFailuresLookDifferent)
{
  const TaskTrace plain = makeTask(0, 0, 100);
  TaskTrace with_transfer = makeTask(0, 50, 100);
  with_transfer.transfer_ns = 50 * MS;
  TaskTrace failed = plain;
  failed.outcome = TaskOutcome::FAILED;
  const int blue = longestLine(drawGantt({plain}, {}), FIRST).length;
  EXPECT_NEAR(0.5, static_cast<double>(longestLine(drawGantt({with_transfer}, {}), FIRST).length) / blue, 0.2)
      << "the hatching has some pixels of the plain colour";
  EXPECT_NE(drawGantt({plain}, {}).bgr, drawGantt({failed}, {}).bgr);
}

TEST(Gantt, GrowsWithTheUnits)
{
  const GanttImage two = drawGantt({makeTask(0, 0, 1)}, {"CPU", "GPU"});
  const GanttImage four = drawGantt({makeTask(3, 0, 1)}, {"CPU", "GPU"});
  EXPECT_EQ(1600, two.width);
  EXPECT_EQ(two.bgr.size(), static_cast<size_t>(two.width) * static_cast<size_t>(two.height) * 3);
  EXPECT_GT(four.height, two.height + 40) << "units that only records name have rows as well";
}

TEST(Gantt, ShowsTheTimeAskedForOnly)
{
  const std::vector<TaskTrace> tasks = {makeTask(0, 0, 100, "first"), makeTask(0, 200, 250, "second")};
  GanttOptions options;
  options.from_s = 0.15;
  options.to_s = 0.25;
  const GanttImage image = drawGantt(tasks, {}, options);
  const int whole = longestLine(drawGantt({makeTask(0, 0, 100)}, {}), FIRST).length;
  EXPECT_NEAR(0.5, static_cast<double>(longestLine(image, SECOND).length) / whole, 0.02)
      << "colours are those of the whole trace";
  // The legend names both; the plot has none of the first.
  EXPECT_LE(longestLine(image, FIRST).length, 30);
}

TEST(Gantt, EmptyAndTinyTracesHaveAPicture)
{
  EXPECT_GT(drawGantt({}, {}).height, 0);
  EXPECT_GT(drawGantt({}, {"CPU"}).height, 0);
  EXPECT_GT(colours(drawGantt({makeTask(0, 5, 5)}, {""})).size(), 10U) << "a task without duration";
  TaskTrace never = makeTask(0, 0, 1);
  never.started_ns = 0;
  EXPECT_GT(drawGantt({never}, {}).height, 0);
}

TEST(Gantt, TakesAnyNamesAndManyCodelets)
{
  std::vector<std::string> names;
  for (int index = 0; index < 60; ++index)
  {
    names.push_back("codelet of a long name \xe9\x9b\xaa \xff" + std::string(1, '\0') + std::to_string(index));
  }
  std::vector<TaskTrace> tasks;
  for (int index = 0; index < 60; ++index)
  {
    tasks.push_back(makeTask(0, index * 10, index * 10 + 10, names[static_cast<size_t>(index)]));
  }
  const GanttImage image = drawGantt(tasks, {std::string(500, 'x')});
  EXPECT_GT((colours(image)[{150, 150, 150}]), 1000) << "codelets beyond the palette are grey";
}

TEST(Gantt, AnyTraceIsDrawnInsideThePicture)
{
  std::mt19937_64 random(5);
  const auto anyTime = [&random] { return static_cast<int64_t>(random() % 2'000'000'000) - 1'000'000'000; };
  for (int round = 0; round < 200; ++round)
  {
    std::vector<TaskTrace> tasks(1 + random() % 50);
    for (TaskTrace& task : tasks)
    {
      task.codelet = random() % 2 == 0 ? "a" : "b";
      task.unit = static_cast<uint32_t>(random() % 3);
      task.started_ns = anyTime();
      task.transfer_ns = anyTime();
      task.finished_ns = anyTime();  // before the start as well
      task.deadline_ns = anyTime();
      task.outcome = static_cast<TaskOutcome>(random() % 3);
    }
    GanttOptions options;
    options.width = 600;
    options.to_s = random() % 2 == 0 ? 1e-8 : 10;
    EXPECT_EQ(600, drawGantt(tasks, {}, options).width);
  }
}

TEST(Gantt, RefusesOptionsThatMakeNoPicture)
{
  const auto error = [](double from_s, double to_s, int width) -> std::string
  {
    GanttOptions options;
    options.from_s = from_s;
    options.to_s = to_s;
    options.width = width;
    try
    {
      drawGantt({makeTask(0, 0, 1000)}, {}, options);
    }
    catch (const std::invalid_argument& error)
    {
      return error.what();
    }
    return "no error";
  };
  constexpr double END = std::numeric_limits<double>::infinity();
  EXPECT_EQ("no error", error(0, END, 600));
  EXPECT_EQ("width = 599, must be in [600, 20000]", error(0, END, 599));
  EXPECT_NE(std::string::npos, error(-1, END, 600).find("from_s = -1"));
  EXPECT_NE(std::string::npos, error(std::nan(""), END, 600).find("from_s = nan"));
  EXPECT_NE(std::string::npos, error(2, 1, 600).find("to_s = 1, must be greater than from_s = 2"));
  EXPECT_NE(std::string::npos, error(0, std::nan(""), 600).find("to_s = nan"));
  EXPECT_NE(std::string::npos, error(5, END, 600).find("from_s = 5 is not before the end")) << error(5, END, 600);
  EXPECT_EQ("no error", error(0, 1e300, 600));
}

TEST(Gantt, WritesAPngOrSaysWhyNot)
{
  char name[] = "/tmp/test_gantt.XXXXXX";
  const std::string folder = mkdtemp(name);
  writeGantt(folder + "/picture.png", {makeTask(0, 0, 1)}, {"CPU"});
  std::ifstream file(folder + "/picture.png", std::ios::binary);
  std::string signature(8, '\0');
  file.read(signature.data(), 8);
  EXPECT_EQ("\x89PNG\r\n\x1a\n", signature);
  for (const std::string& path : {folder + "/missing/picture.png", folder + "/picture.unknown"})
  {
    try
    {
      writeGantt(path, {makeTask(0, 0, 1)}, {"CPU"});
      ADD_FAILURE() << path;
    }
    catch (const std::runtime_error& error)
    {
      EXPECT_NE(std::string::npos, std::string(error.what()).find(path)) << error.what();
    }
  }
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace pi_runtime
