#include "audio/capture_device.h"

#include <poll.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cmath>
#include <cstdarg>
#include <cstdlib>
#include <vector>

namespace pi_speech
{
namespace
{

/// Keeps ALSA from writing to stderr on this thread, as long as the object lives.
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

std::string lower(std::string text)
{
  std::transform(text.begin(), text.end(), text.begin(), [](unsigned char c) { return std::tolower(c); });
  return text;
}

/// @return "" if there is none.
std::string cardName(int card)
{
  char* text = nullptr;
  if (snd_card_get_name(card, &text) < 0 || text == nullptr)
  {
    return "";
  }
  std::string name = text;
  std::free(text);
  return name;
}

/// The name under which ALSA converts the samples.
std::string withConversion(const std::string& name)
{
  return name.rfind("hw:", 0) == 0 ? "plug" + name : "plug:'" + name + "'";
}

bool givesOurSamples(snd_pcm_t* pcm)
{
  snd_pcm_hw_params_t* params = nullptr;
  snd_pcm_hw_params_alloca(&params);
  return snd_pcm_hw_params_any(pcm, params) >= 0 &&
         snd_pcm_hw_params_test_format(pcm, params, SND_PCM_FORMAT_S16_LE) == 0;
}

void addDevices(int card, std::vector<CaptureDevice>* devices)
{
  snd_ctl_t* control = nullptr;
  if (snd_ctl_open(&control, ("hw:" + std::to_string(card)).c_str(), SND_CTL_NONBLOCK) < 0)
  {
    return;
  }
  snd_pcm_info_t* info = nullptr;
  snd_pcm_info_alloca(&info);
  for (int device = -1; snd_ctl_pcm_next_device(control, &device) >= 0 && device >= 0;)
  {
    snd_pcm_info_set_device(info, static_cast<unsigned>(device));
    snd_pcm_info_set_subdevice(info, 0);
    snd_pcm_info_set_stream(info, SND_PCM_STREAM_CAPTURE);
    if (snd_ctl_pcm_info(control, info) >= 0)
    {
      devices->push_back(
          {"hw:" + std::to_string(card) + "," + std::to_string(device), cardName(card), snd_pcm_info_get_name(info)});
    }
  }
  snd_ctl_close(control);
}

}  // namespace

std::vector<CaptureDevice> captureDevices()
{
  const QuietAlsa quiet;
  std::vector<CaptureDevice> devices;
  for (int card = -1; snd_card_next(&card) >= 0 && card >= 0;)
  {
    addDevices(card, &devices);
  }
  return devices;
}

std::optional<CaptureDevice> findCaptureDevice(const std::vector<CaptureDevice>& devices, const std::string& part)
{
  const std::string wanted = lower(part);
  const auto found = std::find_if(devices.begin(), devices.end(),
                                  [&wanted](const CaptureDevice& device)
                                  {
                                    return lower(device.card).find(wanted) != std::string::npos ||
                                           lower(device.description).find(wanted) != std::string::npos;
                                  });
  return found == devices.end() || part.empty() ? std::nullopt : std::make_optional(*found);
}

std::string listCaptureDevices(const std::vector<CaptureDevice>& devices)
{
  if (devices.empty())
  {
    return "there is none that records; is the microphone plugged in?";
  }
  std::string text;
  for (const CaptureDevice& device : devices)
  {
    text += (text.empty() ? "there are: " : "; ") + device.name + " (" + device.card + ", " + device.description + ")";
  }
  return text;
}

CapturePcm::CapturePcm(const MicrophoneOptions& options)
{
  const QuietAlsa quiet;
  snd_config_update_free_global();  // else a device that was defined or plugged in since the last try is not seen
  int result = open(options.device);
  if (result == -ENOENT || result == -ENODEV || result == -ENXIO)
  {
    const std::vector<CaptureDevice> devices = captureDevices();
    const std::optional<CaptureDevice> device = findCaptureDevice(devices, options.device);
    if (!device)
    {
      throw CaptureError("no device " + options.device + "; " + listCaptureDevices(devices));
    }
    result = open(device->name);
    if (result >= 0 && !givesOurSamples(pcm_))
    {
      snd_pcm_close(pcm_);
      result = open(withConversion(device->name));
    }
  }
  if (result < 0)
  {
    throw CaptureError("device " + name_ + " cannot be opened: " +
                       (result == -EBUSY ? "another program records from it; end that one, or share it as \"default\""
                        : result == -EACCES ? "permission denied; add the user to the group audio"
                                            : snd_strerror(result)));
  }
  try
  {
    negotiate(options);
    start();
  }
  catch (const CaptureError&)
  {
    snd_pcm_close(pcm_);
    throw;
  }
}

CapturePcm::~CapturePcm()
{
  const QuietAlsa quiet;
  snd_pcm_drop(pcm_);
  snd_pcm_close(pcm_);
}

int CapturePcm::open(const std::string& name)
{
  name_ = name;
  return snd_pcm_open(&pcm_, name.c_str(), SND_PCM_STREAM_CAPTURE, SND_PCM_NONBLOCK);
}

void CapturePcm::require(int result, const char* what) const
{
  if (result < 0)
  {
    throw CaptureError("device " + name_ + " " + what + ": " + snd_strerror(result));
  }
}

void CapturePcm::negotiate(const MicrophoneOptions& options)
{
  snd_pcm_hw_params_t* params = nullptr;
  snd_pcm_hw_params_alloca(&params);
  require(snd_pcm_hw_params_any(pcm_, params), "cannot be set up");
  snd_pcm_hw_params_set_rate_resample(pcm_, params, 0);  // the card's own rate: Resampler is better than ALSA's
  require(snd_pcm_hw_params_set_access(pcm_, params, SND_PCM_ACCESS_RW_INTERLEAVED), "gives no interleaved samples");
  if (snd_pcm_hw_params_set_format(pcm_, params, SND_PCM_FORMAT_S16_LE) < 0)
  {
    throw CaptureError("device " + name_ + " gives no samples of signed 16 bit; give device as " +
                       withConversion(name_) + ", with which ALSA converts them");
  }
  auto channels = static_cast<unsigned>(options.format.channels);
  require(snd_pcm_hw_params_set_channels_near(pcm_, params, &channels), "cannot set the number of channels");

  // The next rate above keeps all of the sound; below it only if there is no other.
  auto rate = static_cast<unsigned>(options.format.sample_rate_hz);
  unsigned least = rate;
  int direction = 0;
  snd_pcm_hw_params_set_rate_min(pcm_, params, &least, &direction);
  require(snd_pcm_hw_params_set_rate_near(pcm_, params, &rate, nullptr), "cannot set the rate");
  format_ = AudioFormat{static_cast<int>(rate), static_cast<int>(channels)};
  try
  {
    format_.validate();
  }
  catch (const std::invalid_argument& error)
  {
    throw CaptureError("device " + name_ + ": " + error.what());
  }

  snd_pcm_uframes_t period = static_cast<snd_pcm_uframes_t>(std::lround(options.period_s * rate));
  require(snd_pcm_hw_params_set_period_size_near(pcm_, params, &period, nullptr), "cannot set the period");
  auto buffer = static_cast<snd_pcm_uframes_t>(std::lround(options.buffer_s * rate));
  require(snd_pcm_hw_params_set_buffer_size_near(pcm_, params, &buffer), "cannot set the buffer");
  require(snd_pcm_hw_params(pcm_, params), "cannot be set up");
  period_frames_ = static_cast<size_t>(period);

  snd_pcm_sw_params_t* software = nullptr;
  snd_pcm_sw_params_alloca(&software);
  require(snd_pcm_sw_params_current(pcm_, software), "cannot be set up");
  require(snd_pcm_sw_params_set_avail_min(pcm_, software, period), "cannot set the period");
  // Those that cannot are stamped when they are read.
  snd_pcm_sw_params_set_tstamp_mode(pcm_, software, SND_PCM_TSTAMP_ENABLE);
  snd_pcm_sw_params_set_tstamp_type(pcm_, software, SND_PCM_TSTAMP_TYPE_GETTIMEOFDAY);
  require(snd_pcm_sw_params(pcm_, software), "cannot be set up");
}

void CapturePcm::start()
{
  require(snd_pcm_prepare(pcm_), "cannot be started");
  require(snd_pcm_start(pcm_), "cannot be started");
}

CapturePcm::Wake CapturePcm::wait(int stop_file, std::chrono::milliseconds timeout)
{
  const QuietAlsa quiet;
  const int count = snd_pcm_poll_descriptors_count(pcm_);
  require(count, "cannot be waited for");
  std::vector<pollfd> files(static_cast<size_t>(count) + 1);
  require(snd_pcm_poll_descriptors(pcm_, files.data(), static_cast<unsigned>(count)), "cannot be waited for");
  files.back() = {stop_file, POLLIN, 0};
  if (poll(files.data(), files.size(), static_cast<int>(timeout.count())) <= 0)
  {
    return Wake::NOTHING;  // a signal as well
  }
  if (files.back().revents != 0)
  {
    return Wake::STOP;
  }
  unsigned short events = 0;
  require(snd_pcm_poll_descriptors_revents(pcm_, files.data(), static_cast<unsigned>(count), &events), "is gone");
  return events != 0 ? Wake::DEVICE : Wake::NOTHING;
}

int64_t CapturePcm::firstSampleTime()
{
  using std::chrono::nanoseconds;
  const auto now = std::chrono::duration_cast<nanoseconds>(std::chrono::system_clock::now().time_since_epoch()).count();
  snd_pcm_status_t* status = nullptr;
  snd_pcm_status_alloca(&status);
  if (snd_pcm_status(pcm_, status) < 0)
  {
    return now;
  }
  snd_htimestamp_t stamp = {};
  snd_pcm_status_get_htstamp(status, &stamp);
  int64_t seen = stamp.tv_sec * int64_t{1000000000} + stamp.tv_nsec;
  if (std::abs(now - seen) > 1000000000)
  {
    seen = now;  // no stamp, or of another clock
  }
  const auto frames = static_cast<double>(std::max<snd_pcm_sframes_t>(0, snd_pcm_status_get_delay(status)));
  const auto waiting = static_cast<double>(snd_pcm_status_get_avail(status));
  return seen - std::llround(1e9 * std::max(frames, waiting) / format_.sample_rate_hz);
}

CapturePcm::Result CapturePcm::read(int16_t* samples, size_t* count, int64_t* stamp_ns)
{
  const QuietAlsa quiet;
  *count = 0;
  *stamp_ns = firstSampleTime();
  const snd_pcm_sframes_t frames = snd_pcm_readi(pcm_, samples, period_frames_);
  if (frames > 0)
  {
    *count = static_cast<size_t>(frames) * static_cast<size_t>(format_.channels);
    return Result::SOUND;
  }
  switch (frames)
  {
    case 0:
    case -EAGAIN:
    case -EINTR:
      return Result::NOTHING;
    case -EPIPE:
      start();
      return Result::OVERRUN;
    case -ESTRPIPE:
      if (const int resumed = snd_pcm_resume(pcm_); resumed == -EAGAIN)
      {
        return Result::SLEEPING;
      }
      else if (resumed < 0)
      {
        start();  // many cards cannot resume, and begin anew
      }
      return Result::SUSPENDED;
    default:
      throw CaptureError("device " + name_ + " is gone (" + snd_strerror(static_cast<int>(frames)) +
                         "); plug it in again");
  }
}

}  // namespace pi_speech
