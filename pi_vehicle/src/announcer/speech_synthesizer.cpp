#include "announcer/speech_synthesizer.h"

#include <dlfcn.h>
#include <espeak-ng/speak_lib.h>

#include <algorithm>
#include <clocale>
#include <cmath>
#include <stdexcept>

namespace pi_vehicle
{
namespace
{

constexpr char LIBRARY[] = "libespeak-ng.so.1";
constexpr double HORN_HZ[] = {420.0, 510.0};
constexpr double HORN_LEVEL = 0.4;  // of full scale, each tone
constexpr double RAMP_S = 0.01;     // no clicks

template <typename Function>
Function symbol(void* library, const char* name)
{
  void* address = dlsym(library, name);
  if (address == nullptr)
  {
    throw std::runtime_error(std::string(LIBRARY) + " has no " + name + "; install Debian's libespeak-ng1");
  }
  return reinterpret_cast<Function>(address);
}

int collect(short* samples, int count, espeak_EVENT* events)
{
  if (samples != nullptr && count > 0 && events != nullptr)
  {
    auto* sound = static_cast<std::vector<int16_t>*>(events->user_data);
    sound->insert(sound->end(), samples, samples + count);
  }
  return 0;
}

}  // namespace

SpeechSynthesizer::SpeechSynthesizer(const std::string& voice, int words_per_minute)
{
  void* library = dlopen(LIBRARY, RTLD_NOW | RTLD_LOCAL);  // stays: it cannot be unloaded safely
  if (library == nullptr)
  {
    throw std::runtime_error(std::string(LIBRARY) + " cannot be loaded; install libespeak-ng1");
  }
  const auto initialize = symbol<decltype(&espeak_Initialize)>(library, "espeak_Initialize");
  const auto set_voice = symbol<decltype(&espeak_SetVoiceByName)>(library, "espeak_SetVoiceByName");
  const auto set_parameter = symbol<decltype(&espeak_SetParameter)>(library, "espeak_SetParameter");
  const auto set_callback = symbol<decltype(&espeak_SetSynthCallback)>(library, "espeak_SetSynthCallback");
  synthesize_ = reinterpret_cast<void*>(symbol<decltype(&espeak_Synth)>(library, "espeak_Synth"));
  // It sets the locale of the process, which is not its own.
  const char* locale = setlocale(LC_CTYPE, nullptr);
  const std::string locale_before = locale != nullptr ? locale : "C";
  sample_rate_ = initialize(AUDIO_OUTPUT_SYNCHRONOUS, 0, nullptr, espeakINITIALIZE_DONT_EXIT);
  setlocale(LC_CTYPE, locale_before.c_str());
  if (sample_rate_ <= 0)
  {
    throw std::runtime_error("espeak-ng does not find its data; install espeak-ng-data");
  }
  if (set_voice(voice.c_str()) != EE_OK)
  {
    throw std::runtime_error("espeak-ng has no voice \"" + voice + "\"; try en-us");
  }
  set_parameter(espeakRATE, words_per_minute, 0);
  set_callback(collect);
}

std::vector<int16_t> SpeechSynthesizer::speak(const std::string& text) const
{
  std::vector<int16_t> sound;
  const auto synthesize = reinterpret_cast<decltype(&espeak_Synth)>(synthesize_);
  synthesize(text.c_str(), text.size() + 1, 0, POS_CHARACTER, 0, espeakCHARS_UTF8, nullptr, &sound);
  return sound;
}

std::vector<int16_t> hornSound(int sample_rate, double duration_s)
{
  std::vector<int16_t> sound(static_cast<size_t>(std::lround(sample_rate * duration_s)));
  for (size_t i = 0; i < sound.size(); ++i)
  {
    const double t = static_cast<double>(i) / sample_rate;
    const double ramp = std::min({1.0, t / RAMP_S, (duration_s - t) / RAMP_S});
    double value = 0.0;
    for (const double frequency : HORN_HZ)
    {
      value += HORN_LEVEL * std::sin(2.0 * M_PI * frequency * t);
    }
    sound[i] = static_cast<int16_t>(std::lround(32767.0 * ramp * value));
  }
  return sound;
}

}  // namespace pi_vehicle
