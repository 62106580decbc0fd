#include "power/process_files.h"

#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <sstream>
#include <utility>

namespace pi_vehicle::power
{
namespace
{

namespace fs = std::filesystem;

/// /proc/.../stat: the name stands in brackets, and may hold blanks and brackets itself.
struct Stat
{
  std::string name;
  char state = ' ';
  double ticks = 0.0;  ///< user and system
  uint64_t start = 0;
};

std::optional<Stat> readStat(const std::string& path)
{
  std::ifstream file(path);
  std::string line;
  if (!std::getline(file, line))
  {
    return std::nullopt;
  }
  const size_t open = line.find('(');
  const size_t close = line.rfind(')');
  if (open == std::string::npos || close == std::string::npos || close < open)
  {
    return std::nullopt;
  }
  Stat stat;
  stat.name = line.substr(open + 1, close - open - 1);
  std::istringstream fields(line.substr(close + 1));
  fields >> stat.state;
  std::string skipped;
  for (int field = 4; field <= 13; ++field)  // numbered as in proc(5)
  {
    fields >> skipped;
  }
  double user = 0.0;
  double system = 0.0;
  fields >> user >> system;
  for (int field = 16; field <= 21; ++field)
  {
    fields >> skipped;
  }
  fields >> stat.start;
  if (!fields)
  {
    return std::nullopt;
  }
  stat.ticks = user + system;
  return stat;
}

}  // namespace

ProcessFiles::ProcessFiles(std::string root, double ticks_per_s)
  : root_(std::move(root)), ticks_per_s_(ticks_per_s > 0.0 ? ticks_per_s : static_cast<double>(::sysconf(_SC_CLK_TCK)))
{
}

std::optional<ProcessTime> ProcessFiles::process(int32_t pid) const
{
  const std::optional<Stat> stat = readStat(root_ + "/" + std::to_string(pid) + "/stat");
  if (!stat || stat->state == 'Z' || stat->state == 'X')
  {
    return std::nullopt;
  }
  return ProcessTime{stat->start, stat->ticks / ticks_per_s_};
}

std::vector<ThreadTime> ProcessFiles::threads(int32_t pid) const
{
  std::vector<ThreadTime> threads;
  std::error_code ignored;
  fs::directory_iterator entry(root_ + "/" + std::to_string(pid) + "/task", ignored);
  for (const fs::directory_iterator end; !ignored && entry != end; entry.increment(ignored))
  {
    const std::string tid = entry->path().filename();
    if (tid.empty() || tid.find_first_not_of("0123456789") != std::string::npos)
    {
      continue;
    }
    if (const std::optional<Stat> stat = readStat(entry->path().string() + "/stat"))
    {
      threads.push_back({static_cast<int32_t>(std::stol(tid)), stat->name, stat->ticks / ticks_per_s_});
    }
  }
  return threads;
}

std::optional<double> ProcessFiles::memory(int32_t pid) const
{
  std::ifstream file(root_ + "/" + std::to_string(pid) + "/smaps_rollup");
  std::string word;
  while (file >> word)
  {
    if (word == "Pss:")
    {
      double kilobytes = 0.0;
      return file >> kilobytes ? std::optional<double>(1024.0 * kilobytes) : std::nullopt;
    }
  }
  return std::nullopt;
}

std::optional<MachineTime> ProcessFiles::machine() const
{
  std::ifstream file(root_ + "/stat");
  std::string line;
  MachineTime time;
  bool found = false;
  while (std::getline(file, line) && line.rfind("cpu", 0) == 0)
  {
    std::istringstream fields(line);
    std::string name;
    fields >> name;
    if (name != "cpu")
    {
      ++time.cores;
      continue;
    }
    // user nice system idle iowait irq softirq steal; guests are part of user. What another guest of the host stole
    // this computer had no use of.
    double user = 0.0, nice = 0.0, system = 0.0, idle = 0.0, wait = 0.0, irq = 0.0, soft_irq = 0.0;
    fields >> user >> nice >> system >> idle >> wait >> irq >> soft_irq;
    found = static_cast<bool>(fields);
    time.busy_s = (user + nice + system + irq + soft_irq) / ticks_per_s_;
  }
  return found && time.cores > 0 ? std::optional<MachineTime>(time) : std::nullopt;
}

}  // namespace pi_vehicle::power
