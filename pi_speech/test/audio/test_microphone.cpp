// Recording through alsa-lib without a sound card: from files by its file plugin, and from a card of this process that
// can be unplugged.

#include "audio/fake_microphone.h"
#include "audio/sound_bytes.h"

#include <gtest/gtest.h>
#include <pi_node/test_support/temporary_folder.h>
#include "audio/microphone.h"

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <cstdlib>
#include <functional>
#include <mutex>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace pi_speech
{

using namespace pi_node::test_support;
namespace
{

using Clock = std::chrono::steady_clock;
constexpr std::chrono::seconds TIMEOUT(20);  ///< for what must come

int64_t systemNow()
{
  return std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::system_clock::now().time_since_epoch())
      .count();
}

/// What the microphone said, in its order.
class Heard
{
public:
  struct Piece
  {
    std::vector<int16_t> samples;
    AudioFormat format;
    int64_t stamp_ns;
    int64_t came_ns;
    bool gap;
  };

  MicrophoneEvents events()
  {
    MicrophoneEvents events;
    events.sound = [this](const MicrophoneSound& sound)
    {
      std::lock_guard<std::mutex> lock(mutex_);
      pieces_.push_back(
          {{sound.samples, sound.samples + sound.count}, sound.format, sound.stamp_ns, systemNow(), sound.gap});
      samples_.insert(samples_.end(), sound.samples, sound.samples + sound.count);
      changed_.notify_all();
    };
    events.found = [this](const std::string& device, const AudioFormat&) { add("found " + device); };
    events.lost = [this](const std::string& problem) { add("lost: " + problem); };
    return events;
  }

  bool waitForSamples(size_t count)
  {
    std::unique_lock<std::mutex> lock(mutex_);
    return changed_.wait_for(lock, TIMEOUT, [this, count] { return samples_.size() >= count; });
  }
  bool waitForEvents(size_t count)
  {
    std::unique_lock<std::mutex> lock(mutex_);
    return changed_.wait_for(lock, TIMEOUT, [this, count] { return events_.size() >= count; });
  }
  std::vector<int16_t> samples() const
  {
    std::lock_guard<std::mutex> lock(mutex_);
    return samples_;
  }
  std::vector<Piece> pieces() const
  {
    std::lock_guard<std::mutex> lock(mutex_);
    return pieces_;
  }
  std::vector<std::string> said() const
  {
    std::lock_guard<std::mutex> lock(mutex_);
    return events_;
  }

private:
  void add(const std::string& event)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    events_.push_back(event);
    changed_.notify_all();
  }

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<Piece> pieces_;
  std::vector<int16_t> samples_;
  std::vector<std::string> events_;
};

bool contains(const std::string& text, const std::string& part)
{
  return text.find(part) != std::string::npos;
}

/// ALSA with devices of the test only.
class MicrophoneTest : public testing::Test
{
protected:
  void SetUp() override
  {
    setenv("ALSA_CONFIG_PATH", (folder_.path() + "/asound.conf").c_str(), 1);
    configure(fake_microphone::configuration(FAKE_MICROPHONE_LIBRARY));
    fake_microphone::plugIn({});
    fake_microphone::refuse(0);
    options_.device = "fake";
    options_.retry_s = 0.02;
  }
  void configure(const std::string& text) { folder_.file("asound.conf", text); }
  /// A device that gives these samples, and silence after them.
  void configureFile(const std::string& name, const std::vector<int16_t>& samples)
  {
    configure("pcm.null { type null }\npcm." + name + " { type file slave { pcm null } file /dev/null infile \"" +
              folder_.file("infile.raw", sampleBytes(samples)) + "\" format raw }\n");
  }
  TemporaryFolder folder_;
  MicrophoneOptions options_;
  Heard heard_;
};

// -------------------------------------------------------------------------------------------------------------- sound

TEST_F(MicrophoneTest, GivesAllSamplesOfADeviceInOrder)
{
  const std::vector<int16_t> recorded = counting(8000, 1);
  configureFile("mic", recorded);
  options_.device = "mic";
  Microphone microphone(options_, heard_.events());
  ASSERT_TRUE(heard_.waitForSamples(recorded.size() + 1000));
  microphone.stop();
  std::vector<int16_t> samples = heard_.samples();
  ASSERT_EQ(recorded, std::vector<int16_t>(samples.begin(), samples.begin() + 8000));
  EXPECT_EQ(std::vector<int16_t>(samples.size() - 8000), std::vector<int16_t>(samples.begin() + 8000, samples.end()));
  EXPECT_EQ((std::vector<std::string>{"found mic"}), heard_.said());
  const std::vector<Heard::Piece> pieces = heard_.pieces();
  for (size_t i = 0; i < pieces.size(); ++i)
  {
    ASSERT_EQ(320u, pieces[i].samples.size());
    ASSERT_EQ(AudioFormat(), pieces[i].format);
    ASSERT_EQ(i == 0, pieces[i].gap);
  }
}

TEST_F(MicrophoneTest, DeviceThatDoesNotPaceItselfIsHeldAtItsRate)
{
  configureFile("mic", counting(100));
  options_.device = "mic";
  const Clock::time_point begin = Clock::now();
  Microphone microphone(options_, heard_.events());
  ASSERT_TRUE(heard_.waitForSamples(24000));  // 1.5 s of sound
  // The sound of one buffer may come at once; the rest takes its time, but for the 1 % that a device's clock may be
  // fast.
  EXPECT_GT(std::chrono::duration<double>(Clock::now() - begin).count(), (1.5 - options_.buffer_s) / 1.01 - 0.05);
}

TEST_F(MicrophoneTest, StampsAreTheTimeOfTheSamplesAndContinuous)
{
  configureFile("mic", counting(100));
  options_.device = "mic";
  Microphone microphone(options_, heard_.events());
  ASSERT_TRUE(heard_.waitForSamples(16000));
  microphone.stop();
  const std::vector<Heard::Piece> pieces = heard_.pieces();
  for (size_t i = 1; i < pieces.size(); ++i)
  {
    // 20 ms, and what the smoothing may move: 2 % of the buffer's 0.5 s that a device without a clock is off at first.
    ASSERT_NEAR(20e6, static_cast<double>(pieces[i].stamp_ns - pieces[i - 1].stamp_ns), 11e6) << i;
  }
}

TEST_F(MicrophoneTest, FirstSampleOfSoundThatWaitedIsAsOldAsItsLength)
{
  options_.period_s = 0.1;
  Microphone microphone(options_, heard_.events());
  ASSERT_TRUE(fake_microphone::waitUntilStarted());
  const int64_t before_ns = systemNow();
  fake_microphone::record(counting(1600));
  ASSERT_TRUE(heard_.waitForSamples(1600));
  const Heard::Piece piece = heard_.pieces().front();
  // It had been recorded when it was seen, 1600 samples = 0.1 s after its beginning.
  EXPECT_GE(piece.stamp_ns, before_ns - 100000000);
  EXPECT_LE(piece.stamp_ns, piece.came_ns - 100000000);
}

TEST_F(MicrophoneTest, CardWithOtherRatesGivesTheNextOneAboveAndSaysSo)
{
  fake_microphone::plugIn({{8000, 44100, 48000}, {2}, true});
  options_.period_s = 0.01;
  Microphone microphone(options_, heard_.events());
  ASSERT_TRUE(fake_microphone::waitUntilStarted());
  const std::vector<int16_t> recorded = counting(2 * 441);
  fake_microphone::record(recorded);
  ASSERT_TRUE(heard_.waitForSamples(recorded.size()));
  EXPECT_EQ((AudioFormat{44100, 2}), heard_.pieces().front().format);
  EXPECT_EQ((AudioFormat{44100, 2}), microphone.status().format);
  EXPECT_EQ(recorded, heard_.samples());
}

TEST_F(MicrophoneTest, CardWithLowerRatesOnlyGivesTheHighest)
{
  fake_microphone::plugIn({{8000, 11025}, {1}, true});
  Microphone microphone(options_, heard_.events());
  ASSERT_TRUE(fake_microphone::waitUntilStarted());
  fake_microphone::record(counting(221));
  ASSERT_TRUE(heard_.waitForSamples(1));
  EXPECT_EQ((AudioFormat{11025, 1}), heard_.pieces().front().format);
}

// ------------------------------------------------------------------------------------------------------------- faults

TEST_F(MicrophoneTest, MissingDeviceIsSaidOnceWithThoseThereAreAndTriedAgain)
{
  fake_microphone::unplug();
  options_.device = "Nobody's microphone";
  Microphone microphone(options_, heard_.events());
  ASSERT_TRUE(heard_.waitForEvents(1));
  const std::string problem = heard_.said().front();
  EXPECT_EQ(0u, problem.find("lost: no device Nobody's microphone; there ")) << problem;
  EXPECT_EQ("lost: " + microphone.status().problem, problem);
  EXPECT_FALSE(microphone.status().recording);

  // It comes, under the name that was asked for.
  configure(fake_microphone::configuration(FAKE_MICROPHONE_LIBRARY) +
            "pcm.\"Nobody's microphone\" { type pi_speech_fake }\n");
  fake_microphone::plugIn({});
  ASSERT_TRUE(fake_microphone::waitUntilStarted());
  fake_microphone::record(counting(320));
  ASSERT_TRUE(heard_.waitForSamples(320));
  EXPECT_EQ((std::vector<std::string>{problem, "found Nobody's microphone"}), heard_.said());
  EXPECT_TRUE(microphone.status().recording);
  EXPECT_EQ("", microphone.status().problem);
}

TEST_F(MicrophoneTest, UnpluggedDeviceIsSaidOnceAndRecordsAgainWhenItIsBack)
{
  Microphone microphone(options_, heard_.events());
  ASSERT_TRUE(fake_microphone::waitUntilStarted());
  fake_microphone::record(counting(320, 1));
  ASSERT_TRUE(heard_.waitForSamples(320));
  fake_microphone::unplug();
  ASSERT_TRUE(heard_.waitForEvents(2));
  EXPECT_TRUE(contains(heard_.said()[1], "lost: device fake ")) << heard_.said()[1];
  fake_microphone::plugIn({});
  ASSERT_TRUE(fake_microphone::waitUntilStarted());
  fake_microphone::record(counting(320, 1001));
  ASSERT_TRUE(heard_.waitForSamples(640));
  EXPECT_EQ(1001, heard_.samples()[320]);
  EXPECT_TRUE(heard_.pieces()[1].gap);
  ASSERT_EQ(3u, heard_.said().size());
  EXPECT_EQ("found fake", heard_.said()[2]);
  EXPECT_EQ(1u, microphone.status().times_lost);
}

TEST_F(MicrophoneTest, DeviceThatFallsSilentWithoutAWordCountsAsGone)
{
  options_.stall_s = 0.1;
  Microphone microphone(options_, heard_.events());
  ASSERT_TRUE(fake_microphone::waitUntilStarted());
  fake_microphone::record(counting(320));
  ASSERT_TRUE(heard_.waitForEvents(2));
  EXPECT_EQ("lost: device fake gives no sound; plug it in again", heard_.said()[1]);
}

TEST_F(MicrophoneTest, OverrunIsCountedAndMarkedAndGoesOn)
{
  Microphone microphone(options_, heard_.events());
  ASSERT_TRUE(fake_microphone::waitUntilStarted());
  fake_microphone::record(counting(320, 1));
  ASSERT_TRUE(heard_.waitForSamples(320));
  fake_microphone::overrun();
  ASSERT_TRUE(fake_microphone::waitUntilStarted());
  fake_microphone::record(counting(640, 2001));
  ASSERT_TRUE(heard_.waitForSamples(960));
  const std::vector<Heard::Piece> pieces = heard_.pieces();
  ASSERT_EQ(3u, pieces.size());
  EXPECT_TRUE(pieces[1].gap);
  EXPECT_FALSE(pieces[2].gap);
  EXPECT_EQ(2001, pieces[1].samples.front());
  EXPECT_EQ(1u, microphone.status().overruns);
  EXPECT_EQ((std::vector<std::string>{"found fake"}), heard_.said());
}

TEST_F(MicrophoneTest, GoesOnAfterTheComputerSlept)
{
  Microphone microphone(options_, heard_.events());
  ASSERT_TRUE(fake_microphone::waitUntilStarted());
  fake_microphone::record(counting(320, 1));
  ASSERT_TRUE(heard_.waitForSamples(320));
  fake_microphone::suspend();
  ASSERT_TRUE(fake_microphone::waitUntilStarted());
  fake_microphone::record(counting(320, 2001));
  ASSERT_TRUE(heard_.waitForSamples(640));
  EXPECT_EQ(2001, heard_.samples()[320]);
  EXPECT_TRUE(heard_.pieces()[1].gap);
  EXPECT_EQ(1u, microphone.status().suspends);
  EXPECT_EQ((std::vector<std::string>{"found fake"}), heard_.said());
}

TEST_F(MicrophoneTest, DeviceInUseAndOneWithoutPermissionSayTheWayOut)
{
  for (const auto& [error, part] : {std::pair{EBUSY, "another program records"}, {EACCES, "the group audio"}})
  {
    fake_microphone::refuse(error);
    Heard heard;
    Microphone microphone(options_, heard.events());
    ASSERT_TRUE(heard.waitForEvents(1));
    EXPECT_TRUE(contains(heard.said().front(), part)) << heard.said().front();
    EXPECT_TRUE(contains(heard.said().front(), "device fake")) << heard.said().front();
  }
}

TEST_F(MicrophoneTest, DeviceWithOtherSamplesSaysWhichNameConvertsThem)
{
  fake_microphone::plugIn({{16000}, {1}, false});
  Microphone microphone(options_, heard_.events());
  ASSERT_TRUE(heard_.waitForEvents(1));
  EXPECT_EQ(
      "lost: device fake gives no samples of signed 16 bit; give device as plug:'fake', with which ALSA converts "
      "them",
      heard_.said().front());
}

TEST_F(MicrophoneTest, StopsAtOnceInEveryState)
{
  options_.retry_s = 60.0;
  options_.stall_s = 60.0;
  const Clock::time_point begin = Clock::now();
  {
    Microphone microphone(options_, heard_.events());
  }
  {
    Microphone microphone(options_, heard_.events());
    ASSERT_TRUE(fake_microphone::waitUntilStarted());
    microphone.stop();
    EXPECT_FALSE(fake_microphone::isOpen());
    microphone.stop();
  }
  fake_microphone::unplug();
  {
    Microphone microphone(options_, heard_.events());
    ASSERT_TRUE(heard_.waitForEvents(1));  // waits to try again
  }
  EXPECT_LT(Clock::now() - begin, std::chrono::seconds(30));  // half of what any wait takes
}

// ------------------------------------------------------------------------------------------------------- names,
// options

TEST(CaptureDevices, AreFoundByAPartOfTheirCardsName)
{
  const std::vector<CaptureDevice> devices = {{"hw:0,0", "HDA Intel PCH", "ALC269VC Analog"},
                                              {"hw:1,0", "USB PnP Sound Device", "USB Audio"},
                                              {"hw:2,0", "USB Camera", "USB Audio"}};
  EXPECT_EQ("hw:1,0", findCaptureDevice(devices, "USB PnP").value().name);
  EXPECT_EQ("hw:1,0", findCaptureDevice(devices, "usb pnp").value().name);
  EXPECT_EQ("hw:0,0", findCaptureDevice(devices, "Analog").value().name);
  EXPECT_EQ("hw:1,0", findCaptureDevice(devices, "USB").value().name);
  EXPECT_FALSE(findCaptureDevice(devices, "Bluetooth"));
  EXPECT_FALSE(findCaptureDevice(devices, ""));
  EXPECT_FALSE(findCaptureDevice({}, "USB"));
}

TEST(CaptureDevices, AreListed)
{
  EXPECT_EQ("there is none that records; is the microphone plugged in?", listCaptureDevices({}));
  EXPECT_EQ("there are: hw:0,0 (PCH, Analog); hw:1,0 (PnP, USB Audio)",
            listCaptureDevices({{"hw:0,0", "PCH", "Analog"}, {"hw:1,0", "PnP", "USB Audio"}}));
}

TEST(MicrophoneOptions, NameFieldValueAndBound)
{
  const auto refusal = [](const std::function<void(MicrophoneOptions*)>& change)
  {
    MicrophoneOptions options;
    change(&options);
    try
    {
      options.validate();
    }
    catch (const std::invalid_argument& error)
    {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_EQ("", refusal([](MicrophoneOptions*) {}));
  EXPECT_EQ(0u, refusal([](MicrophoneOptions* options) { options->device = ""; }).find("device = \"\", must be "));
  EXPECT_EQ("period_s = 0, must be in [0.002, 1]",
            refusal([](MicrophoneOptions* options) { options->period_s = 0.0; }));
  EXPECT_EQ("buffer_s = 0.01, must be in [0.04, 10]",
            refusal([](MicrophoneOptions* options) { options->buffer_s = 0.01; }));
  EXPECT_EQ("stall_s = nan, must be in [0.05, 60]",
            refusal([](MicrophoneOptions* options) { options->stall_s = std::nan(""); }));
  EXPECT_EQ("retry_s = 0, must be in [0.01, 60]", refusal([](MicrophoneOptions* options) { options->retry_s = 0.0; }));
  EXPECT_EQ("channels = 0, must be in [1, 16]",
            refusal([](MicrophoneOptions* options) { options->format.channels = 0; }));
  EXPECT_THROW(Microphone(MicrophoneOptions(), MicrophoneEvents()), std::invalid_argument);
}

}  // namespace
}  // namespace pi_speech
