#include "audio/fake_microphone.h"

#define PIC  // for ALSA's headers: this becomes a library of its own
#include <alsa/asoundlib.h>
#include <alsa/pcm_external.h>
#include <alsa/pcm_ioplug.h>
#include <sys/eventfd.h>

#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <mutex>

namespace pi_speech::fake_microphone
{
namespace
{

struct Card
{
  std::mutex mutex;
  Abilities abilities;
  bool plugged = false;
  int refused = 0;
  bool overrun = false;
  bool suspended = false;
  std::deque<int16_t> waiting;
  size_t position = 0;  ///< frames that were recorded, of all time
  snd_pcm_ioplug_t* pcm = nullptr;
  bool started = false;
  std::condition_variable changed;
  const int wake = eventfd(0, EFD_NONBLOCK);
};

Card& card()
{
  static Card card;
  return card;
}

void wake()
{
  eventfd_write(card().wake, 1);
}

// ------------------------------------------------------------------------------------------------- called by ALSA

int start(snd_pcm_ioplug_t* /*pcm*/)
{
  std::lock_guard<std::mutex> lock(card().mutex);
  card().started = true;
  card().changed.notify_all();
  return 0;
}

int stop(snd_pcm_ioplug_t* /*pcm*/)
{
  return 0;
}

int prepare(snd_pcm_ioplug_t* /*pcm*/)
{
  std::lock_guard<std::mutex> lock(card().mutex);
  if (!card().plugged)
  {
    return -ENODEV;
  }
  card().position = card().waiting.size() / card().pcm->channels;
  return 0;
}

snd_pcm_sframes_t pointer(snd_pcm_ioplug_t* pcm)
{
  std::lock_guard<std::mutex> lock(card().mutex);
  if (!card().plugged)
  {
    snd_pcm_ioplug_set_state(pcm, SND_PCM_STATE_DISCONNECTED);
    return -ENODEV;
  }
  if (card().suspended)
  {
    card().suspended = false;
    snd_pcm_ioplug_set_state(pcm, SND_PCM_STATE_SUSPENDED);
  }
  if (card().overrun)
  {
    card().overrun = false;
    return -EPIPE;
  }
  return static_cast<snd_pcm_sframes_t>(card().position % pcm->buffer_size);
}

snd_pcm_sframes_t transfer(snd_pcm_ioplug_t* pcm, const snd_pcm_channel_area_t* areas, snd_pcm_uframes_t offset,
                           snd_pcm_uframes_t frames)
{
  std::lock_guard<std::mutex> lock(card().mutex);
  auto* out =
      static_cast<int16_t*>(areas[0].addr) + (areas[0].first / 8 + areas[0].step / 8 * offset) / sizeof(int16_t);
  for (snd_pcm_uframes_t i = 0; i < frames * pcm->channels && !card().waiting.empty(); ++i)
  {
    out[i] = card().waiting.front();
    card().waiting.pop_front();
  }
  if (card().waiting.empty())
  {
    eventfd_t ignored = 0;
    eventfd_read(card().wake, &ignored);
  }
  return static_cast<snd_pcm_sframes_t>(frames);
}

int resume(snd_pcm_ioplug_t* pcm)
{
  std::lock_guard<std::mutex> lock(card().mutex);
  snd_pcm_ioplug_set_state(pcm, SND_PCM_STATE_RUNNING);
  card().started = true;
  card().changed.notify_all();
  return 0;
}

int closeCard(snd_pcm_ioplug_t* pcm)
{
  std::lock_guard<std::mutex> lock(card().mutex);
  card().pcm = nullptr;
  card().started = false;
  delete pcm;
  return 0;
}

const snd_pcm_ioplug_callback_t& callbacks()
{
  static const snd_pcm_ioplug_callback_t callbacks = []
  {
    snd_pcm_ioplug_callback_t table = {};
    table.start = start;
    table.stop = stop;
    table.prepare = prepare;
    table.pointer = pointer;
    table.transfer = transfer;
    table.resume = resume;
    table.close = closeCard;
    return table;
  }();
  return callbacks;
}

int openCard(snd_pcm_t** pcm, const char* name, snd_pcm_stream_t stream, int mode)
{
  std::lock_guard<std::mutex> lock(card().mutex);
  if (card().refused != 0)
  {
    return -card().refused;
  }
  if (!card().plugged || stream != SND_PCM_STREAM_CAPTURE)
  {
    return -ENODEV;
  }
  auto* io = new snd_pcm_ioplug_t();
  io->version = SND_PCM_IOPLUG_VERSION;
  io->name = "fake microphone";
  io->callback = &callbacks();
  io->poll_fd = card().wake;
  io->poll_events = POLLIN;
  if (const int error = snd_pcm_ioplug_create(io, name, stream, mode); error < 0)
  {
    delete io;
    return error;
  }
  const auto list = [io](int kind, const std::vector<unsigned>& values)
  { snd_pcm_ioplug_set_param_list(io, kind, static_cast<unsigned>(values.size()), values.data()); };
  const Abilities& abilities = card().abilities;
  list(SND_PCM_IOPLUG_HW_ACCESS, {SND_PCM_ACCESS_RW_INTERLEAVED});
  list(SND_PCM_IOPLUG_HW_FORMAT,
       {static_cast<unsigned>(abilities.sixteen_bits ? SND_PCM_FORMAT_S16_LE : SND_PCM_FORMAT_S32_LE)});
  list(SND_PCM_IOPLUG_HW_RATE, abilities.rates);
  list(SND_PCM_IOPLUG_HW_CHANNELS, abilities.channels);
  snd_pcm_ioplug_set_param_minmax(io, SND_PCM_IOPLUG_HW_PERIOD_BYTES, 16, 1 << 20);
  snd_pcm_ioplug_set_param_minmax(io, SND_PCM_IOPLUG_HW_BUFFER_BYTES, 32, 1 << 22);
  card().pcm = io;
  *pcm = io->pcm;
  return 0;
}

}  // namespace

void plugIn(const Abilities& abilities)
{
  std::lock_guard<std::mutex> lock(card().mutex);
  card().abilities = abilities;
  card().waiting.clear();
  card().overrun = false;
  card().suspended = false;
  card().plugged = true;
}

void unplug()
{
  std::lock_guard<std::mutex> lock(card().mutex);
  card().plugged = false;
  card().started = false;
  wake();
}

void refuse(int error)
{
  std::lock_guard<std::mutex> lock(card().mutex);
  card().refused = error;
}

void record(const std::vector<int16_t>& samples)
{
  std::lock_guard<std::mutex> lock(card().mutex);
  card().waiting.insert(card().waiting.end(), samples.begin(), samples.end());
  card().position += samples.size() / card().pcm->channels;
  wake();
}

void overrun()
{
  std::lock_guard<std::mutex> lock(card().mutex);
  card().overrun = true;
  card().started = false;
  card().waiting.clear();
  wake();
}

void suspend()
{
  std::lock_guard<std::mutex> lock(card().mutex);
  card().suspended = true;
  card().started = false;
  wake();
}

bool waitUntilStarted()
{
  std::unique_lock<std::mutex> lock(card().mutex);
  return card().changed.wait_for(lock, std::chrono::seconds(20), [] { return card().started; });
}

bool isOpen()
{
  std::lock_guard<std::mutex> lock(card().mutex);
  return card().pcm != nullptr;
}

std::string configuration(const std::string& library)
{
  return "pcm_type.pi_speech_fake { lib \"" + library +
         "\" }\n"
         "pcm.fake { type pi_speech_fake }\n";
}

}  // namespace pi_speech::fake_microphone

extern "C"
{
  SND_PCM_PLUGIN_DEFINE_FUNC(pi_speech_fake)
  {
    (void)root;
    (void)conf;
    return pi_speech::fake_microphone::openCard(pcmp, name, stream, mode);
  }
  SND_PCM_PLUGIN_SYMBOL(pi_speech_fake)
}
