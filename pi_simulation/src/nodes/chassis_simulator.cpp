// A chassis on a pseudo-terminal, for a drive without a vehicle. Needs no ROS master; arguments of roslaunch are
// ignored.

#include "chassis/simulated_chassis.h"

#include <fcntl.h>
#include <pi_node/durations.h>
#include <pi_node/ros/vehicle_parameters.h>
#include <pi_node/ros/yaml_parameters.h>
#include <pi_node/stop_signal.h>
#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <boost/program_options.hpp>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <exception>
#include <iostream>
#include <stdexcept>
#include <string>
#include <vector>

namespace pi_simulation
{

using pi_node::monotonicNs;

namespace
{

constexpr int64_t STEP_NS = 5'000'000;
constexpr size_t MAX_LINE = 4096;

struct Arguments
{
  SimulationOptions simulation;
  std::string vehicle;
  std::string truth;
  double truth_rate = 50.0;
  std::vector<std::string> commands;
};

pi_node::VehicleDescription vehicleOf(const std::string& file)
{
  try
  {
    return pi_node::vehicleFromParameters(pi_node::fromYaml(YAML::LoadFile(file)), file);
  }
  catch (const YAML::Exception& error)
  {
    throw std::invalid_argument("--vehicle " + file + ": " + error.what());
  }
}

bool parse(int argc, char** argv, Arguments* arguments)
{
  namespace po = boost::program_options;
  SimulationOptions& simulation = arguments->simulation;
  po::options_description options(
      "chassis_simulator: a chassis on a pseudo-terminal; commands on stdin, as unplug, "
      "plug, garbage 100, stuck on, battery 0.1, button on, silent on, restart, quit");
  const auto number = [](double* value) { return po::value<double>(value)->default_value(*value); };
  auto add = options.add_options();
  add("help,h", "this text");
  add("link", po::value<std::string>(&simulation.link), "symbolic link to the pseudo-terminal");
  add("vehicle", po::value<std::string>(&arguments->vehicle),
      "its description, a file as config/vehicle.yaml of pi_node");
  add("truth", po::value<std::string>(&arguments->truth),
      "file or FIFO that gets the true pose as lines of JSON; - for stdout");
  add("truth-rate", number(&arguments->truth_rate), "[Hz]");
  add("command", po::value<std::vector<std::string>>(&arguments->commands), "as on stdin, at the start; repeatable");
  add("x", number(&simulation.start.x), "start [m]");
  add("y", number(&simulation.start.y), "start [m]");
  add("yaw", number(&simulation.start.heading), "start [rad]");
  add("speed-lag", number(&simulation.model.speed_lag_s), "[s]");
  add("steering-lag", number(&simulation.model.steering_lag_s), "[s]");
  add("dead-time", number(&simulation.model.dead_time_s), "[s]");
  add("watchdog", number(&simulation.watchdog_s), "[s]");
  add("battery", number(&simulation.model.battery_charge), "0 to 1");
  add("seed", po::value<uint64_t>(&simulation.seed)->default_value(simulation.seed), "of the garbage");

  std::vector<std::string> words;
  for (int i = 1; i < argc; ++i)
  {
    const std::string word = argv[i];
    if (word.rfind("__", 0) != 0)  // as roslaunch appends: __name:=, __log:=
    {
      words.push_back(word);
    }
  }
  po::variables_map values;
  po::store(po::command_line_parser(words).options(options).positional({}).run(), values);
  po::notify(values);
  if (values.count("help") != 0)
  {
    std::cout << options;
    return false;
  }
  if (!(arguments->truth_rate > 0.0 && arguments->truth_rate <= 200.0))
  {
    throw std::invalid_argument("--truth-rate " + std::to_string(arguments->truth_rate) + ", must be in (0, 200]");
  }
  simulation.setVehicle(arguments->vehicle.empty() ? pi_node::VehicleDescription() : vehicleOf(arguments->vehicle));
  return true;
}

/// A text output that never blocks: a line that finds no room, or nobody who reads, is left out.
class LineOutput
{
public:
  explicit LineOutput(const std::string& path) : path_(path)
  {
    if (path_ == "-")
    {
      descriptor_ = STDOUT_FILENO;
    }
    else
    {
      open();
    }
  }

  void write(std::string line)
  {
    if (descriptor_ < 0 && !path_.empty())
    {
      open();
    }
    line += '\n';
    if (descriptor_ >= 0 && ::write(descriptor_, line.data(), line.size()) < 0 && errno == EPIPE && path_ != "-")
    {
      ::close(descriptor_);
      descriptor_ = -1;
    }
  }

private:
  void open()
  {
    if (path_.empty())
    {
      return;
    }
    descriptor_ = ::open(path_.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_NONBLOCK | O_CLOEXEC, 0644);
    if (descriptor_ < 0 && errno != ENXIO)  // a FIFO that nobody reads yet
    {
      throw std::runtime_error("--truth " + path_ + " cannot be opened: " + std::strerror(errno));
    }
  }

  const std::string path_;
  int descriptor_ = -1;
};

/// Lines of stdin, without waiting.
class LineInput
{
public:
  /// Waits until then at most. @return complete lines.
  std::vector<std::string> wait(int64_t until_ns)
  {
    pollfd waiting = {};
    waiting.fd = open_ ? STDIN_FILENO : -1;
    waiting.events = POLLIN;
    const int64_t left_ns = std::max<int64_t>(until_ns - monotonicNs(), 0);
    timespec timeout = {};
    timeout.tv_nsec = std::min<int64_t>(left_ns, 999'999'999);
    if (::ppoll(&waiting, 1, &timeout, nullptr) > 0)
    {
      char bytes[512];
      const ssize_t count = ::read(STDIN_FILENO, bytes, sizeof bytes);
      open_ = count > 0 || (count < 0 && errno == EINTR);
      text_.append(bytes, static_cast<size_t>(std::max<ssize_t>(count, 0)));
    }
    std::vector<std::string> lines;
    for (size_t end = text_.find('\n'); end != std::string::npos; end = text_.find('\n'))
    {
      lines.push_back(text_.substr(0, end));
      text_.erase(0, end + 1);
    }
    if (text_.size() > MAX_LINE)
    {
      text_.clear();
    }
    return lines;
  }

private:
  bool open_ = true;
  std::string text_;
};

int run(const Arguments& arguments)
{
  SimulatedChassis chassis(arguments.simulation, monotonicNs());
  LineOutput truth(arguments.truth);
  const auto say = [&chassis]
  { std::cout << "chassis_simulator: " << (chassis.path().empty() ? "unplugged" : chassis.path()) << std::endl; };
  say();
  const auto execute = [&chassis, &say](const std::string& line)
  {
    const std::string before = chassis.path();
    const std::string problem = chassis.command(line, monotonicNs());
    if (!problem.empty())
    {
      std::cerr << "chassis_simulator: " << problem << std::endl;
    }
    if (chassis.path() != before)
    {
      say();
    }
  };
  for (const std::string& line : arguments.commands)
  {
    execute(line);
  }

  LineInput input;
  const auto truth_ns = static_cast<int64_t>(1e9 / arguments.truth_rate);
  int64_t due_ns = monotonicNs();
  int64_t truth_due_ns = due_ns;
  while (!pi_node::StopSignal::came())
  {
    if (const int64_t now_ns = monotonicNs(); now_ns >= due_ns)
    {
      chassis.step(now_ns);
      due_ns = std::max(due_ns + STEP_NS, now_ns);
      if (now_ns >= truth_due_ns)
      {
        truth.write(chassis.truth());
        truth_due_ns = std::max(truth_due_ns + truth_ns, now_ns);
      }
    }
    for (const std::string& line : input.wait(due_ns))
    {
      if (line == "quit")
      {
        return 0;
      }
      execute(line);
    }
  }
  return pi_node::StopSignal::exitStatus();
}

}  // namespace
}  // namespace pi_simulation

int main(int argc, char** argv)
{
  using namespace pi_simulation;
  try
  {
    std::signal(SIGPIPE, SIG_IGN);
    pi_node::StopSignal::install();
    Arguments arguments;
    return parse(argc, argv, &arguments) ? run(arguments) : 0;
  }
  catch (const std::exception& error)
  {
    std::cerr << "chassis_simulator: " << error.what() << std::endl;
    return 1;
  }
}
