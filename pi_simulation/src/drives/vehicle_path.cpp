#include "drives/vehicle_path.h"

#include <algorithm>
#include <cmath>
#include <random>
#include <stdexcept>

namespace pi_simulation
{

namespace
{

constexpr double STEP_M = PathLine::STEP_M;
constexpr double ACCELERATION = 1.0;  ///< along the way [m/s^2]
constexpr double SIDE_ACCELERATION = 1.2;
constexpr double PERIOD_S = 0.02;  ///< of the poses

double headingAt(const PathLine& line, double s)
{
  const Eigen::Vector2d tangent = line.at(s + 0.25) - line.at(s - 0.25);
  return std::atan2(tangent.y(), tangent.x());
}

double curvatureAt(const PathLine& line, double s)
{
  return std::remainder(headingAt(line, s + 0.25) - headingAt(line, s - 0.25), 2.0 * M_PI) / 0.5;
}

/// Time at which each of `count` multiples of a step is reached, from rest to rest, with the stops on the way.
std::vector<double> timeOfDistance(const PathLine& line, const VehiclePathOptions& options, size_t count, double step_m)
{
  std::vector<double> speed(count);
  std::vector<double> pause(count, 0.0);
  for (size_t i = 0; i < count; ++i)
  {
    const double bend = std::abs(curvatureAt(line, step_m * static_cast<double>(i)));
    speed[i] = std::min(options.speed, std::sqrt(SIDE_ACCELERATION / std::max(bend, 1e-6)));
  }
  for (int stop = 1; stop <= options.stops; ++stop)
  {
    const auto i = count * static_cast<size_t>(stop) / static_cast<size_t>(options.stops + 1);
    speed[i] = 0.0;
    pause[i] = options.stop_s;
  }
  speed.front() = speed.back() = 0.0;
  for (size_t i = 1; i < count; ++i)
  {
    speed[i] = std::min(speed[i], std::sqrt(speed[i - 1] * speed[i - 1] + 2.0 * ACCELERATION * step_m));
  }
  for (size_t i = count - 1; i > 0; --i)
  {
    speed[i - 1] = std::min(speed[i - 1], std::sqrt(speed[i] * speed[i] + 2.0 * ACCELERATION * step_m));
  }
  std::vector<double> times(count, 0.0);
  for (size_t i = 1; i < count; ++i)
  {
    times[i] = times[i - 1] + pause[i - 1] + 2.0 * step_m / std::max(speed[i] + speed[i - 1], 1e-3);
  }
  return times;
}

std::vector<double> timeOfDistance(const PathLine& line, const VehiclePathOptions& options, double length_m)
{
  return timeOfDistance(line, options, static_cast<size_t>(length_m / STEP_M) + 2, STEP_M);
}

/// Length of the way that takes `duration_s` from rest to rest.
double lengthOfDuration(const PathLine& line, const VehiclePathOptions& options, double duration_s)
{
  double low = 0.0;
  double high = options.speed * duration_s;
  for (int i = 0; i < 30; ++i)
  {
    const double middle = 0.5 * (low + high);
    (timeOfDistance(line, options, middle).back() < duration_s ? low : high) = middle;
  }
  return low;
}

/// Sum of waves fixed to the road.
class Bumps
{
public:
  /// @param round_m  they come again after so much; 0: never.
  Bumps(double scale, uint64_t seed, double round_m) : scale_(scale), round_m_(round_m)
  {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> phase(0.0, 2.0 * M_PI);
    for (double& value : phases_)
    {
      value = phase(random);
    }
  }

  double height(double s) const { return scale_ * (0.010 * wave(s, 7.3, 0) + 0.004 * wave(s, 2.9, 1) + rough(s, 2)); }
  double pitch(double s) const { return scale_ * (0.004 * wave(s, 5.1, 3) + 0.003 * wave(s, 2.3, 4)); }
  double roll(double s) const { return scale_ * (0.004 * wave(s, 6.1, 5) + 0.003 * wave(s, 1.9, 6)); }

private:
  double wave(double s, double length, size_t i) const
  {
    const double fitting = round_m_ > 0.0 ? round_m_ / std::round(round_m_ / length) : length;
    return std::sin(2.0 * M_PI * s / fitting + phases_[i]);
  }
  double rough(double s, size_t i) const { return 0.001 * wave(s, 0.9, i); }

  double scale_;
  double round_m_;
  double phases_[7];
};

}  // namespace

PathShape parsePathShape(const std::string& name)
{
  if (name == "campus_loop")
  {
    return PathShape::CAMPUS_LOOP;
  }
  if (name == "hall_loop")
  {
    return PathShape::HALL_LOOP;
  }
  if (name == "straight")
  {
    return PathShape::STRAIGHT;
  }
  if (name == "figure_eight")
  {
    return PathShape::FIGURE_EIGHT;
  }
  throw std::invalid_argument("path \"" + name +
                              "\" is unknown; known: campus_loop, hall_loop, straight, figure_eight");
}

void VehiclePathOptions::validate() const
{
  const auto check = [](bool good, const char* field, double value, const char* bound)
  {
    if (!good)
    {
      throw std::invalid_argument(std::string("path: ") + field + " = " + std::to_string(value) + ", must be " + bound);
    }
  };
  check(rounds > 0 || (duration_s >= 1.0 && duration_s <= 86400.0), "duration_s", duration_s, "in [1, 86400]");
  check(speed >= 0.1 && speed <= 30.0, "speed", speed, "in [0.1, 30] m/s");
  check(start_standstill_s >= 0.0, "start_standstill_s", start_standstill_s, "0 or more");
  check(end_standstill_s >= 0.0, "end_standstill_s", end_standstill_s, "0 or more");
  check(stops >= 0 && stops <= 1000, "stops", stops, "in [0, 1000]");
  check(stop_s >= 0.0, "stop_s", stop_s, "0 or more");
  check(bumps >= 0.0 && bumps <= 10.0, "bumps", bumps, "in [0, 10]");
  check(height_m >= 0.1 && height_m <= 10.0, "height_m", height_m, "in [0.1, 10]");
  check(rounds >= 0 && rounds <= 10000, "rounds", rounds, "in [0, 10000]");
  check(rounds == 0 || isClosed(shape), "rounds", rounds, "0 on a path that is not closed");
  check(rounds > 0 || start_standstill_s + end_standstill_s + stops * stop_s <= 0.9 * duration_s, "duration_s",
        duration_s, "long enough for the standstills and stops, with a tenth left to drive");
}

std::vector<pi_slam::StampedPose> makeVehiclePath(const VehiclePathOptions& options)
{
  options.validate();
  const PathLine line(options.shape);
  double duration_s = options.duration_s;
  double step_m = STEP_M;
  std::vector<double> times;
  if (options.rounds > 0)
  {
    const double length = options.rounds * line.length();
    const double steps = std::round(length / STEP_M);
    step_m = length / steps;
    times = timeOfDistance(line, options, static_cast<size_t>(steps) + 1, step_m);
    duration_s = options.start_standstill_s + times.back() + options.end_standstill_s;
  }
  else
  {
    const double driving_s = options.duration_s - options.start_standstill_s - options.end_standstill_s;
    // Without a standstill to end with, the recording ends before the vehicle brakes.
    const double braking_s = options.end_standstill_s > 0.0 ? 0.0 : options.speed / ACCELERATION;
    times = timeOfDistance(line, options, lengthOfDuration(line, options, driving_s + braking_s));
  }
  const Bumps bumps(options.bumps, options.seed, options.rounds > 0 ? line.length() : 0.0);

  std::vector<pi_slam::StampedPose> poses;
  size_t i = 0;
  for (int k = 0; k * PERIOD_S <= duration_s + 1e-9; ++k)
  {
    const double time_s = k * PERIOD_S - options.start_standstill_s;
    while (i + 2 < times.size() && times[i + 1] <= time_s)
    {
      ++i;
    }
    // During a stop, which begins at times[i], the next step ends at times[i + 1] and begins that long before.
    const double step_s = std::min(times[i + 1] - times[i], 2.0 * std::sqrt(2.0 * step_m / ACCELERATION));
    const double f = std::clamp((time_s - (times[i + 1] - step_s)) / step_s, 0.0, 1.0);
    const double s = step_m * (static_cast<double>(i) + f);
    pi_slam::StampedPose pose;
    pose.stamp_ns = options.start_ns + std::llround(k * PERIOD_S * 1e9);
    pose.T_world_body.translation() << line.at(s), options.height_m + bumps.height(s);
    pose.T_world_body.linear() = (Eigen::AngleAxisd(headingAt(line, s), Eigen::Vector3d::UnitZ()) *
                                  Eigen::AngleAxisd(bumps.pitch(s), Eigen::Vector3d::UnitY()) *
                                  Eigen::AngleAxisd(bumps.roll(s), Eigen::Vector3d::UnitX()))
                                     .toRotationMatrix();
    poses.push_back(pose);
  }
  return poses;
}

}  // namespace pi_simulation
