#include <fcntl.h>
#include <pi_node/option_check.h>
#include <pi_speech/audio.h>
#include <samplerate.h>
#include <sndfile.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <numeric>
#include <stdexcept>
#include <utility>

namespace pi_speech
{
namespace
{

constexpr size_t PIECE = SAMPLE_RATE_HZ / 100;
constexpr double WITHIN_DB = 25.0;
constexpr double ABOVE_NOISE_DB = 6.0;
constexpr size_t BLOCK_FRAMES = 8192;  ///< worked on at a time: bounds the memory beside the result

int16_t toSample(float value)
{
  const float scaled = value * FULL_SCALE;
  if (!(scaled > -FULL_SCALE))  // also what is no number
  {
    return std::isnan(scaled) ? int16_t{0} : int16_t{-32768};
  }
  return static_cast<int16_t>(std::lrint(std::min(scaled, FULL_SCALE - 1.0F)));
}

[[noreturn]] void fail(const std::string& path, const std::string& reason)
{
  throw std::runtime_error("sound file " + path + ": " + reason);
}

bool endsInRaw(const std::string& path)
{
  const size_t dot = path.rfind('.');
  std::string end = dot == std::string::npos ? "" : path.substr(dot);
  std::transform(end.begin(), end.end(), end.begin(), [](unsigned char c) { return std::tolower(c); });
  return end == ".raw";
}

/// An open sound file.
class SoundFile
{
public:
  explicit SoundFile(const std::string& path) : path_(path)
  {
    // Without blocking: a pipe by that name would wait for its other end.
    const int file = open(path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC);
    if (file < 0)
    {
      fail(path, std::string("cannot be opened: ") + std::strerror(errno));
    }
    struct stat facts = {};
    const bool known = fstat(file, &facts) == 0;
    std::string problem;
    if (!known || !S_ISREG(facts.st_mode))
    {
      problem = known && S_ISDIR(facts.st_mode) ? "is a folder; name a file in it" : "is no regular file";
    }
    else if (facts.st_size == 0)
    {
      problem = "is empty, it has 0 bytes; record it again";
    }
    else if (endsInRaw(path))
    {
      info_.samplerate = SAMPLE_RATE_HZ;
      info_.channels = 1;
      info_.format = SF_FORMAT_RAW | SF_FORMAT_PCM_16 | SF_ENDIAN_LITTLE;
      if (facts.st_size % 2 != 0)
      {
        problem =
            "is damaged: it has " + std::to_string(facts.st_size) + " bytes, but .raw holds samples of 2 bytes each";
      }
    }
    else
    {
      problem = missingData(file, facts.st_size);
    }
    if (!problem.empty())
    {
      close(file);
      fail(path, problem);
    }
    file_ = sf_open_fd(file, SFM_READ, &info_, SF_TRUE);  // closes it, also when it fails
    if (file_ == nullptr)
    {
      fail(path, std::string("is no sound that can be read: ") + sf_strerror(nullptr) +
                     "; give it as WAV or FLAC, or as .raw if it has samples only");
    }
  }
  ~SoundFile() { sf_close(file_); }
  SoundFile(const SoundFile&) = delete;
  SoundFile& operator=(const SoundFile&) = delete;

  const SF_INFO& info() const { return info_; }

  /// @return number of frames; 0 at the end.
  size_t read(std::vector<float>* values)
  {
    values->resize(BLOCK_FRAMES * static_cast<size_t>(info_.channels));
    const sf_count_t frames = sf_readf_float(file_, values->data(), static_cast<sf_count_t>(BLOCK_FRAMES));
    if (frames < 0 || sf_error(file_) != SF_ERR_NO_ERROR)
    {
      fail(path_, std::string("is damaged: ") + sf_strerror(file_) + "; record or copy it again");
    }
    return static_cast<size_t>(frames);
  }

private:
  /// libsndfile takes a WAV file that ends too early for a shorter one.
  /// @return what is wrong, or "". Placeholder sizes of programs that stream are accepted.
  static std::string missingData(int file, off_t size)
  {
    constexpr uint32_t UNKNOWN = 0x7ffff000;
    std::array<unsigned char, 12> head = {};
    if (pread(file, head.data(), head.size(), 0) != static_cast<ssize_t>(head.size()) ||
        std::memcmp(head.data(), "RIFF", 4) != 0 || std::memcmp(head.data() + 8, "WAVE", 4) != 0)
    {
      return "";
    }
    off_t at = 12;
    while (pread(file, head.data(), 8, at) == 8)
    {
      const uint32_t length = head[4] | head[5] << 8 | head[6] << 16 | static_cast<uint32_t>(head[7]) << 24;
      at += 8;
      if (std::memcmp(head.data(), "data", 4) == 0)
      {
        return length < UNKNOWN && at + static_cast<off_t>(length) > size
                   ? "is damaged: it ends after " + std::to_string(size - at) + " of " + std::to_string(length) +
                         " bytes of sound; record or copy it again"
                   : "";
      }
      at += static_cast<off_t>(length) + length % 2;
    }
    return "";
  }

  const std::string path_;
  SF_INFO info_ = {};
  SNDFILE* file_ = nullptr;
};

}  // namespace

void AudioFormat::validate() const
{
  const pi_node::OptionCheck check("");
  check.range("sample_rate", sample_rate_hz, 4000, 192000);
  check.range("channels", channels, 1, 16);
}

bool operator==(const AudioFormat& a, const AudioFormat& b)
{
  return a.sample_rate_hz == b.sample_rate_hz && a.channels == b.channels;
}

std::string toString(const AudioFormat& format)
{
  return std::to_string(format.sample_rate_hz) + " Hz, " + std::to_string(format.channels) +
         (format.channels == 1 ? " channel" : " channels");
}

void Resampler::Free::operator()(SRC_STATE_tag* state) const
{
  src_delete(state);
}

Resampler::Resampler(const AudioFormat& format) : format_(format)
{
  format_.validate();
  if (format_.sample_rate_hz != SAMPLE_RATE_HZ)
  {
    int error = 0;
    // The middle one keeps what is below 90 % of the band; the fast one ends at 6.4 kHz, where speech does not.
    state_.reset(src_new(SRC_SINC_MEDIUM_QUALITY, 1, &error));
    if (!state_)
    {
      throw std::runtime_error(std::string("Resampler: ") + src_strerror(error));
    }
  }
}

void Resampler::resample(const float* values, size_t count, bool last, Samples* out)
{
  const double ratio = static_cast<double>(SAMPLE_RATE_HZ) / format_.sample_rate_hz;
  while (true)
  {
    resampled_.resize(static_cast<size_t>(std::ceil(static_cast<double>(count) * ratio)) + 256);
    SRC_DATA data = {};
    data.data_in = values;
    data.input_frames = static_cast<long>(count);
    data.data_out = resampled_.data();
    data.output_frames = static_cast<long>(resampled_.size());
    data.end_of_input = last ? 1 : 0;
    data.src_ratio = ratio;
    const int error = src_process(state_.get(), &data);
    if (error != 0)
    {
      throw std::runtime_error(std::string("Resampler: ") + src_strerror(error));
    }
    std::transform(resampled_.begin(), resampled_.begin() + data.output_frames_gen, std::back_inserter(*out), toSample);
    values += data.input_frames_used;
    count -= static_cast<size_t>(data.input_frames_used);
    if (count == 0 && data.output_frames_gen < data.output_frames)
    {
      return;
    }
  }
}

void Resampler::process(const int16_t* samples, size_t count, Samples* out)
{
  const auto channels = static_cast<size_t>(format_.channels);
  if (count % channels != 0)
  {
    throw std::invalid_argument("Resampler: " + std::to_string(count) + " samples, must be a multiple of " +
                                std::to_string(channels) + " channels");
  }
  if (channels == 1 && !state_)
  {
    out->insert(out->end(), samples, samples + count);
    return;
  }
  for (size_t begin = 0; begin < count;)
  {
    const size_t end = std::min(count, begin + BLOCK_FRAMES * channels);
    mixed_.clear();
    for (; begin < end; begin += channels)
    {
      int sum = 0;
      for (size_t channel = 0; channel < channels; ++channel)
      {
        sum += samples[begin + channel];
      }
      mixed_.push_back(static_cast<float>(sum) / (FULL_SCALE * static_cast<float>(channels)));
    }
    if (!state_)
    {
      std::transform(mixed_.begin(), mixed_.end(), std::back_inserter(*out), toSample);
    }
    else
    {
      resample(mixed_.data(), mixed_.size(), false, out);
    }
  }
}

void Resampler::flush(Samples* out)
{
  if (state_)
  {
    const float none = 0.0F;
    resample(&none, 0, true, out);
    src_reset(state_.get());
  }
}

size_t endOfSpeech(const Samples& samples)
{
  std::vector<double> energies;
  for (auto begin = samples.begin(); samples.end() - begin >= static_cast<std::ptrdiff_t>(PIECE);
       begin += static_cast<std::ptrdiff_t>(PIECE))
  {
    energies.push_back(std::accumulate(begin, begin + static_cast<std::ptrdiff_t>(PIECE), 1.0,
                                       [](double sum, int16_t s) { return sum + 1.0 * s * s; }));
  }
  if (energies.empty())
  {
    return samples.size();
  }
  std::vector<double> sorted = energies;
  std::sort(sorted.begin(), sorted.end());
  const size_t quiet = std::max<size_t>(1, sorted.size() / 10);
  const double noise = std::accumulate(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(quiet), 0.0) /
                       static_cast<double>(quiet);
  const double least =
      std::max(sorted.back() * std::pow(10.0, -WITHIN_DB / 10.0), noise * std::pow(10.0, ABOVE_NOISE_DB / 10.0));
  const auto last =
      std::find_if(energies.rbegin(), energies.rend(), [least](double energy) { return energy >= least; });
  return last == energies.rend() ? samples.size() : static_cast<size_t>(energies.rend() - last) * PIECE;
}

Samples readAudioFile(const std::string& path)
{
  SoundFile file(path);
  const AudioFormat found{file.info().samplerate, file.info().channels};
  try
  {
    found.validate();
  }
  catch (const std::invalid_argument& error)
  {
    fail(path, error.what());
  }
  Resampler resampler(found);
  Samples samples;
  std::vector<float> values;
  std::vector<int16_t> block;
  sf_count_t frames = 0;
  while (const size_t count = file.read(&values))
  {
    frames += static_cast<sf_count_t>(count);
    block.clear();
    std::transform(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(count) * found.channels,
                   std::back_inserter(block), toSample);
    resampler.process(block.data(), block.size(), &samples);
  }
  resampler.flush(&samples);
  if (frames == 0)
  {
    fail(path, "is empty, it holds no sound; record it again");
  }
  if (frames < file.info().frames && file.info().frames != SF_COUNT_MAX)
  {
    fail(path, "is damaged: it ends after " + std::to_string(frames) + " of " + std::to_string(file.info().frames) +
                   " samples; record or copy it again");
  }
  return samples;
}

void writeWav(const std::string& path, const Samples& samples)
{
  const auto refuse = [&path](const char* reason)
  { throw std::runtime_error("sound file " + path + ": cannot be written: " + reason); };
  SF_INFO info = {};
  info.samplerate = SAMPLE_RATE_HZ;
  info.channels = 1;
  info.format = SF_FORMAT_WAV | SF_FORMAT_PCM_16;
  const int descriptor = open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (descriptor < 0)
  {
    refuse(std::strerror(errno));
  }
  SNDFILE* const file = sf_open_fd(descriptor, SFM_WRITE, &info, SF_TRUE);
  if (file == nullptr)
  {
    refuse(sf_strerror(nullptr));
  }
  const auto count = static_cast<sf_count_t>(samples.size());
  errno = 0;
  const bool written = sf_writef_short(file, samples.data(), count) == count;
  const int why = errno;
  const bool closed = sf_close(file) == 0;  // writes the sizes into the head
  if (!written || !closed)
  {
    refuse(why != 0 ? std::strerror(why) : "the disk may be full");
  }
}

}  // namespace pi_speech
