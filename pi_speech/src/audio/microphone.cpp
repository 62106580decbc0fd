#include "audio/capture_device.h"

#include <pi_node/option_check.h>
#include <poll.h>
#include <pthread.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <mutex>
#include <stdexcept>
#include <system_error>
#include <thread>
#include <utility>

namespace pi_speech
{
namespace
{

using Clock = std::chrono::steady_clock;

constexpr double STAMP_SMOOTHING = 0.02;  ///< weight of the newest: of the clocks' drift, a stamp in 50 reads
constexpr double STAMP_JUMP_S = 1.0;  ///< beside the buffer; what is further off has a reason, as a clock that was set
constexpr double MAX_SPEED = 1.01;    ///< of a device's clock against ours; what is faster has none

std::chrono::milliseconds milliseconds(double s)
{
  return std::chrono::milliseconds(std::max(1L, std::lround(std::ceil(1e3 * s))));
}

/// Times of samples: smooths the jitter of the times of reads, and corrects the drift of counted samples.
class SmoothStamps
{
public:
  explicit SmoothStamps(double jump_s) : jump_ns_(std::llround(1e9 * jump_s)) {}

  void reset() { known_ = false; }
  /// @return that of the first of these samples.
  int64_t next(int64_t measured_ns, size_t frames, int rate_hz)
  {
    const int64_t error_ns = measured_ns - next_ns_;
    if (!known_ || std::abs(error_ns) > jump_ns_)
    {
      next_ns_ = measured_ns;
    }
    else
    {
      next_ns_ += std::llround(STAMP_SMOOTHING * static_cast<double>(error_ns));
    }
    known_ = true;
    const int64_t stamp_ns = next_ns_;
    next_ns_ += std::llround(1e9 * static_cast<double>(frames) / rate_hz);
    return stamp_ns;
  }

private:
  const int64_t jump_ns_;
  bool known_ = false;
  int64_t next_ns_ = 0;
};

/// Slows a device without a clock down to its rate. The device may give as much at once as its buffer holds.
class Pace
{
public:
  explicit Pace(double buffer_s) : buffer_(buffer_s) {}

  /// @return how long to wait after this much sound; not above 0: go on.
  double add(double sound_s)
  {
    const Clock::time_point now = Clock::now();
    due_ = std::max(due_, now) +
           std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(sound_s / MAX_SPEED));
    return (std::chrono::duration<double>(due_ - now) - buffer_).count();
  }

private:
  const std::chrono::duration<double> buffer_;
  Clock::time_point due_;
};

}  // namespace

void MicrophoneOptions::validate() const
{
  if (device.empty())
  {
    throw std::invalid_argument("device = \"\", must be a name of ALSA, as default, or a part of the card's name");
  }
  format.validate();
  const pi_node::OptionCheck check("");
  check.range("period_s", period_s, 0.002, 1.0);
  check.range("buffer_s", buffer_s, 2.0 * period_s, 10.0);
  check.range("stall_s", stall_s, 0.05, 60.0);
  check.range("retry_s", retry_s, 0.01, 60.0);
}

class Microphone::Recorder
{
public:
  Recorder(const MicrophoneOptions& options, MicrophoneEvents events)
    : options_(options), events_(std::move(events)), stop_file_(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK))
  {
    if (stop_file_ < 0)
    {
      throw std::system_error(errno, std::generic_category(), "Microphone: eventfd");
    }
    thread_ = std::thread([this] { run(); });
  }
  ~Recorder()
  {
    stop();
    close(stop_file_);
  }

  void stop()
  {
    eventfd_write(stop_file_, 1);
    if (thread_.joinable())
    {
      thread_.join();
    }
  }
  MicrophoneStatus status() const
  {
    std::lock_guard<std::mutex> lock(mutex_);
    return status_;
  }

private:
  void run()
  {
    pthread_setname_np(pthread_self(), "microphone");
    do
    {
      try
      {
        CapturePcm pcm(options_);
        {
          std::lock_guard<std::mutex> lock(mutex_);
          status_.device = pcm.name();
          status_.format = pcm.format();
        }
        record(&pcm);
      }
      catch (const CaptureError& error)
      {
        lose(error.what());
      }
    } while (!stopsWithin(milliseconds(options_.retry_s)));
    std::lock_guard<std::mutex> lock(mutex_);
    status_.recording = false;
    status_.device.clear();
  }

  /// Until stop().
  void record(CapturePcm* pcm)
  {
    std::vector<int16_t> samples(pcm->periodFrames() * static_cast<size_t>(pcm->format().channels));
    SmoothStamps stamps(options_.buffer_s + STAMP_JUMP_S);
    Pace pace(options_.buffer_s);
    MicrophoneSound sound;
    sound.format = pcm->format();
    sound.samples = samples.data();
    sound.gap = true;
    Clock::time_point sound_at = Clock::now();
    const std::chrono::milliseconds stall = milliseconds(options_.stall_s);
    while (true)
    {
      const CapturePcm::Wake wake = pcm->wait(stop_file_, stall);
      if (wake == CapturePcm::Wake::STOP)
      {
        return;
      }
      std::fill(samples.begin(), samples.end(), int16_t{0});  // ALSA's file leaves old sound after its end
      int64_t stamp_ns = 0;
      const CapturePcm::Result result = pcm->read(samples.data(), &sound.count, &stamp_ns);
      if (result == CapturePcm::Result::SOUND)
      {
        sound_at = Clock::now();
        const auto frames = sound.count / static_cast<size_t>(sound.format.channels);
        sound.stamp_ns = stamps.next(stamp_ns, frames, sound.format.sample_rate_hz);
        hand(*pcm, sound);
        sound.gap = false;
        const double wait_s = pace.add(static_cast<double>(frames) / sound.format.sample_rate_hz);
        if (wait_s > 0.0 && stopsWithin(milliseconds(wait_s)))
        {
          return;
        }
        continue;
      }
      if (result == CapturePcm::Result::OVERRUN || result == CapturePcm::Result::SUSPENDED)
      {
        stamps.reset();
        sound.gap = true;
        std::lock_guard<std::mutex> lock(mutex_);
        ++(result == CapturePcm::Result::OVERRUN ? status_.overruns : status_.suspends);
      }
      if (Clock::now() - sound_at >= stall)
      {
        throw CaptureError("device " + pcm->name() + " gives no sound; plug it in again");
      }
      // A device that reports sound but has none must not keep a core busy.
      if (stopsWithin(milliseconds(std::min(options_.period_s, options_.stall_s) / 2.0)))
      {
        return;
      }
    }
  }

  void hand(const CapturePcm& pcm, const MicrophoneSound& sound)
  {
    bool found = false;
    {
      std::lock_guard<std::mutex> lock(mutex_);
      found = !status_.recording;
      status_.recording = true;
      status_.problem.clear();
      status_.samples += sound.count;
    }
    told_ = false;
    if (found && events_.found)
    {
      events_.found(pcm.name(), pcm.format());
    }
    events_.sound(sound);
  }

  void lose(const std::string& problem)
  {
    {
      std::lock_guard<std::mutex> lock(mutex_);
      status_.times_lost += status_.recording ? 1 : 0;
      status_.recording = false;
      status_.device.clear();
      status_.problem = problem;
    }
    if (!std::exchange(told_, true) && events_.lost)
    {
      events_.lost(problem);
    }
  }

  bool stopsWithin(std::chrono::milliseconds time) const
  {
    pollfd file = {stop_file_, POLLIN, 0};
    return poll(&file, 1, static_cast<int>(time.count())) > 0;
  }

  const MicrophoneOptions options_;
  const MicrophoneEvents events_;
  const int stop_file_;  ///< can be read once it is to stop
  bool told_ = false;    ///< of the problem; thread `microphone`
  mutable std::mutex mutex_;
  MicrophoneStatus status_;
  std::thread thread_;
};

Microphone::Microphone(const MicrophoneOptions& options, MicrophoneEvents events)
{
  options.validate();
  if (!events.sound)
  {
    throw std::invalid_argument("Microphone: events.sound is empty, must be a function that takes the sound");
  }
  recorder_ = std::make_unique<Recorder>(options, std::move(events));
}

Microphone::~Microphone() = default;

void Microphone::stop()
{
  recorder_->stop();
}

MicrophoneStatus Microphone::status() const
{
  return recorder_->status();
}

}  // namespace pi_speech
