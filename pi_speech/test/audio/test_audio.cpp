// Sound files of any kind and streams of any rate become SAMPLE_RATE_HZ in one channel.

#include "audio/sound_bytes.h"

#include <gtest/gtest.h>
#include <pi_node/test_support/message_of.h>
#include <pi_node/test_support/temporary_folder.h>
#include <pi_speech/audio.h>
#include <sndfile.h>
#include <sys/stat.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <filesystem>
#include <iterator>
#include <stdexcept>
#include <string>
#include <vector>

namespace pi_speech
{

using namespace pi_node::test_support;
namespace
{

constexpr double TONE_HZ = 440.0;
constexpr double AMPLITUDE = 8000.0;

/// Least squares fit of a tone to all but the edges, where a filter has nothing to look at.
std::complex<double> amplitudeAt(const Samples& samples, double frequency_hz)
{
  const size_t margin = samples.size() / 10;
  std::complex<double> sum = 0.0;
  double window = 0.0;
  for (size_t i = margin; i < samples.size() - margin; ++i)
  {
    const double part = static_cast<double>(i - margin) / static_cast<double>(samples.size() - 2 * margin);
    const double weight = 0.5 - 0.5 * std::cos(2.0 * M_PI * part);
    const double phase = 2.0 * M_PI * frequency_hz * static_cast<double>(i) / SAMPLE_RATE_HZ;
    sum += weight * samples[i] * std::exp(std::complex<double>(0.0, -phase));
    window += weight;
  }
  return 2.0 * sum / window;
}

double rms(const Samples& samples)
{
  double sum = 0.0;
  for (const int16_t sample : samples)
  {
    sum += static_cast<double>(sample) * sample;
  }
  return std::sqrt(sum / static_cast<double>(samples.size()));
}

/// One second of the tone at this rate, the same in all channels.
std::vector<int16_t> interleavedTone(int rate_hz, int channels)
{
  std::vector<int16_t> interleaved;
  for (const int16_t sample : sine(TONE_HZ, AMPLITUDE, 1.0, rate_hz))
  {
    interleaved.insert(interleaved.end(), static_cast<size_t>(channels), sample);
  }
  return interleaved;
}

/// The tone keeps its level within 0.5 %, its place within a twentieth of a sample, and 60 dB above all else.
void expectTone(const Samples& samples)
{
  ASSERT_NEAR(SAMPLE_RATE_HZ, static_cast<double>(samples.size()), 1.0);
  const std::complex<double> found = amplitudeAt(samples, TONE_HZ);
  EXPECT_NEAR(AMPLITUDE, std::abs(found), 0.005 * AMPLITUDE);
  const double samples_late = -(std::arg(found) + M_PI / 2.0) / (2.0 * M_PI * TONE_HZ) * SAMPLE_RATE_HZ;
  EXPECT_NEAR(0.0, samples_late, 0.05);
  Samples rest;
  for (size_t i = samples.size() / 10; i < samples.size() * 9 / 10; ++i)
  {
    const double phase = 2.0 * M_PI * TONE_HZ * static_cast<double>(i) / SAMPLE_RATE_HZ;
    rest.push_back(
        static_cast<int16_t>(std::lround(samples[i] - std::real(found * std::exp(std::complex<double>(0.0, phase))))));
  }
  EXPECT_LT(rms(rest), 1e-3 * AMPLITUDE);
}

void writeFlac(const std::string& path, int rate_hz, int channels, const std::vector<int16_t>& samples)
{
  SF_INFO info = {};
  info.samplerate = rate_hz;
  info.channels = channels;
  info.format = SF_FORMAT_FLAC | SF_FORMAT_PCM_16;
  SNDFILE* const file = sf_open(path.c_str(), SFM_WRITE, &info);
  ASSERT_NE(nullptr, file) << sf_strerror(nullptr);
  ASSERT_EQ(static_cast<sf_count_t>(samples.size()),
            sf_write_short(file, samples.data(), static_cast<sf_count_t>(samples.size())));
  sf_close(file);
}

void expectRefusal(const std::string& path, const std::string& reason)
{
  const std::string text = messageOf<std::runtime_error>([&] { readAudioFile(path); });
  EXPECT_NE(std::string::npos, text.find(path)) << text;
  EXPECT_NE(std::string::npos, text.find(reason)) << text;
}

size_t openFiles()
{
  const std::filesystem::directory_iterator files("/proc/self/fd");
  return static_cast<size_t>(std::distance(begin(files), end(files)));
}

// --------------------------------------------------------------------------------------------------------------- files

TEST(AudioFile, WavOfEveryRateAndChannelsBecomesOneStreamOfSpeech)
{
  const TemporaryFolder folder;
  for (const int rate_hz : {8000, 16000, 44100, 48000})
  {
    for (const int channels : {1, 2})
    {
      SCOPED_TRACE(std::to_string(rate_hz) + " Hz, " + std::to_string(channels) + " channels");
      expectTone(
          readAudioFile(folder.file("tone.wav", wavBytes(rate_hz, channels, interleavedTone(rate_hz, channels)))));
    }
  }
}

TEST(AudioFile, WavAtTheRateOfSpeechIsUnchanged)
{
  const TemporaryFolder folder;
  const Samples samples = counting(65536, -32768);
  EXPECT_EQ(samples, readAudioFile(folder.file("all.wav", wavBytes(SAMPLE_RATE_HZ, 1, samples))));
}

TEST(AudioFile, ReadsFlac)
{
  const TemporaryFolder folder;
  const std::string path = folder.path() + "/tone.flac";
  const Samples samples = sine(TONE_HZ, AMPLITUDE, 1.0, SAMPLE_RATE_HZ);
  writeFlac(path, SAMPLE_RATE_HZ, 1, samples);
  EXPECT_EQ(samples, readAudioFile(path));
  writeFlac(path, 44100, 2, interleavedTone(44100, 2));
  expectTone(readAudioFile(path));
}

TEST(AudioFile, ReadsRawSamples)
{
  const TemporaryFolder folder;
  const Samples samples = counting(1000, -500);
  EXPECT_EQ(samples, readAudioFile(folder.file("samples.raw", sampleBytes(samples))));
  EXPECT_EQ(samples, readAudioFile(folder.file("SAMPLES.RAW", sampleBytes(samples))));
}

TEST(AudioFile, FloatsThatAreTooLoudAreCutNotWrapped)
{
  const TemporaryFolder folder;
  const std::string path = folder.path() + "/float.wav";
  SF_INFO info = {};
  info.samplerate = SAMPLE_RATE_HZ;
  info.channels = 1;
  info.format = SF_FORMAT_WAV | SF_FORMAT_FLOAT;
  SNDFILE* const file = sf_open(path.c_str(), SFM_WRITE, &info);
  ASSERT_NE(nullptr, file);
  const std::vector<float> values = {0.5F, -0.5F, 3.0F, -3.0F, std::nanf("")};
  sf_write_float(file, values.data(), static_cast<sf_count_t>(values.size()));
  sf_close(file);
  EXPECT_EQ((Samples{16384, -16384, 32767, -32768, 0}), readAudioFile(path));
}

TEST(AudioFile, WavThatIsStillWrittenReadsUpToItsEnd)
{
  const TemporaryFolder folder;
  const Samples samples = counting(400);
  std::string bytes = wavBytes(SAMPLE_RATE_HZ, 1, samples);
  bytes.replace(40, 4, littleEndian(0xFFFFFFFF, 4));  // as a program writes that does not know the end
  EXPECT_EQ(samples, readAudioFile(folder.file("pipe.wav", bytes)));
}

TEST(AudioFile, NamesFileAndReasonOfWhatItCannotRead)
{
  const TemporaryFolder folder;
  const std::string wav = wavBytes(SAMPLE_RATE_HZ, 1, counting(1000));
  const std::string flac = folder.path() + "/cut.flac";
  writeFlac(flac, SAMPLE_RATE_HZ, 1, sine(TONE_HZ, AMPLITUDE, 2.0, SAMPLE_RATE_HZ));
  std::filesystem::resize_file(flac, std::filesystem::file_size(flac) / 2);
  const std::string pipe = folder.path() + "/pipe.wav";
  ASSERT_EQ(0, mkfifo(pipe.c_str(), 0600));

  const size_t open_before = openFiles();
  expectRefusal(folder.path() + "/none.wav", "No such file");
  expectRefusal(folder.path(), "is a folder");
  expectRefusal(pipe, "is no regular file");
  expectRefusal(folder.file("zero.wav", ""), "is empty, it has 0 bytes");
  expectRefusal(folder.file("zero.raw", ""), "is empty, it has 0 bytes");
  expectRefusal(folder.file("silent.wav", wavBytes(SAMPLE_RATE_HZ, 1, {})), "is empty, it holds no sound");
  expectRefusal(folder.file("text.wav", "go forward ten meters\n"), "is no sound that can be read");
  expectRefusal(folder.file("odd.raw", "123"), "is damaged: it has 3 bytes");
  expectRefusal(folder.file("cut.wav", wav.substr(0, 44 + 600)), "is damaged: it ends after 600 of 2000 bytes");
  expectRefusal(flac, "is damaged");
  expectRefusal(folder.file("head.wav", wav.substr(0, 30)), "is no sound that can be read");
  expectRefusal(folder.file("slow.wav", wavBytes(2000, 1, counting(1000))), "sample_rate = 2000, must be in [4000");
  expectRefusal(folder.file("many.wav", wavBytes(SAMPLE_RATE_HZ, 32, counting(3200))), "channels = 32, must be in [1");
  EXPECT_EQ(open_before, openFiles());
}

TEST(AudioFile, WhatIsWrittenIsReadBack)
{
  const TemporaryFolder folder;
  const Samples samples = counting(5000, -2500);
  writeWav(folder.path() + "/out.wav", samples);
  EXPECT_EQ(samples, readAudioFile(folder.path() + "/out.wav"));
}

TEST(AudioFile, WhatCannotBeWrittenIsNamed)
{
  const TemporaryFolder folder;
  const auto refusal_to_write = [](const std::string& path)
  {
    try
    {
      writeWav(path, counting(100000));
    }
    catch (const std::runtime_error& error)
    {
      return std::string(error.what());
    }
    return std::string();
  };
  const std::string nowhere = folder.path() + "/no/such.wav";
  EXPECT_EQ("sound file " + nowhere + ": cannot be written: No such file or directory", refusal_to_write(nowhere));
  EXPECT_NE(std::string::npos, refusal_to_write("/dev/full").find("sound file /dev/full: cannot be written"));
}

// ----------------------------------------------------------------------------------------------------------- resampler

TEST(AudioFormat, NamesFieldValueAndBound)
{
  const auto refusal_of = [](int rate_hz, int channels)
  {
    try
    {
      AudioFormat{rate_hz, channels}.validate();
    }
    catch (const std::invalid_argument& error)
    {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_EQ("", refusal_of(16000, 1));
  EXPECT_EQ("sample_rate = 3999, must be in [4000, 192000]", refusal_of(3999, 1));
  EXPECT_EQ("sample_rate = 0, must be in [4000, 192000]", refusal_of(0, 1));
  EXPECT_EQ("channels = 17, must be in [1, 16]", refusal_of(16000, 17));
  EXPECT_EQ("channels = 0, must be in [1, 16]", refusal_of(16000, 0));
  EXPECT_THROW(Resampler(AudioFormat{16000, 0}), std::invalid_argument);
}

Samples resampleInChunks(const AudioFormat& format, const std::vector<int16_t>& input,
                         const std::vector<size_t>& frames_at_a_time)
{
  Resampler resampler(format);
  const auto channels = static_cast<size_t>(format.channels);
  Samples out;
  size_t turn = 0;
  for (size_t begin = 0; begin < input.size();)
  {
    const size_t count = std::min(input.size() - begin, channels * frames_at_a_time[turn++ % frames_at_a_time.size()]);
    resampler.process(input.data() + begin, count, &out);
    begin += count;
  }
  resampler.flush(&out);
  return out;
}

TEST(Resampler, OddPiecesGiveTheSameAsTheWhole)
{
  for (const AudioFormat& format : {AudioFormat{44100, 2}, AudioFormat{48000, 1}, AudioFormat{8000, 3}})
  {
    const std::vector<int16_t> input = interleavedTone(format.sample_rate_hz, format.channels);
    const Samples whole = resampleInChunks(format, input, {input.size()});
    const Samples pieces = resampleInChunks(format, input, {1, 7, 441, 2, 1023, 0, 63});
    EXPECT_EQ(whole, pieces) << format.sample_rate_hz;
  }
}

TEST(Resampler, StreamAtTheRateOfSpeechPassesUnchangedAtOnce)
{
  Resampler resampler{AudioFormat()};
  const Samples input = counting(65536, -32768);
  Samples out = {1, 2};
  resampler.process(input.data(), 777, &out);
  ASSERT_EQ(779u, out.size());  // at its end, nothing held back
  resampler.process(input.data() + 777, input.size() - 777, &out);
  resampler.flush(&out);
  EXPECT_EQ(input, Samples(out.begin() + 2, out.end()));
}

TEST(Resampler, ChannelsBecomeTheirMean)
{
  Resampler resampler(AudioFormat{SAMPLE_RATE_HZ, 2});
  const std::vector<int16_t> input = {100, 300, -32768, -32768, 32767, 32767, 1000, -1000, 5, 0};
  Samples out;
  resampler.process(input.data(), input.size(), &out);
  EXPECT_EQ((Samples{200, -32768, 32767, 0, 2}), out);
}

TEST(Resampler, FlushGivesTheRestAndBeginsAnew)
{
  Resampler resampler(AudioFormat{48000, 1});
  const std::vector<int16_t> input = interleavedTone(48000, 1);
  Samples first;
  resampler.process(input.data(), input.size(), &first);
  EXPECT_LT(first.size(), static_cast<size_t>(SAMPLE_RATE_HZ));  // the filter looks ahead
  resampler.flush(&first);
  expectTone(first);
  Samples second;
  resampler.process(input.data(), input.size(), &second);
  resampler.flush(&second);
  EXPECT_EQ(first, second);
  Samples nothing;
  resampler.flush(&nothing);
  EXPECT_EQ(0u, nothing.size());
}

TEST(Resampler, LeavesOutWhatIsAboveTheBandOfSpeech)
{
  const std::vector<int16_t> high = sine(12000.0, AMPLITUDE, 1.0, 48000);  // would come back at 4 kHz
  const Samples out = resampleInChunks(AudioFormat{48000, 1}, high, {480});
  EXPECT_LT(std::abs(amplitudeAt(out, 4000.0)), 1e-3 * AMPLITUDE);
  EXPECT_NEAR(AMPLITUDE,
              std::abs(amplitudeAt(resampleInChunks(AudioFormat{48000, 1}, sine(6800.0, AMPLITUDE, 1.0, 48000), {480}),
                                   6800.0)),
              0.02 * AMPLITUDE);
}

TEST(Resampler, RefusesHalfAFrame)
{
  Resampler resampler(AudioFormat{48000, 2});
  const std::vector<int16_t> input(3);
  Samples out;
  EXPECT_THROW(resampler.process(input.data(), input.size(), &out), std::invalid_argument);
}

/// A tone in silence.
Samples toneIn(size_t count, size_t begin, size_t end)
{
  Samples samples(count, 0);
  for (size_t i = begin; i < end; ++i)
  {
    samples[i] = static_cast<int16_t>(std::lround(8000.0 * std::sin(0.3 * static_cast<double>(i))));
  }
  return samples;
}

TEST(EndOfSpeech, IsBehindTheLastPieceWithEnergy)
{
  EXPECT_EQ(8000u, endOfSpeech(toneIn(16000, 4000, 8000)));
  EXPECT_EQ(8160u, endOfSpeech(toneIn(16000, 4000, 8010)));  // pieces of 160
  EXPECT_EQ(16000u, endOfSpeech(toneIn(16000, 4000, 16000)));
}

TEST(EndOfSpeech, SoundTooShortToJudgeCountsWhole)
{
  EXPECT_EQ(0u, endOfSpeech({}));
  EXPECT_EQ(100u, endOfSpeech(Samples(100, 5)));
}

}  // namespace
}  // namespace pi_speech
