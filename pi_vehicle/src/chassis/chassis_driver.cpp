#include <pi_vehicle/chassis/chassis_driver.h>

#include <pi_node/option_check.h>
#include <pi_node/vehicle_clock.h>
#include <pi_vehicle/serial/serial_port.h>
#include <poll.h>
#include <pthread.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <system_error>
#include <thread>
#include <utility>

namespace pi_vehicle::chassis
{

using pi_node::vehicleNs;

namespace
{

constexpr size_t READ_BYTES = 4096;
constexpr int READS_AT_ONCE = 16;  ///< a line that floods must not keep the thread from commanding

}  // namespace

void DriverOptions::validate() const
{
  if (port.empty())
  {
    throw std::invalid_argument(
        "port = \"\", must be a path, a name in /dev, or a part of a name in /dev/serial/by-id");
  }
  SerialPort::checkBaudRate(baud_rate);
  const pi_node::OptionCheck check("");
  check.range("start_patience_s", start_patience_s, 0.0, 600.0);
  check.range("first_pause_s", first_pause_s, 0.01, 10.0);
  check.range("longest_pause_s", longest_pause_s, first_pause_s, 60.0);
  host.validate();
}

class ChassisDriver::Worker
{
public:
  Worker(const DriverOptions& options, DriverEvents events)
    : options_(options)
    , events_(std::move(events))
    , period_ns_(std::llround(1e9 * options.host.command_period_s))
    , host_(options.host)
    , patient_until_ns_(vehicleNs() + std::llround(1e9 * options.start_patience_s))
    , pause_s_(options.first_pause_s)
    , wake_(::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC))
  {
    if (wake_ < 0)
    {
      throw std::system_error(errno, std::generic_category(), "eventfd");
    }
    thread_ = std::thread([this] { run(); });
    pthread_setname_np(thread_.native_handle(), "chassis");
  }

  ~Worker()
  {
    stopping_ = true;
    wake();
    thread_.join();
    ::close(wake_);
  }

  bool setMotion(const Motion& motion)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    return host_.setMotion(motion, vehicleNs());
  }

  void emergencyStop(const std::string& reason)
  {
    {
      std::lock_guard<std::mutex> lock(mutex_);
      host_.emergencyStop(reason);
    }
    at_once_ = true;
    wake();
  }

  void release()
  {
    std::lock_guard<std::mutex> lock(mutex_);
    host_.release(vehicleNs());
  }

  DriverState state() const
  {
    std::lock_guard<std::mutex> lock(mutex_);
    DriverState state = state_;
    state.host = host_.state(vehicleNs());
    return state;
  }

private:
  void wake()
  {
    const uint64_t one = 1;
    if (::write(wake_, &one, sizeof one) < 0)
    {
      // full: it is awake already
    }
  }

  void run()
  {
    int64_t due_ns = vehicleNs();
    int64_t open_ns = due_ns;
    while (!stopping_)
    {
      if (!port_ && vehicleNs() >= open_ns)
      {
        open_ns = openPort() ? open_ns : vehicleNs() + nextPauseNs();
      }
      if (at_once_.exchange(false) || vehicleNs() >= due_ns)
      {
        command();
        events_.state(state());
        due_ns += period_ns_;
        if (due_ns <= vehicleNs())  // late: no burst
        {
          due_ns = vehicleNs() + period_ns_;
        }
      }
      if (!wait(due_ns))
      {
        open_ns = vehicleNs() + nextPauseNs();
      }
    }
    stopVehicle();
  }

  int64_t nextPauseNs()
  {
    const double pause_s = pause_s_;
    pause_s_ = std::min(2.0 * pause_s_, options_.longest_pause_s);
    return std::llround(1e9 * pause_s);
  }

  bool openPort()
  {
    try
    {
      port_.emplace(SerialPort::findPath(options_.port), options_.baud_rate, "the chassis");
    }
    catch (const std::runtime_error& error)
    {
      {
        std::lock_guard<std::mutex> lock(mutex_);
        ++state_.open_errors;
        host_.onLineClosed(error.what());
      }
      if (has_opened_ || vehicleNs() >= patient_until_ns_)
      {
        tell(error.what());
      }
      return false;
    }
    told_ = false;
    has_opened_ = true;
    pending_.clear();
    {
      std::lock_guard<std::mutex> lock(mutex_);
      ++state_.opened;
      state_.path = port_->path();
      host_.onLineOpen(vehicleNs());
    }
    if (events_.opened)
    {
      events_.opened(port_->path());
    }
    return true;
  }

  void lose(const std::string& problem)
  {
    port_.reset();
    {
      std::lock_guard<std::mutex> lock(mutex_);
      ++state_.lost;
      state_.path.clear();
      host_.onLineClosed(problem);
    }
    tell(problem);
  }

  void tell(const std::string& problem)
  {
    if (!told_ && events_.closed)
    {
      events_.closed(problem);
    }
    told_ = true;
  }

  /// Writes a command, or the rest of the last one: never half a frame after another half.
  void command()
  {
    if (!port_)
    {
      return;
    }
    std::lock_guard<std::mutex> lock(mutex_);
    std::vector<uint8_t> bytes = host_.poll(vehicleNs());
    if (pending_.empty())
    {
      pending_ = std::move(bytes);
    }
    else
    {
      ++state_.dropped_commands;
    }
  }

  void flush()
  {
    if (!pending_.empty())
    {
      const size_t written = port_->write(pending_.data(), pending_.size());
      pending_.erase(pending_.begin(), pending_.begin() + static_cast<std::ptrdiff_t>(written));
    }
  }

  /// Until something comes, or a command is due. @return false if the port was lost.
  bool wait(int64_t due_ns)
  {
    std::array<pollfd, 2> waiting = {};
    waiting[0].fd = wake_;
    waiting[0].events = POLLIN;
    try
    {
      if (port_)
      {
        flush();
        waiting[1].fd = port_->descriptor();
        waiting[1].events = static_cast<short>(POLLIN | (pending_.empty() ? 0 : POLLOUT));
      }
      constexpr int64_t LOOK_NS = std::chrono::nanoseconds(pi_node::SIMULATED_LOOK).count();
      const int64_t left_ns =
          std::clamp<int64_t>(due_ns - vehicleNs(), 0, pi_node::isTimeSimulated() ? LOOK_NS : due_ns);
      timespec timeout = {};
      timeout.tv_sec = left_ns / 1'000'000'000;
      timeout.tv_nsec = left_ns % 1'000'000'000;
      if (::ppoll(waiting.data(), port_ ? 2 : 1, &timeout, nullptr) <= 0)
      {
        return true;
      }
      if (waiting[0].revents != 0)
      {
        uint64_t ignored = 0;
        if (::read(wake_, &ignored, sizeof ignored) < 0)
        {
          // another wake-up emptied it
        }
      }
      if (port_ && waiting[1].revents != 0)
      {
        receive();
        if ((waiting[1].revents & (POLLHUP | POLLERR | POLLNVAL)) != 0)
        {
          port_->throwGone();
        }
      }
    }
    catch (const SerialError& error)
    {
      lose(error.what());
      return false;
    }
    return true;
  }

  void receive()
  {
    std::array<uint8_t, READ_BYTES> bytes;
    for (int i = 0; i < READS_AT_ONCE; ++i)
    {
      const size_t count = port_->read(bytes.data(), bytes.size());
      if (count == 0)
      {
        return;
      }
      std::lock_guard<std::mutex> lock(mutex_);
      host_.onBytes(bytes.data(), count, vehicleNs());
      if (host_.state(vehicleNs()).mode != HostMode::DISCONNECTED)
      {
        pause_s_ = options_.first_pause_s;  // a chassis that answers, not only a port that opens
      }
    }
  }

  void stopVehicle()
  {
    if (!port_)
    {
      return;
    }
    try
    {
      flush();
      {
        std::lock_guard<std::mutex> lock(mutex_);
        host_.stop();
      }
      command();
      flush();
    }
    catch (const SerialError&)
    {
      // gone: its watchdog stops it
    }
  }

  const DriverOptions options_;
  const DriverEvents events_;
  const int64_t period_ns_;

  mutable std::mutex mutex_;  ///< of host_ and state_; held briefly
  ChassisHost host_;
  DriverState state_;

  // chassis
  std::optional<SerialPort> port_;
  std::vector<uint8_t> pending_;
  const int64_t patient_until_ns_;
  bool has_opened_ = false;
  double pause_s_;
  bool told_ = false;

  const int wake_;
  std::atomic<bool> at_once_{false};
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

ChassisDriver::ChassisDriver(const DriverOptions& options, DriverEvents events)
{
  options.validate();
  if (!events.state)
  {
    throw std::invalid_argument("events.state is empty, must be a function");
  }
  worker_ = std::make_unique<Worker>(options, std::move(events));
}

ChassisDriver::~ChassisDriver() = default;

bool ChassisDriver::setMotion(const Motion& motion)
{
  return worker_->setMotion(motion);
}

void ChassisDriver::emergencyStop(const std::string& reason)
{
  worker_->emergencyStop(reason);
}

void ChassisDriver::release()
{
  worker_->release();
}

DriverState ChassisDriver::state() const
{
  return worker_->state();
}

}  // namespace pi_vehicle::chassis
