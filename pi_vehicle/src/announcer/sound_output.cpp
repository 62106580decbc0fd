#include <cstdlib>  // before ALSA, which includes stdlib.h: what C++ adds there has no C linkage

extern "C"
{
#include <alsa/asoundlib.h>  // declares snd_lib_error_set_local outside of its own extern "C"
}

#include <algorithm>
#include <cerrno>
#include <cstdarg>
#include <memory>
#include <stdexcept>

#include "announcer/sound_output.h"

namespace pi_vehicle
{
namespace
{

constexpr unsigned LATENCY_US = 200000;
constexpr size_t CHUNK = 1024;  // samples
constexpr int STALL_MS = 1000;

/// ALSA writes to stderr what it thinks of every try; on this thread it does not, while there is one of these.
class QuietAlsa
{
public:
  QuietAlsa() : before_(snd_lib_error_set_local(&QuietAlsa::ignore)) {}
  ~QuietAlsa() { snd_lib_error_set_local(before_); }
  QuietAlsa(const QuietAlsa&) = delete;
  QuietAlsa& operator=(const QuietAlsa&) = delete;

private:
  static void ignore(const char*, int, const char*, int, const char*, va_list) {}
  const snd_local_error_handler_t before_;
};

void require(long result, const std::string& device, const char* what)
{
  if (result < 0)
  {
    throw std::runtime_error("sound device \"" + device + "\" " + what + ": " + snd_strerror(static_cast<int>(result)) +
                             "; set parameter device to one that aplay -L lists");
  }
}

}  // namespace

void playSound(const std::string& device, int sample_rate, const std::vector<int16_t>& samples,
               const std::atomic<bool>& stop)
{
  const QuietAlsa quiet;
  snd_pcm_t* opened = nullptr;
  require(snd_pcm_open(&opened, device.c_str(), SND_PCM_STREAM_PLAYBACK, SND_PCM_NONBLOCK), device, "cannot be opened");
  const std::unique_ptr<snd_pcm_t, int (*)(snd_pcm_t*)> pcm(opened, snd_pcm_close);
  require(snd_pcm_set_params(pcm.get(), SND_PCM_FORMAT_S16_LE, SND_PCM_ACCESS_RW_INTERLEAVED, 1,
                             static_cast<unsigned>(sample_rate), 1, LATENCY_US),
          device, "does not take our samples");
  // Silence as long as its buffer: once that was taken, all before it was heard.
  std::vector<int16_t> all = samples;
  all.resize(all.size() + static_cast<size_t>(1e-6 * LATENCY_US * sample_rate));
  for (size_t done = 0; done < all.size() && !stop;)
  {
    const snd_pcm_sframes_t taken = snd_pcm_writei(pcm.get(), &all[done], std::min(CHUNK, all.size() - done));
    if (taken >= 0)
    {
      done += static_cast<size_t>(taken);
    }
    else if (taken == -EAGAIN)
    {
      const int ready = snd_pcm_wait(pcm.get(), STALL_MS);
      require(ready == 0 ? -ETIMEDOUT : ready == -EPIPE ? 0 : ready, device, "takes no sound");
    }
    else
    {
      require(snd_pcm_recover(pcm.get(), static_cast<int>(taken), 1), device, "takes no sound");
    }
  }
  snd_pcm_drop(pcm.get());
}

}  // namespace pi_vehicle
