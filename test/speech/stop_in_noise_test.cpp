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
#include <iostream>
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

/// Endless noise with a root mean square of 1.
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

/// The vehicle around recogniser, command node and arbiter: a microphone in noise, navigation that wants to drive, and
/// a chassis that does what it is told.
class Drive
{
public:
  Drive(const std::string& noise, double snr_db)
    : noise_(noiseOf(noise, 60 * pi_speech::SAMPLE_RATE_HZ)), noise_rms_(WORD_RMS * std::pow(10.0, -snr_db / 20.0))
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

  /// Drives on, in noise alone, until it goes at full speed and `least_s` are over.
  bool run(double least_s)
  {
    const ros::Time begin = ros::Time::now();
    while ((ros::Time::now() - begin).toSec() < TIMEOUT_S + least_s)
    {
      step(nullptr, 0);
      if (motion_.last() && motion_.last()->speed >= SPEED - 0.01 && (ros::Time::now() - begin).toSec() >= least_s)
      {
        return true;
      }
    }
    return false;
  }

  /// Says it. @return seconds from the end of the word until the vehicle brakes; nullopt: it does not.
  std::optional<double> say(const Samples& word)
  {
    motion_.clear();
    states_.clear();
    const size_t speech_end = pi_speech::endOfSpeech(word);
    std::optional<ros::Time> end;
    for (size_t at = 0; !end || (ros::Time::now() - *end).toSec() < PATIENCE_S; at += CHUNK)
    {
      step(at < word.size() ? word.data() + at : nullptr, std::min(CHUNK, word.size() - std::min(word.size(), at)));
      if (!end && at + CHUNK >= speech_end)
      {
        end = ros::Time::now();
      }
      if (const auto braking = brakingSince())
      {
        return end ? (*braking - *end).toSec() : 0.0;
      }
    }
    return std::nullopt;
  }

  /// Whether the stop is latched, a moment after the vehicle began to brake.
  bool stopped()
  {
    for (int i = 0; i < 25; ++i)
    {
      step(nullptr, 0);
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

  /// 20 ms of all, in real time.
  void step(const int16_t* word, size_t count)
  {
    next_ = std::max(next_ + ros::Duration(CHUNK_S), ros::Time::now() - ros::Duration(5 * CHUNK_S));
    ros::Time::sleepUntil(next_);
    Samples samples(CHUNK);
    for (size_t i = 0; i < CHUNK; ++i)
    {
      const double value = noise_rms_ * noise_[noise_at_++ % noise_.size()] + (i < count ? word[i] : 0);
      samples[i] = static_cast<int16_t>(std::clamp(std::lround(value), -32768L, 32767L));
    }
    std_msgs::Header header;
    header.stamp = stamp_ = stamp_.isZero() ? next_ : stamp_ + ros::Duration(CHUNK_S);
    sound_.publish(pi_speech::toMsg(samples.data(), samples.size(), header));
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

  const std::vector<float> noise_;
  const double noise_rms_;
  size_t noise_at_ = 0;
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

void expectStops(const std::string& name, const std::string& noise, double snr_db)
{
  const std::vector<Samples> words = heldOutStops(static_cast<size_t>(repetitions(6, 20)));
  if (words.empty())
  {
    GTEST_SKIP() << "PI_EDGE_DATA has no speech/commands.tsv with recorded words";
  }
  Drive drive(noise, snr_db);
  ASSERT_TRUE(drive.connected());
  size_t braked = 0;
  size_t stopped = 0;
  double slowest_s = 0.0;
  for (const Samples& word : words)
  {
    ASSERT_TRUE(drive.run(1.5)) << "it does not drive";
    if (const std::optional<double> braking_s = drive.say(word))
    {
      ++braked;
      slowest_s = std::max(slowest_s, *braking_s);
      stopped += drive.stopped() ? 1 : 0;
      Drive::release();
    }
  }
  std::cout << name << ": of " << words.size() << " \"stop\", " << braked << " braked the vehicle, " << stopped
            << " stopped it; at most " << slowest_s << " s after the end of the word" << std::endl;
  EXPECT_GE(braked + words.size() / 20, words.size());  // one of twenty may be missed
  EXPECT_LE(slowest_s, BRAKE_LIMIT_S);
}

TEST(StopInNoise, BrakesInWind)
{
  const char* data = std::getenv("PI_EDGE_DATA");
  const std::string wind = std::string(data == nullptr ? "" : data) + "/speech/noise/wind.wav";
  expectStops("wind, 9 dB", std::filesystem::exists(wind) ? wind : "wind", 9.0);
}

TEST(StopInNoise, BrakesInTheHumOfAMachine)
{
  expectStops("hum, 10 dB", "hum", 10.0);
}

}  // namespace

int main(int argc, char** argv)
{
  return pi_node::test_support::runOnGraph(argc, argv, "stop_in_noise_test");
}
