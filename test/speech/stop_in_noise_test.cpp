// Judge of stop_in_noise.test.

#include <gtest/gtest.h>
#include <pi_node/test_support/on_graph.h>
#include <pi_node/test_support/soak.h>
#include <pi_speech/AudioDataStamped.h>
#include <pi_speech/audio.h>
#include <pi_speech/noise_mixing.h>
#include <pi_speech/ros/audio_conversions.h>
#include <pi_vehicle/CommandState.h>
#include <pi_vehicle/MotionCommand.h>
#include <pi_vehicle/VehicleState.h>
#include <ros/ros.h>
#include <std_srvs/Trigger.h>

#include <algorithm>
#include <boost/crc.hpp>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iostream>
#include <map>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

namespace
{

using namespace pi_node::test_support;
using pi_speech::Samples;
using pi_vehicle::CommandState;
using pi_vehicle::MotionCommand;

constexpr size_t CHUNK = pi_speech::SAMPLE_RATE_HZ / 50;
constexpr double CHUNK_S = 0.02;
constexpr size_t PERIOD = 245 * CHUNK;       // from word to word: the vehicle is fast again, the hum's beat elsewhere
constexpr double WORD_RMS = 1500.0;          // of its loud parts: -27 dB of full scale
constexpr double SPEED = 2.0;                // [m/s]
constexpr double BRAKES = SPEED - 0.05;      // a lower speed is braking
constexpr double BRAKE_LIMIT_S = 0.7;        // from the end of the word
constexpr double PATIENCE_S = 2.0;           // for a "stop"
constexpr unsigned FOLDS = 5, HELD_OUT = 0;  // speakers that the network that ships has not heard

/// "stop" by speakers that were left out of the training, of the shared recordings; empty: they are not there.
std::vector<Samples> heldOutStops(size_t most)
{
  std::vector<Samples> words;
  const char* data = std::getenv("PI_EDGE_DATA");
  std::ifstream list(std::string(data == nullptr ? "" : data) + "/speech/commands.tsv");
  std::string line;
  while (words.size() < most && std::getline(list, line))
  {
    std::istringstream fields(line);
    std::string file;
    std::string word;
    std::string speaker;
    if (!std::getline(fields, file, '\t') || !std::getline(fields, word, '\t') ||
        !std::getline(fields, speaker, '\t') || word != "stop")
    {
      continue;
    }
    boost::crc_32_type checksum;
    checksum.process_bytes(speaker.data(), speaker.size());
    if (checksum.checksum() % FOLDS == HELD_OUT)
    {
      Samples samples = pi_speech::readAudioFile(std::string(data) + "/speech/" + file);
      const double gain = WORD_RMS / std::sqrt(pi_speech::activePower(samples));
      for (int16_t& sample : samples)
      {
        sample = static_cast<int16_t>(std::clamp(std::lround(gain * sample), -32767L, 32767L));
      }
      words.push_back(std::move(samples));
    }
  }
  return words;
}

/// The hum of a motor that beats: harmonics of 47 Hz, louder and fainter three times a second, with some hiss.
class Hum
{
public:
  float next()
  {
    const double time = static_cast<double>(sample_++) / pi_speech::SAMPLE_RATE_HZ;
    double value = 0.0;
    for (int harmonic = 1; harmonic <= 40; ++harmonic)
    {
      value += std::sin(2.0 * M_PI * 47.0 * harmonic * time + harmonic * harmonic) / std::sqrt(harmonic);
    }
    const double beat = 0.6 + 0.4 * std::sin(2.0 * M_PI * 3.0 * time);
    return static_cast<float>(value * beat) + 0.5F * hiss_.next(1)[0];
  }

private:
  int64_t sample_ = 0;
  pi_speech::NoiseSource hiss_{"white", 1};
};

/// Noise with a root mean square of 1.
std::vector<float> noiseOf(const std::string& name, size_t count)
{
  std::vector<float> noise;
  if (name == "hum")
  {
    Hum hum;
    std::generate_n(std::back_inserter(noise), count, [&hum] { return hum.next(); });
  }
  else
  {
    noise = pi_speech::NoiseSource(name, 1).next(count);
  }
  double power = 0.0;
  for (const float value : noise)
  {
    power += static_cast<double>(value) * value;
  }
  const auto gain = static_cast<float>(1.0 / std::sqrt(power / static_cast<double>(count)));
  for (float& value : noise)
  {
    value *= gain;
  }
  return noise;
}

/// "stop" in the sound that the microphone hears.
struct Stop
{
  std::string noise;  ///< around it
  size_t begin;       ///< sample at which its clip begins
  size_t end;         ///< sample at which its speech ends
};

/// What the microphone hears, from the first sample to the last: one noise behind the other, with words at fixed
/// places. So each run hears the same, however busy the machine is.
struct Sound
{
  Samples samples;
  std::vector<Stop> stops;

  /// @param source  of the noise: a file, or a name that noiseOf() knows
  void add(const std::string& noise, const std::string& source, double snr_db, const std::vector<Samples>& words)
  {
    const size_t first = samples.size();
    const double rms = WORD_RMS * std::pow(10.0, -snr_db / 20.0);
    std::vector<double> mixed;
    for (const float value : noiseOf(source, (words.size() + 1) * PERIOD))
    {
      mixed.push_back(rms * value);
    }
    for (size_t i = 0; i < words.size(); ++i)
    {
      const size_t begin = (i + 1) * PERIOD - PERIOD / 4;
      std::transform(words[i].begin(), words[i].end(), mixed.begin() + static_cast<std::ptrdiff_t>(begin),
                     mixed.begin() + static_cast<std::ptrdiff_t>(begin), std::plus<>());
      stops.push_back({noise, first + begin, first + begin + pi_speech::endOfSpeech(words[i])});
    }
    for (const double value : mixed)
    {
      samples.push_back(static_cast<int16_t>(std::clamp(std::lround(value), -32768L, 32767L)));
    }
  }
};

/// The vehicle around recogniser, command node and arbiter: a microphone in noise, navigation that wants to drive, and
/// a chassis that does what it is told.
class Drive
{
public:
  explicit Drive(const Samples& sound) : samples_(sound)
  {
    ros::NodeHandle node;
    sound_ = node.advertise<pi_speech::AudioDataStamped>("audio_stamped", 100);
    navigation_ = node.advertise<MotionCommand>("motion/navigation", 10);
    reaction_ = node.advertise<MotionCommand>("motion/reaction", 10);
    chassis_ = node.advertise<pi_vehicle::VehicleState>("vehicle_state", 10);
  }

  bool connected() const
  {
    return until(TIMEOUT_S,
                 [this]
                 {
                   return sound_.getNumSubscribers() > 0 && navigation_.getNumSubscribers() > 0 &&
                          reaction_.getNumSubscribers() > 0 && chassis_.getNumSubscribers() > 0;
                 });
  }

  /// Drives on until the word begins. @return whether the vehicle goes at full speed then
  bool runUntil(const Stop& stop)
  {
    playUntil(stop.begin);
    return motion_.last() && motion_.last()->speed >= SPEED - 0.01;
  }

  /// Plays the word, and noise while the vehicle does not brake. @return seconds from the end of the word until the
  /// vehicle brakes; nullopt: it does not.
  std::optional<double> say(const Stop& stop)
  {
    motion_.clear();
    states_.clear();
    playUntil(stop.end);
    const ros::Time end = ros::Time::now();
    while (!brakingSince() && (ros::Time::now() - end).toSec() < PATIENCE_S)
    {
      step();
    }
    const auto braking = brakingSince();
    return braking ? std::optional<double>((*braking - end).toSec()) : std::nullopt;
  }

  /// Whether the stop is latched, a moment after the vehicle began to brake.
  bool stopped()
  {
    for (int i = 0; i < 25; ++i)
    {
      step();
    }
    return states_.last() && states_.last()->stopped;
  }

  static void release()
  {
    std_srvs::Trigger trigger;
    EXPECT_TRUE(ros::service::call("/command/release", trigger));
  }

private:
  std::optional<ros::Time> brakingSince() const
  {
    for (const auto& motion : motion_.messages())
    {
      if (motion->speed < BRAKES)
      {
        return motion->header.stamp;
      }
    }
    return std::nullopt;
  }

  void playUntil(size_t sample)
  {
    while (at_ < sample)
    {
      step();
    }
  }

  /// 20 ms of all, in real time.
  void step()
  {
    next_ = std::max(next_ + ros::Duration(CHUNK_S), ros::Time::now() - ros::Duration(5 * CHUNK_S));
    ros::Time::sleepUntil(next_);
    std_msgs::Header header;
    header.stamp = stamp_ = stamp_.isZero() ? next_ : stamp_ + ros::Duration(CHUNK_S);
    sound_.publish(pi_speech::toMsg(samples_.data() + at_, CHUNK, header));
    at_ += CHUNK;
    if (++steps_ % 2 == 0)
    {
      publishVehicle();
    }
  }

  void publishVehicle()
  {
    MotionCommand motion;
    motion.header.stamp = ros::Time::now();
    motion.speed = SPEED;
    motion.source = "navigation";
    navigation_.publish(motion);
    motion.speed = 1000.0;
    motion.source = "reaction";
    reaction_.publish(motion);
    pi_vehicle::VehicleState state;
    state.header.stamp = motion.header.stamp;
    state.speed = motion_.last() ? motion_.last()->speed : 0.0;
    state.moving = state.speed > 0.0;
    chassis_.publish(state);
  }

  const Samples& samples_;
  size_t at_ = 0;  ///< of samples_, played so far
  ros::Publisher sound_;
  ros::Publisher navigation_;
  ros::Publisher reaction_;
  ros::Publisher chassis_;
  Collector<MotionCommand> motion_{"motion"};
  Collector<CommandState> states_{"command/state"};
  ros::Time next_ = ros::Time::now();
  ros::Time stamp_;
  int steps_ = 0;
};

/// How it went in one noise.
struct Outcome
{
  size_t words = 0;
  size_t braked = 0;
  size_t stopped = 0;
  double slowest_s = 0.0;
};

TEST(StopInNoise, BrakesInWindAndInTheHumOfAMachine)
{
  const std::vector<Samples> words = heldOutStops(static_cast<size_t>(repetitions(6, 20)));
  if (words.empty())
  {
    GTEST_SKIP() << "PI_EDGE_DATA has no speech/commands.tsv with recorded words";
  }
  const std::string wind = std::string(std::getenv("PI_EDGE_DATA")) + "/speech/noise/wind.wav";
  Sound sound;
  sound.add("wind, 9 dB", std::filesystem::exists(wind) ? wind : "wind", 9.0, words);
  sound.add("hum, 10 dB", "hum", 10.0, words);
  std::map<std::string, Outcome> outcomes;
  Drive drive(sound.samples);
  ASSERT_TRUE(drive.connected());
  for (const Stop& stop : sound.stops)
  {
    ASSERT_TRUE(drive.runUntil(stop)) << "it does not drive";
    Outcome& outcome = outcomes[stop.noise];
    ++outcome.words;
    if (const std::optional<double> braking_s = drive.say(stop))
    {
      ++outcome.braked;
      outcome.slowest_s = std::max(outcome.slowest_s, *braking_s);
      outcome.stopped += drive.stopped() ? 1 : 0;
      Drive::release();
    }
  }
  for (const auto& [noise, outcome] : outcomes)
  {
    SCOPED_TRACE(noise);
    std::cout << noise << ": of " << outcome.words << " \"stop\", " << outcome.braked << " braked the vehicle, "
              << outcome.stopped << " stopped it; at most " << outcome.slowest_s << " s after the end of the word"
              << std::endl;
    EXPECT_GE(outcome.braked + outcome.words / 20, outcome.words);  // one of twenty may be missed
    EXPECT_LE(outcome.slowest_s, BRAKE_LIMIT_S);
  }
}

}  // namespace

int main(int argc, char** argv)
{
  return pi_node::test_support::runOnGraph(argc, argv, "stop_in_noise_test");
}
