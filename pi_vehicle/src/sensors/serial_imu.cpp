#include "sensors/serial_imu.h"

#include "sensors/sample_clock.h"

#include <pi_node/durations.h>
#include <pi_node/formatting.h>
#include <pi_node/option_check.h>
#include <pi_node/vehicle_clock.h>
#include <pi_vehicle/serial/serial_port.h>
#include <poll.h>
#include <pthread.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdlib>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <thread>
#include <utility>

namespace pi_vehicle
{

using pi_node::nanoseconds;
using pi_node::vehicleNs;

namespace
{

constexpr int LOOK_MS = 50;
constexpr double SILENCE_S = 1.0;          ///< without a measurement, after which there is a problem
constexpr double CONFIGURE_PAUSE_S = 1.0;  ///< before a command without an answer is sent again
constexpr int BITS_OF_A_BYTE = 10;         ///< on the wire: 8N1
constexpr int BYTES_OF_A_LINE = 110;       ///< VNIMU
constexpr int REGISTER_OF_OUTPUT = 6;
constexpr int REGISTER_OF_RATE = 7;
constexpr int OUTPUT_IMU = 19;
constexpr std::array<int, 11> DEVICE_RATES = {1, 2, 4, 5, 10, 20, 25, 40, 50, 100, 200};

}  // namespace

void SerialImuOptions::validate() const
{
  if (port.empty())
  {
    throw std::invalid_argument(
        "port = \"\", must be a path, a name in /dev, or a part of a name in /dev/serial/by-id");
  }
  SerialPort::checkBaudRate(baud_rate);
  const pi_node::OptionCheck check("");
  check.range("rate", rate, 1.0, 1000.0);
  check.range("reconnect_pause_s", reconnect_pause_s, 0.05, 60.0);
  if (const double most = static_cast<double>(baud_rate) / (BITS_OF_A_BYTE * BYTES_OF_A_LINE); rate > most)
  {
    throw std::invalid_argument(
        pi_node::format("rate = %g, must be at most %.0f: the line carries no more at "
                        "baud_rate = %.0f",
                        rate, std::floor(most), baud_rate));
  }
  if (configure && std::find(DEVICE_RATES.begin(), DEVICE_RATES.end(), rate) == DEVICE_RATES.end())
  {
    throw std::invalid_argument(
        pi_node::format("rate = %g, must be 1, 2, 4, 5, 10, 20, 25, 40, 50, 100 or 200 with configure: true", rate));
  }
}

class SerialImu::Worker
{
public:
  Worker(const SerialImuOptions& options, SerialImuEvents events)
    : options_(options), events_(std::move(events)), clock_(options.rate)
  {
    commands_ = {pi_node::format("VNWRG,%02.0f,%.0f", REGISTER_OF_OUTPUT, OUTPUT_IMU),
                 pi_node::format("VNWRG,%02.0f,%.0f", REGISTER_OF_RATE, options.rate)};
    thread_ = std::thread([this] { run(); });
    pthread_setname_np(thread_.native_handle(), "serial_imu");
  }

  ~Worker()
  {
    stopping_ = true;
    thread_.join();
  }

  SerialImuState state() const
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    return state_;
  }

private:
  void run()
  {
    int64_t open_ns = vehicleNs();
    while (!stopping_)
    {
      if (!port_ && vehicleNs() >= open_ns)
      {
        open_ns = vehicleNs() + nanoseconds(options_.reconnect_pause_s);
        open();
      }
      pollfd waiting = {port_ ? port_->descriptor() : -1, POLLIN, 0};
      ::poll(&waiting, 1, LOOK_MS);
      if (!port_)
      {
        continue;
      }
      try
      {
        if ((waiting.revents & POLLIN) != 0)
        {
          receive(vehicleNs());
        }
        if ((waiting.revents & (POLLHUP | POLLERR | POLLNVAL)) != 0)
        {
          port_->throwGone();
        }
        configure();
        watch();
      }
      catch (const SerialError& error)
      {
        port_.reset();
        set([](SerialImuState* state) { state->path.clear(); });
        tell(error.what());
      }
    }
  }

  template <typename Change>
  void set(Change change)
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    change(&state_);
  }

  void tell(const std::string& problem)
  {
    bool first = false;
    set(
        [&](SerialImuState* state)
        {
          first = state->problem.empty();
          state->problem = problem;
        });
    if (first && events_.problem)
    {
      events_.problem(problem);
    }
  }

  void open()
  {
    try
    {
      port_.emplace(SerialPort::findPath(options_.port), options_.baud_rate, "the IMU");
    }
    catch (const SerialError& error)
    {
      tell(error.what());
      return;
    }
    reader_.restart();
    clock_.restart();
    well_ = false;
    next_command_ = options_.configure ? 0 : commands_.size();
    command_ns_ = heard_ns_ = vehicleNs();
    refusal_.clear();
    set(
        [this](SerialImuState* state)
        {
          ++state->opened;
          state->path = port_->path();
          state->configured = false;
        });
    at_open_ = state();
  }

  void receive(int64_t arrival_ns)
  {
    std::array<uint8_t, 4096> bytes;
    const size_t count = port_->read(bytes.data(), bytes.size());
    reader_.onBytes(bytes.data(), count, [&](const VectorNavLine& line) { onLine(line, arrival_ns); });
    set(
        [this](SerialImuState* state)
        {
          state->garbage_bytes = reader_.garbageBytes();
          state->missed = clock_.missed();
        });
  }

  void onLine(const VectorNavLine& line, int64_t arrival_ns)
  {
    using Kind = VectorNavLine::Kind;
    switch (line.kind)
    {
      case Kind::MEASUREMENT:
        onMeasurement(line, arrival_ns);
        return;
      case Kind::OTHER:
        set([](SerialImuState* state) { ++state->other; });
        onOther(line.text);
        return;
      case Kind::NOT_FINITE:
        set([](SerialImuState* state) { ++state->not_finite; });
        break;
      case Kind::WRONG_CHECKSUM:
        set([](SerialImuState* state) { ++state->wrong_checksums; });
        break;
      case Kind::TORN:
        set([](SerialImuState* state) { ++state->torn; });
        break;
    }
    clock_.skip();
  }

  void onMeasurement(const VectorNavLine& line, int64_t arrival_ns)
  {
    heard_ns_ = arrival_ns;
    set(
        [](SerialImuState* state)
        {
          ++state->measurements;
          state->problem.clear();
        });
    if (!std::exchange(well_, true) && events_.well)
    {
      events_.well(port_->path());
    }
    if (const std::optional<int64_t> stamp_ns = clock_.sample(arrival_ns); stamp_ns && events_.measurement)
    {
      const double wire_s = static_cast<double>(BITS_OF_A_BYTE * line.bytes) / options_.baud_rate;
      events_.measurement(line.measurement, *stamp_ns - nanoseconds(wire_s));
    }
  }

  /// Answers repeat the number of the register, errors are "VNERR,12".
  void onOther(const std::string& text)
  {
    other_ = text.substr(0, text.find(','));
    if (next_command_ >= commands_.size())
    {
      return;
    }
    const int number = other_ == text ? 0 : std::atoi(text.c_str() + other_.size() + 1);
    if (other_ == "VNWRG" && number == (next_command_ == 0 ? REGISTER_OF_OUTPUT : REGISTER_OF_RATE))
    {
      ++next_command_;
      command_ns_ = vehicleNs();
      set([this](SerialImuState* state) { state->configured = next_command_ == commands_.size(); });
    }
    else if (other_ == "VNERR")
    {
      refusal_ = "the IMU refuses " + commands_[next_command_] + " with error " + std::to_string(number) +
                 (number == 12 ? "; give a lower rate or a higher baud_rate" : "; its manual lists the errors");
    }
  }

  /// Commands go one after the other, each until it is answered.
  void configure()
  {
    if (next_command_ < commands_.size() && vehicleNs() >= command_ns_)
    {
      command_ns_ = vehicleNs() + nanoseconds(CONFIGURE_PAUSE_S);
      const std::string bytes = vectorNavCommand(commands_[next_command_]);
      port_->write(reinterpret_cast<const uint8_t*>(bytes.data()), bytes.size());
    }
  }

  /// Finds out why no measurements come.
  void watch()
  {
    if (pi_node::secondsBetween(heard_ns_, vehicleNs()) <= SILENCE_S)
    {
      return;
    }
    const SerialImuState now = state();
    const uint64_t broken = now.wrong_checksums + now.torn - at_open_.wrong_checksums - at_open_.torn;
    const std::string name = "IMU on " + port_->path() + ": ";
    if (!refusal_.empty())
    {
      tell(name + refusal_);
    }
    else if (now.measurements > at_open_.measurements)
    {
      tell(name + "nothing comes any more; is it switched on?");
    }
    else if (now.garbage_bytes > at_open_.garbage_bytes || broken > 0)
    {
      tell(name + "only garbage comes; set baud_rate = " + std::to_string(options_.baud_rate) +
           " to that of the device, and check that it is a VectorNav");
    }
    else if (now.not_finite > at_open_.not_finite)
    {
      tell(name + "its measurements are no numbers; switch it off and on");
    }
    else if (now.other > at_open_.other)
    {
      tell(name + "it sends $" + other_ + ", not $VNIMU; " +
           (options_.configure ? "it did not take its configuration" : "set configure: true"));
    }
    else
    {
      tell(name + "nothing comes; is it switched on, and is baud_rate = " + std::to_string(options_.baud_rate) +
           " that of the device?");
    }
    well_ = false;
  }

  const SerialImuOptions options_;
  const SerialImuEvents events_;
  std::array<std::string, 2> commands_;

  mutable std::mutex mutex_;
  SerialImuState state_;

  // of the thread
  std::optional<SerialPort> port_;
  VectorNavReader reader_;
  SampleClock clock_;
  bool well_ = false;
  size_t next_command_ = 0;
  int64_t command_ns_ = 0;  ///< when it is sent, or sent again
  int64_t heard_ns_ = 0;    ///< the last measurement, or the opening
  std::string refusal_;     ///< of a command
  std::string other_;       ///< header of the last line that was no measurement
  SerialImuState at_open_;

  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

SerialImu::SerialImu(const SerialImuOptions& options, SerialImuEvents events)
{
  options.validate();
  worker_ = std::make_unique<Worker>(options, std::move(events));
}

SerialImu::~SerialImu() = default;

SerialImuState SerialImu::state() const
{
  return worker_->state();
}

}  // namespace pi_vehicle
