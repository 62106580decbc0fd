#pragma once

#include <pi_node/ros/warning_board.h>
#include <pi_node/vehicle_clock.h>

#include <mutex>
#include <optional>
#include <string>
#include <utility>

#include "audio/sound_check.h"

namespace pi_speech
{

/// A SoundCheck that turns changes for the worse into warnings. Thread safe.
class SoundWatch
{
public:
  struct Figures
  {
    SoundChange last;  ///< change
    double level_dbfs = 0.0;
    double clipped_share = 0.0;
  };

  /// @param prefix  of the warnings. @param warnings  outlives it.
  SoundWatch(const SoundCheckOptions& options, std::string prefix, pi_node::WarningBoard* warnings)
    : options_(options)
    , prefix_(std::move(prefix))
    , warnings_(warnings)
    , check_(std::in_place, options, pi_node::vehicleNs())
  {
  }

  /// Forgets all, because another stream begins.
  void restart()
  {
    std::lock_guard<std::mutex> lock(mutex_);
    check_.emplace(options_, pi_node::vehicleNs());
    last_ = SoundChange();
  }
  void add(const AudioFormat& format, const int16_t* samples, size_t count)
  {
    std::unique_lock<std::mutex> lock(mutex_);
    tell(check_->add(format, samples, count, pi_node::vehicleNs()), &lock);
  }
  /// Looks whether sound stays away.
  void look()
  {
    std::unique_lock<std::mutex> lock(mutex_);
    tell(check_->look(pi_node::vehicleNs()), &lock);
  }
  Figures figures() const
  {
    std::lock_guard<std::mutex> lock(mutex_);
    return {last_, check_->levelDbfs(), check_->clippedShare()};
  }

private:
  void tell(const std::optional<SoundChange>& change, std::unique_lock<std::mutex>* lock)
  {
    if (change)
    {
      last_ = *change;
      lock->unlock();
      if (change->state != SoundState::GOOD)
      {
        warnings_->warn(prefix_ + change->text);
      }
    }
  }

  const SoundCheckOptions options_;
  const std::string prefix_;
  pi_node::WarningBoard* const warnings_;
  mutable std::mutex mutex_;         ///< of all below
  std::optional<SoundCheck> check_;  ///< never empty
  SoundChange last_;
};

}  // namespace pi_speech
