#pragma once

#include <pi_speech/audio.h>

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace pi_speech
{

/// A device of a sound card that records.
struct CaptureDevice
{
  std::string name;         ///< as ALSA opens it: "hw:1,0"
  std::string card;         ///< "USB PnP Sound Device"
  std::string description;  ///< of the device on the card: "USB Audio"
};

/// All devices that record, in the order of their cards. Never throws.
std::vector<CaptureDevice> captureDevices();

/// The first device with this text in card or description, in upper or lower case.
std::optional<CaptureDevice> findCaptureDevice(const std::vector<CaptureDevice>& devices, const std::string& part);

/// "there are: hw:1,0 (USB PnP Sound Device, USB Audio)", or that there is none.
std::string listCaptureDevices(const std::vector<CaptureDevice>& devices);

struct MicrophoneOptions
{
  std::string device = "default";  ///< name of ALSA, or a part of the card's name
  AudioFormat format;              ///< wanted; the card gives the closest that it can
  double period_s = 0.02;          ///< of sound at a time [s], in [0.002, 1]
  double buffer_s = 0.5;           ///< size of ALSA's buffer [s], in [2 periods, 10]
  double stall_s = 2.0;            ///< without a sample until the device counts as lost [s], in [0.05, 60]
  double retry_s = 1.0;            ///< between tries to open it [s], in [0.01, 60]

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// Recorded sound, at most one period. Valid during the call.
struct MicrophoneSound
{
  AudioFormat format;
  const int16_t* samples = nullptr;  ///< interleaved
  size_t count = 0;                  ///< a multiple of the number of channels, not 0
  int64_t stamp_ns = 0;              ///< when the first sample was recorded, by the system's clock
  bool gap = false;                  ///< some were lost before it, or it is the first
};

/// Callbacks on the thread `microphone`. They must not throw.
struct MicrophoneEvents
{
  std::function<void(const MicrophoneSound&)> sound;  ///< may block up to buffer_s; later ones are lost then
  /// Called before the first sound, and before the first sound after lost().
  std::function<void(const std::string& device, const AudioFormat& format)> found;  ///< may be empty
  /// Called once when the device cannot be opened or is lost, with the reason and the way out.
  std::function<void(const std::string& problem)> lost;  ///< may be empty
};

struct MicrophoneStatus
{
  bool recording = false;   ///< sound comes
  std::string device;       ///< as ALSA opened it; empty: none is open
  AudioFormat format;       ///< that of the device, once it was open
  std::string problem;      ///< of the last try; empty while sound comes
  uint64_t samples = 0;     ///< that came, of all channels
  uint64_t overruns = 0;    ///< times that sound was lost, as nobody took it in time
  uint64_t suspends = 0;    ///< times that the computer slept
  uint64_t times_lost = 0;  ///< that the device was gone after it had given sound
};

/// Records from a device of ALSA on its own thread. If the device is missing or lost, it is tried again until it is
/// back. Stamps follow the device's clock smoothly, and jump where sound was lost. Devices without a clock, such as
/// ALSA's null and file, are slowed down to their rate.
class Microphone
{
public:
  /// Begins to record. @throws std::invalid_argument for wrong options or without events.sound.
  Microphone(const MicrophoneOptions& options, MicrophoneEvents events);
  /// As stop().
  ~Microphone();
  Microphone(const Microphone&) = delete;
  Microphone& operator=(const Microphone&) = delete;

  /// Returns after the last callback. Must not be called by a callback.
  void stop();
  /// Any thread.
  MicrophoneStatus status() const;

private:
  class Recorder;
  std::unique_ptr<Recorder> recorder_;
};

}  // namespace pi_speech
