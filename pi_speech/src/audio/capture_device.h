#pragma once

#include <cstdlib>  // before ALSA, which includes stdlib.h: what C++ adds there has no C linkage

extern "C"
{
#include <alsa/asoundlib.h>  // declares snd_lib_error_set_local outside of its own extern "C"
}

#include "audio/microphone.h"

#include <chrono>
#include <cstdint>
#include <stdexcept>
#include <string>

namespace pi_speech
{

/// An error of ALSA. The text has the way out.
class CaptureError : public std::runtime_error
{
public:
  using std::runtime_error::runtime_error;
};

/// A PCM of ALSA, open and started. Not thread safe; no call blocks.
class CapturePcm
{
public:
  /// @throws CaptureError
  explicit CapturePcm(const MicrophoneOptions& options);
  ~CapturePcm();
  CapturePcm(const CapturePcm&) = delete;
  CapturePcm& operator=(const CapturePcm&) = delete;

  const std::string& name() const { return name_; }
  const AudioFormat& format() const { return format_; }
  size_t periodFrames() const { return period_frames_; }

  enum class Wake
  {
    DEVICE,   ///< has sound, or something is wrong
    STOP,     ///< stop_file can be read
    NOTHING,  ///< for as long
  };
  /// @param stop_file  file descriptor.
  Wake wait(int stop_file, std::chrono::milliseconds timeout);

  enum class Result
  {
    SOUND,
    NOTHING,    ///< yet
    OVERRUN,    ///< goes on, sound was lost
    SUSPENDED,  ///< the computer slept; goes on, sound was lost
    SLEEPING,   ///< the computer sleeps: try again
  };
  /// @param samples    room for a period.
  /// @param[out] count     samples that came.
  /// @param[out] stamp_ns  of the first, by the system's clock.
  /// @throws CaptureError if the device is gone.
  Result read(int16_t* samples, size_t* count, int64_t* stamp_ns);

private:
  int open(const std::string& name);
  void negotiate(const MicrophoneOptions& options);
  void require(int result, const char* what) const;
  void start();
  int64_t firstSampleTime();

  snd_pcm_t* pcm_ = nullptr;
  std::string name_;
  AudioFormat format_;
  size_t period_frames_ = 0;
};

}  // namespace pi_speech
