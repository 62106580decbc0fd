#include "estimator/window_estimator.h"

#include <pi_node/option_check.h>
#include "estimator/normal_equations.h"
#include "estimator/triangulation.h"
#include "estimator/window_problem.h"

#include <pi_slam/so3.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

namespace pi_slam
{

using estimator::Landmark;
using estimator::Turn;
using estimator::View;

namespace
{

/// How well the first state is known. Position and heading define the frame; roll and pitch come from the
/// initialisation.
constexpr double FIRST_POSITION_M = 1e-3;
constexpr double FIRST_TILT_RAD = 0.05;
constexpr double FIRST_HEADING_RAD = 1e-3;
constexpr double FIRST_SPEED_MPS = 0.5;
constexpr double FIRST_GYRO_BIAS = 0.05;
constexpr double FIRST_ACCEL_BIAS = 0.1;  ///< of common MEMS sensors; on a straight it alone tells tilt from bias
/// Views of landmarks are believed up to this when they are triangulated [standard deviations].
constexpr double TRIANGULATION_ERROR = 3.0;

/// What a correction of the IMU leaves unknown.
constexpr double TILT_PART = 0.3;     ///< of its angle, in roll and pitch
constexpr double GRAVITY_PART = 0.5;  ///< of what its angle and time do to the force, in the accelerometer's bias
constexpr double LEAST_GYRO_DEVIATION = 1e-3;   ///< [rad/s]
constexpr double USUAL_RATE = 0.5;              ///< with which the vehicle turned meanwhile [rad/s]
constexpr double USUAL_RATE_CHANGE = 1.0;       ///< likewise [rad/s^2]
constexpr double LEAST_SPEED_DEVIATION = 0.05;  ///< [m/s]

/// Variance of a pose that is taken as exact [m^2, rad^2].
constexpr double EXACT_POSE = 1e-10;

/// Errors, one standard deviation each, of tilt that all states have in common, and of velocity and biases of the
/// first.
Eigen::MatrixXd commonErrors(const std::vector<NavState>& states, double tilt_rad, double speed, double gyro_bias,
                             double accel_bias)
{
  constexpr int TILT = 0, FIRST = 2;
  Eigen::MatrixXd errors = Eigen::MatrixXd::Zero(15 * static_cast<Eigen::Index>(states.size()), FIRST + 9);
  for (size_t i = 0; i < states.size(); ++i)
  {
    const Eigen::Index at = 15 * static_cast<Eigen::Index>(i);
    for (const int axis : {0, 1})
    {
      const Eigen::Vector3d tilt = tilt_rad * Eigen::Vector3d::Unit(axis);
      errors.block<3, 1>(at, TILT + axis) = tilt.cross(states[i].p - states.back().p);
      errors.block<3, 1>(at + 3, TILT + axis) = states[i].q.conjugate() * tilt;
      errors.block<3, 1>(at + 6, TILT + axis) = tilt.cross(states[i].v);
    }
  }
  Eigen::Matrix<double, 9, 1> deviations;
  deviations << Eigen::Vector3d::Constant(speed), Eigen::Vector3d::Constant(gyro_bias),
      Eigen::Vector3d::Constant(accel_bias);
  errors.block<9, 9>(6, FIRST) = deviations.asDiagonal();
  return errors;
}

/// Covariance of velocity and biases if the pose is known.
Matrix15d givenPose(const Matrix15d& covariance)
{
  const Matrix6d pose = covariance.topLeftCorner<6, 6>();
  const Eigen::Matrix<double, 6, 9> coupling = covariance.topRightCorner<6, 9>();
  Matrix15d given = Matrix15d::Zero();
  given.topLeftCorner<6, 6>().diagonal().setConstant(EXACT_POSE);
  given.bottomRightCorner<9, 9>() =
      covariance.bottomRightCorner<9, 9>() - coupling.transpose() * pose.llt().solve(coupling);
  return given;
}

}  // namespace

void WindowOptions::validate() const
{
  pi_node::OptionCheck check("window");
  check.range("keyframes", keyframes, 3, 30);
  check.range("max_landmarks", max_landmarks, 20, 2000);
  check.range("max_iterations", max_iterations, 1, 50);
  check.range("pixel_noise", pixel_noise, 0.1, 10.0);
  check.range("huber_px", huber_px, 0.1, 100.0);
  check.range("max_error_px", max_error_px, 0.5, 100.0);
}

struct WindowEstimator::Impl
{
  Impl(const StereoCalibration& calibration, const ImuModel& model_in, const WindowOptions& options_in)
    : model(model_in), options(options_in)
  {
    options.validate();
    model.validate();
    calibration.left.model.validate();
    calibration.right.model.validate();
    problem.cameras = estimator::cameraGeometry(calibration);
    problem.huber = options.huber_px / options.pixel_noise;
  }

  void clear()
  {
    problem.keyframes.clear();
    problem.links.clear();
    problem.landmarks.clear();
    problem.prior = estimator::Prior();
    problem.first_keyframe = 0;
  }

  void setPrior(const NavState& state, const Matrix15d& information)
  {
    problem.prior.H = information;
    problem.prior.b = Vector15d::Zero();
    problem.prior.linearized = {state};
  }

  void appendLink(const ImuPreintegration& imu, bool still);
  void appendKeyframe(const NavState& state, const FrameFeatures& features);
  void makeRoom();
  std::vector<Landmark*> selectLandmarks();
  void judgeLandmarks(const std::vector<Landmark*>& used, WindowReport* report);
  void moveUnused();

  const ImuModel model;
  const WindowOptions options;
  estimator::WindowProblem problem;
  estimator::NormalEquations equations;
  Matrix15d covariance = Matrix15d::Identity();
  Matrix15d relative_covariance = Matrix15d::Identity();
};

/// From the newest keyframe to the one that is appended next.
void WindowEstimator::Impl::appendLink(const ImuPreintegration& imu, bool still)
{
  problem.links.emplace_back(imu, model, still);
}

void WindowEstimator::Impl::appendKeyframe(const NavState& state, const FrameFeatures& features)
{
  estimator::Keyframe keyframe;
  keyframe.state = state;
  problem.keyframes.push_back(keyframe);
  const uint64_t serial = problem.first_keyframe + problem.keyframes.size() - 1;
  for (const FeatureObservation& feature : features.features)
  {
    Landmark& landmark = problem.landmarks[feature.id];
    landmark.estimate.id = feature.id;
    for (int camera : {LEFT, RIGHT})
    {
      if (feature.seen[camera])
      {
        View view;
        view.keyframe = serial;
        view.camera = camera;
        view.bearing = feature.bearing[camera];
        view.tangent = estimator::viewTangent(problem.cameras[camera], view.bearing) / options.pixel_noise;
        landmark.views.push_back(view);
      }
    }
  }
}

/// The oldest keyframe leaves: landmarks that the newest one still sees lose its views, the others go into the prior.
void WindowEstimator::Impl::makeRoom()
{
  const uint64_t oldest = problem.first_keyframe;
  const uint64_t newest = oldest + problem.keyframes.size() - 1;
  std::vector<Landmark*> leaving;
  for (auto& [id, landmark] : problem.landmarks)
  {
    if (landmark.views.empty() || landmark.views.front().keyframe != oldest)
    {
      continue;
    }
    if (landmark.views.back().keyframe == newest)
    {
      landmark.views.erase(std::remove_if(landmark.views.begin(), landmark.views.end(),
                                          [&](const View& view) { return view.keyframe == oldest; }),
                           landmark.views.end());
    }
    else if (landmark.known)
    {
      leaving.push_back(&landmark);
    }
    else
    {
      landmark.views.clear();
    }
  }
  estimator::marginalizeOldest(&problem, leaving, &equations);
  for (Landmark* const landmark : leaving)
  {
    landmark->views.clear();
  }
  for (auto it = problem.landmarks.begin(); it != problem.landmarks.end();)
  {
    it = it->second.views.empty() ? problem.landmarks.erase(it) : std::next(it);
  }
}

/// Landmarks known in space with enough views, the longest seen first.
std::vector<Landmark*> WindowEstimator::Impl::selectLandmarks()
{
  std::vector<Landmark*> use;
  for (auto& [id, landmark] : problem.landmarks)
  {
    landmark.used = false;
    if (!landmark.known && landmark.views.size() >= 2)
    {
      estimator::triangulate(problem, TRIANGULATION_ERROR, &landmark);
    }
    landmark.estimate.keyframes = landmark.views.empty()
                                      ? 0
                                      : static_cast<int>(std::count_if(landmark.views.begin(), landmark.views.end(),
                                                                       [&](const View& view) {
                                                                         return &view == &landmark.views.front() ||
                                                                                view.keyframe != (&view - 1)->keyframe;
                                                                       }));
    if (landmark.known && landmark.estimate.keyframes >= 2)
    {
      use.push_back(&landmark);
    }
  }
  if (use.size() > static_cast<size_t>(options.max_landmarks))
  {
    std::stable_sort(use.begin(), use.end(),
                     [](const Landmark* a, const Landmark* b)
                     { return a->estimate.keyframes > b->estimate.keyframes; });
    use.resize(static_cast<size_t>(options.max_landmarks));
  }
  for (Landmark* const landmark : use)
  {
    landmark->used = true;
  }
  return use;
}

void WindowEstimator::Impl::judgeLandmarks(const std::vector<Landmark*>& used, WindowReport* report)
{
  double sum = 0.0;
  size_t count = 0;
  for (Landmark* const landmark : used)
  {
    double error = 0.0;
    for (const View& view : landmark->views)
    {
      const estimator::BodyPose body = problem.bodyPose(view);
      error += estimator::reprojectionError(body.R_odom_body, body.p_odom_body, problem.cameras[view.camera],
                                            view.bearing, view.tangent, landmark->estimate.p_odom, nullptr, nullptr)
                   .norm() *
               options.pixel_noise;
    }
    const double mean = error / static_cast<double>(landmark->views.size());
    if (!(mean <= options.max_error_px))
    {
      report->rejected.push_back(landmark->estimate.id);
      continue;
    }
    sum += error;
    count += landmark->views.size();
  }
  for (int64_t id : report->rejected)
  {
    problem.landmarks.erase(id);
  }
  report->mean_error_px = count > 0 ? sum / static_cast<double>(count) : 0.0;
  report->observations = static_cast<int>(count);
}

/// Landmarks that were known but not optimised follow the states that saw them.
void WindowEstimator::Impl::moveUnused()
{
  for (auto& [id, landmark] : problem.landmarks)
  {
    if (landmark.known && !landmark.used)
    {
      estimator::triangulate(problem, TRIANGULATION_ERROR, &landmark);
    }
  }
}

WindowEstimator::WindowEstimator(const StereoCalibration& calibration, const ImuModel& model,
                                 const WindowOptions& options)
  : impl_(std::make_unique<Impl>(calibration, model, options))
{
}

WindowEstimator::~WindowEstimator() = default;

void WindowEstimator::start(const InitialSolution& solution, const ImuBuffer& imu)
{
  if (solution.states.size() < 2 || solution.states.size() != solution.frames.size())
  {
    throw std::invalid_argument("an initial solution needs two states or more, with what each of them saw");
  }
  impl_->clear();
  // Of more states than the window holds, the newest are used.
  const size_t first = solution.states.size() > static_cast<size_t>(impl_->options.keyframes)
                           ? solution.states.size() - static_cast<size_t>(impl_->options.keyframes)
                           : 0;
  for (size_t i = first; i < solution.states.size(); ++i)
  {
    if (i > first)
    {
      ImuBuffer::Quality quality;
      const ImuPreintegration link = imu.integrate(solution.states[i - 1].stamp_ns, solution.states[i].stamp_ns,
                                                   solution.states[i].bias, &quality);
      if (link.empty())
      {
        impl_->clear();
        throw std::invalid_argument("the samples of the IMU do not cover the initial states");
      }
      impl_->appendLink(link, false);
    }
    impl_->appendKeyframe(solution.states[i], solution.frames[i]);
  }
  Vector15d deviation;
  deviation << Eigen::Vector3d::Constant(FIRST_POSITION_M), Eigen::Vector3d::Constant(FIRST_TILT_RAD),
      Eigen::Vector3d::Constant(FIRST_SPEED_MPS), Eigen::Vector3d::Constant(FIRST_GYRO_BIAS),
      Eigen::Vector3d::Constant(FIRST_ACCEL_BIAS);
  Matrix15d information = deviation.cwiseAbs2().cwiseInverse().asDiagonal();
  // Heading is about the vertical, which has any direction in the body.
  const Eigen::Vector3d up = impl_->problem.keyframes.front().state.q.conjugate() * Eigen::Vector3d::UnitZ();
  information.block<3, 3>(3, 3) += up * up.transpose() / (FIRST_HEADING_RAD * FIRST_HEADING_RAD);
  impl_->setPrior(impl_->problem.keyframes.front().state, information);
}

void WindowEstimator::start(const NavState& state, const Matrix15d& covariance, const FrameFeatures& features)
{
  impl_->clear();
  impl_->appendKeyframe(state, features);
  impl_->setPrior(state, covariance.inverse());
  impl_->covariance = covariance;
  impl_->relative_covariance = givenPose(covariance);
}

bool WindowEstimator::empty() const
{
  return impl_->problem.keyframes.empty();
}

void WindowEstimator::addKeyframe(const NavState& state, const FrameFeatures& features,
                                  const ImuPreintegration& since_last, bool still,
                                  const std::optional<estimator::WheelTie>& wheels)
{
  if (empty() || since_last.empty() || since_last.startNs() != newest().stamp_ns ||
      since_last.endNs() != state.stamp_ns)
  {
    throw std::logic_error("a keyframe must be joined to the newest one by the integral of the IMU between them");
  }
  while (impl_->problem.keyframes.size() >= static_cast<size_t>(impl_->options.keyframes))
  {
    impl_->makeRoom();
  }
  impl_->appendLink(since_last, still);
  impl_->problem.links.back().wheels = wheels;
  impl_->appendKeyframe(state, features);
}

void WindowEstimator::correct(const ImuCorrection& due, const ImuBuffer& imu)
{
  estimator::WindowProblem& problem = impl_->problem;
  while (problem.keyframes.size() > 1 && problem.keyframes.front().state.stamp_ns < imu.firstNs())
  {
    impl_->makeRoom();
  }
  const NavState now = newest();
  const Turn turn(due, now, impl_->model.gravity);
  for (estimator::Keyframe& keyframe : problem.keyframes)
  {
    turn.apply(&keyframe.state);
  }
  for (auto& [id, landmark] : problem.landmarks)
  {
    landmark.estimate.p_odom = turn.centre + turn.R_turn * (landmark.estimate.p_odom - turn.centre);
    landmark.estimate.covariance = (turn.R_turn * landmark.estimate.covariance * turn.R_turn.transpose()).eval();
  }
  for (size_t i = 0; i < problem.links.size(); ++i)
  {
    const NavState& from = problem.keyframes[i].state;
    estimator::StateLink& link = problem.links[i];
    if (!link.still())
    {
      const std::optional<estimator::WheelTie> wheels = link.wheels;
      link = estimator::StateLink(
          imu.integrate(from.stamp_ns, problem.keyframes[i + 1].state.stamp_ns, from.bias, nullptr), impl_->model,
          false);
      link.wheels = wheels;
    }
  }

  const double angle = logSo3(Eigen::Quaterniond(due.R_body_imu)).norm();
  const double late_s = std::abs(due.late_s);
  const double speed =
      LEAST_SPEED_DEVIATION + impl_->model.gravity * late_s + angle * now.v.norm() + USUAL_RATE * due.p_body_imu.norm();
  const double gyro_bias = LEAST_GYRO_DEVIATION +
                           USUAL_RATE * (angle + (due.gyro_scale - Eigen::Vector3d::Ones()).norm()) +
                           USUAL_RATE_CHANGE * late_s;
  const double accel_bias = GRAVITY_PART * impl_->model.gravity * (angle + late_s);
  problem.prior.turn(turn);
  problem.prior.loosen(commonErrors(problem.prior.linearized, TILT_PART * angle, speed, gyro_bias, accel_bias));
}

WindowReport WindowEstimator::optimize(int max_iterations)
{
  estimator::WindowProblem& problem = impl_->problem;
  for (size_t i = 0; i < problem.links.size(); ++i)
  {
    problem.links[i].relinearize(problem.keyframes[i].state.bias);
  }
  const std::vector<Landmark*> use = impl_->selectLandmarks();
  const int iterations = std::clamp(max_iterations, 1, impl_->options.max_iterations);
  WindowReport report = estimator::solveSchur(&problem, use, iterations, &impl_->equations);
  if (!report.failed)
  {
    impl_->covariance = impl_->equations.lastCovariance();
    impl_->relative_covariance = givenPose(impl_->covariance);
  }
  report.landmarks = static_cast<int>(use.size());
  impl_->judgeLandmarks(use, &report);
  impl_->moveUnused();
  return report;
}

const NavState& WindowEstimator::newest() const
{
  return impl_->problem.keyframes.back().state;
}

const Matrix15d& WindowEstimator::newestCovariance() const
{
  return impl_->covariance;
}

const Matrix15d& WindowEstimator::newestRelativeCovariance() const
{
  return impl_->relative_covariance;
}

std::vector<NavState> WindowEstimator::states() const
{
  std::vector<NavState> states;
  for (const estimator::Keyframe& keyframe : impl_->problem.keyframes)
  {
    states.push_back(keyframe.state);
  }
  return states;
}

const LandmarkEstimate* WindowEstimator::landmark(int64_t id) const
{
  const auto found = impl_->problem.landmarks.find(id);
  return found != impl_->problem.landmarks.end() && found->second.known ? &found->second.estimate : nullptr;
}

std::vector<LandmarkEstimate> WindowEstimator::landmarks() const
{
  std::vector<LandmarkEstimate> known;
  for (const auto& [id, landmark] : impl_->problem.landmarks)
  {
    if (landmark.known)
    {
      known.push_back(landmark.estimate);
    }
  }
  return known;
}

void WindowEstimator::clear()
{
  impl_->clear();
}

}  // namespace pi_slam
