#include <pi_slam/imu_simulator.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <random>
#include <stdexcept>

namespace pi_slam
{

namespace
{

/// @return true for seven numbers with commas between, the first a positive count of nanoseconds.
bool parseSample(const std::string& line, int64_t* stamp_ns)
{
  const char* text = line.c_str();
  char* end = nullptr;
  *stamp_ns = std::strtoll(text, &end, 10);
  if (end == text || *stamp_ns <= 0)
  {
    return false;
  }
  for (int i = 0; i < 6; ++i)
  {
    if (*end != ',')
    {
      return false;
    }
    text = end + 1;
    if (!std::isfinite(std::strtod(text, &end)) || end == text)
    {
      return false;
    }
  }
  return *end == '\0';
}

}  // namespace

ImuSimulatorOptions ImuSimulatorOptions::makeIdeal()
{
  ImuSimulatorOptions options;
  options.gyro_noise_density = options.gyro_random_walk = 0.0;
  options.accel_noise_density = options.accel_random_walk = 0.0;
  options.gyro_bias.setZero();
  options.accel_bias.setZero();
  return options;
}

void ImuSimulatorOptions::validate() const
{
  const auto check = [](bool good, const char* field, double value, const char* bound)
  {
    if (!good)
    {
      throw std::invalid_argument(std::string("imu: ") + field + " = " + std::to_string(value) + ", must be " + bound);
    }
  };
  check(rate_hz >= 10.0 && rate_hz <= 4000.0, "rate_hz", rate_hz, "in [10, 4000]");
  check(gyro_noise_density >= 0.0, "gyro_noise_density", gyro_noise_density, "0 or more");
  check(gyro_random_walk >= 0.0, "gyro_random_walk", gyro_random_walk, "0 or more");
  check(accel_noise_density >= 0.0, "accel_noise_density", accel_noise_density, "0 or more");
  check(accel_random_walk >= 0.0, "accel_random_walk", accel_random_walk, "0 or more");
  check(gyro_bias.allFinite(), "gyro_bias", gyro_bias.norm(), "finite");
  check(accel_bias.allFinite(), "accel_bias", accel_bias.norm(), "finite");
  check(gyro_limit > 0.0, "gyro_limit", gyro_limit, "above 0");
  check(accel_limit > 0.0, "accel_limit", accel_limit, "above 0");
  check(std::isfinite(gravity), "gravity", gravity, "finite");
}

ImuSimulator::ImuSimulator(const ImuSimulatorOptions& options) : options_(options)
{
  options_.validate();
}

ImuNoise::ImuNoise(const ImuSimulatorOptions& options)
  : options_((options.validate(), options)), engine_(options.seed), bias_{options.gyro_bias, options.accel_bias}
{
}

Eigen::Vector3d ImuNoise::random()
{
  const double x = normal_(engine_);
  const double y = normal_(engine_);
  return {x, y, normal_(engine_)};
}

void ImuNoise::apply(ImuSample* sample)
{
  const auto limited = [](const Eigen::Vector3d& value, double limit)
  { return Eigen::Vector3d(value.cwiseMax(-limit).cwiseMin(limit)); };
  // A sample is the mean over one period of white noise; a bias takes the integral of its white noise over one.
  const double root = std::sqrt(1.0 / options_.rate_hz);
  sample->w = limited(sample->w + bias_.gyro + options_.gyro_noise_density / root * random(), options_.gyro_limit);
  sample->f = limited(sample->f + bias_.accel + options_.accel_noise_density / root * random(), options_.accel_limit);
  bias_.gyro += options_.gyro_random_walk * root * random();
  bias_.accel += options_.accel_random_walk * root * random();
}

std::vector<ImuSample> ImuSimulator::simulate(const SplineTrajectory& trajectory, int64_t start_ns, int64_t end_ns,
                                              std::vector<ImuBias>* biases) const
{
  const Eigen::Vector3d gravity(0.0, 0.0, -options_.gravity);
  std::vector<ImuSample> samples;
  ImuNoise noise(options_);
  for (int64_t i = 0;; ++i)
  {
    ImuSample sample;
    sample.stamp_ns = start_ns + std::llround(static_cast<double>(i) / options_.rate_hz * 1e9);
    if (sample.stamp_ns > end_ns)
    {
      return samples;
    }
    const SplineTrajectory::State state = trajectory.at(sample.stamp_ns);
    sample.w = state.w_body;
    sample.f = state.T_world_body.linear().transpose() * (state.a_world - gravity);
    if (biases != nullptr)
    {
      biases->push_back(noise.bias());
    }
    noise.apply(&sample);
    samples.push_back(sample);
  }
}

ImuLog readImuLog(const std::string& file)
{
  std::ifstream stream(file);
  if (!stream)
  {
    throw RecordingError(file + ": missing or not readable; an IMU log has lines of t,wx,wy,wz,ax,ay,az");
  }
  ImuLog log;
  size_t number = 0;
  for (std::string line; std::getline(stream, line);)
  {
    ++number;
    if (!line.empty() && line.back() == '\r')
    {
      line.pop_back();
    }
    if (line.empty() || line.front() == '#')
    {
      log.header = number == 1 ? line : log.header;
      continue;
    }
    int64_t stamp_ns = 0;
    if (!parseSample(line, &stamp_ns))
    {
      throw RecordingError(file, number, "is not t,wx,wy,wz,ax,ay,az: \"" + line.substr(0, 80) + "\"");
    }
    if (!log.stamps_ns.empty() && stamp_ns <= log.stamps_ns.back())
    {
      throw RecordingError(file, number, "time stamp is not after the one before");
    }
    log.stamps_ns.push_back(stamp_ns);
    log.lines.push_back(line);
  }
  if (log.lines.empty())
  {
    throw RecordingError(file + ": has no sample");
  }
  return log;
}

}  // namespace pi_slam
