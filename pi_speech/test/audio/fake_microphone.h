#pragma once

#include <cstdint>
#include <string>
#include <vector>

/// A sound card of this process, behind ALSA's own interface for them: what is recorded, and what goes wrong, is said
/// by the test. Thread safe.
namespace pi_speech::fake_microphone
{

struct Abilities
{
  std::vector<unsigned> rates = {16000};
  std::vector<unsigned> channels = {1};
  bool sixteen_bits = true;  ///< false: 32
};

/// Plugged in, with nothing recorded.
void plugIn(const Abilities& abilities);
/// Opening it fails, and so does what is open.
void unplug();
/// Opening it fails so (as EBUSY); 0: no more.
void refuse(int error);
/// As if it had recorded these just now. It is started.
void record(const std::vector<int16_t>& samples);
/// Nobody took the sound in time.
void overrun();
/// The computer slept.
void suspend();

/// Waits until it is open and started, and after what went wrong started again. @return false if that takes too long.
bool waitUntilStarted();
bool isOpen();

/// Of ALSA, with which device "fake" is this card. @param library  path of the one in which this is.
std::string configuration(const std::string& library);

}  // namespace pi_speech::fake_microphone
