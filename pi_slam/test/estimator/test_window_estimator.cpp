#include "estimator/window_estimator.h"

#include "estimator/normal_equations.h"
#include "estimator/triangulation.h"

#include <pi_slam/imu_simulator.h>
#include <pi_slam/so3.h>

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <limits>
#include <random>
#include <set>
#include <stdexcept>

#include "estimator/consistency_run.h"
#include "estimator/simulated_features.h"

using namespace pi_slam;

namespace
{

constexpr int64_t INTERVAL_NS = 200000000;

/// A drive with all that an estimator gets, and the truth.
struct Drive
{
  explicit Drive(double duration_s, const SimulatedFeaturesOptions& features = SimulatedFeaturesOptions())
    : trajectory(consistencyTrajectory(duration_s))
    , calibration(StereoCalibration::makeForwardPair(752, 480, 0.11))
    , world(trajectory, calibration, features)
    , imu(model)
  {
    const int64_t end_ns = trajectory.startNs() + static_cast<int64_t>(1e9 * duration_s);
    for (const ImuSample& sample :
         ImuSimulator(ImuSimulatorOptions()).simulate(trajectory, trajectory.startNs(), end_ns, &biases))
    {
      imu.add(sample);
    }
  }

  int64_t stampNs(int keyframe) const { return trajectory.startNs() + keyframe * INTERVAL_NS; }

  NavState truth(int keyframe) const
  {
    const SplineTrajectory::State at = trajectory.at(stampNs(keyframe));
    NavState state;
    state.stamp_ns = stampNs(keyframe);
    state.p = at.T_world_body.translation();
    state.q = Eigen::Quaterniond(at.T_world_body.linear()).normalized();
    state.v = at.v_world;
    state.bias = biases[static_cast<size_t>(40 * keyframe)];
    return state;
  }

  ImuPreintegration since(int keyframe, const ImuBias& bias) const
  {
    return imu.integrate(stampNs(keyframe - 1), stampNs(keyframe), bias, nullptr);
  }

  SplineTrajectory trajectory;
  StereoCalibration calibration;
  SimulatedFeatures world;
  ImuModel model;
  std::vector<ImuBias> biases;
  ImuBuffer imu;
};

Matrix15d startCovariance()
{
  Vector15d deviation;
  deviation << Eigen::Vector3d::Constant(1e-3), Eigen::Vector3d::Constant(1e-3), Eigen::Vector3d::Constant(0.05),
      Eigen::Vector3d::Constant(2e-3), Eigen::Vector3d::Constant(0.03);
  return deviation.cwiseAbs2().asDiagonal();
}

/// Adds keyframe after keyframe, each predicted by the IMU from the one before.
class KeyframeRun
{
public:
  KeyframeRun(Drive* drive, const WindowOptions& options)
    : drive_(drive), window(drive->calibration, drive->model, options)
  {
    window.start(drive->truth(0), startCovariance(), drive->world.at(drive->stampNs(0)));
  }

  WindowReport next(int iterations, const Vector15d& disturbance = Vector15d::Zero())
  {
    ++keyframe;
    const ImuPreintegration since = drive_->since(keyframe, window.newest().bias);
    NavState state = since.predict(window.newest());
    state.boxPlus(disturbance);
    window.addKeyframe(state, drive_->world.at(drive_->stampNs(keyframe)), since, false);
    return window.optimize(iterations);
  }

  Vector15d error() const { return window.newest().boxMinus(drive_->truth(keyframe)); }

private:
  Drive* drive_;

public:
  WindowEstimator window;
  int keyframe = 0;
};

}  // namespace

TEST(WindowOptions, AreRefusedOutOfRange)
{
  WindowOptions options;
  EXPECT_NO_THROW(options.validate());
  options.keyframes = 2;
  EXPECT_THROW(options.validate(), std::invalid_argument);
  options = WindowOptions();
  options.pixel_noise = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(options.validate(), std::invalid_argument);
  options = WindowOptions();
  options.max_landmarks = 5;
  EXPECT_THROW(WindowEstimator(StereoCalibration::makeForwardPair(), ImuModel(), options), std::invalid_argument);
}

TEST(WindowEstimator, FollowsADriveToCentimetres)
{
  Drive drive(8.0);
  KeyframeRun run(&drive, WindowOptions());
  for (int i = 0; i < 38; ++i)
  {
    ASSERT_FALSE(run.next(5).failed);
    // Half a pixel of noise at 2 to 12 m, over 2 s of window: some millimetres.
    EXPECT_LT(run.error().head<3>().norm(), 0.05) << "keyframe " << run.keyframe;
    EXPECT_LT(run.error().segment<3>(3).norm(), 0.01) << "keyframe " << run.keyframe;
  }
}

TEST(WindowEstimator, ConvergesFromDisturbedStates)
{
  Drive drive(2.0);
  Drive same(2.0);
  WindowOptions options;
  options.max_iterations = 30;
  options.pixel_noise = 1.0;  // with less, landmarks placed from a disturbed state lose views, and the data differ
  KeyframeRun calm(&drive, options);
  KeyframeRun disturbed(&same, options);
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  for (int i = 0; i < 8; ++i)
  {
    Vector15d disturbance;
    for (int j = 0; j < 15; ++j)
    {
      disturbance(j) = (j < 3 ? 0.1 : j < 6 ? 0.03 : j < 9 ? 0.2 : 0.0) * normal(random);
    }
    calm.next(30);
    ASSERT_FALSE(disturbed.next(30, disturbance).failed);
    EXPECT_LT(disturbed.error().head<3>().norm(), 0.03);
  }
  // The same data, and so the same minimum.
  EXPECT_LT(disturbed.window.newest().boxMinus(calm.window.newest()).head<6>().norm(), 2e-3);
}

TEST(WindowEstimator, StaysBoundedOverAThousandKeyframes)
{
  Drive drive(201.0);
  WindowOptions options;
  options.max_iterations = 2;
  KeyframeRun run(&drive, options);
  size_t most_landmarks = 0;
  for (int i = 0; i < 1000; ++i)
  {
    const WindowReport report = run.next(2);
    ASSERT_FALSE(report.failed) << "keyframe " << i;
    EXPECT_LE(report.landmarks, options.max_landmarks);
    most_landmarks = std::max(most_landmarks, run.window.landmarks().size());
    ASSERT_LE(run.window.states().size(), static_cast<size_t>(options.keyframes));
  }
  // At most 120 are seen at once, and a window lasts 1.8 s.
  EXPECT_LT(most_landmarks, 120u * 9u);
  EXPECT_LT(run.error().head<3>().norm(), 0.5);  // on 300 m
}

TEST(WindowEstimator, DropsLandmarksThatMove)
{
  SimulatedFeaturesOptions features;
  features.outlier_ratio = 0.15;
  Drive drive(6.0, features);
  KeyframeRun run(&drive, WindowOptions());
  std::set<int64_t> rejected;
  std::set<int64_t> seen;
  for (int i = 0; i < 28; ++i)
  {
    const WindowReport report = run.next(5);
    rejected.insert(report.rejected.begin(), report.rejected.end());
    for (int64_t id : report.rejected)
    {
      EXPECT_EQ(run.window.landmark(id), nullptr);
    }
  }
  size_t right = 0;
  for (int64_t id : rejected)
  {
    right += drive.world.isOutlier(id) ? 1 : 0;
  }
  EXPECT_GT(rejected.size(), 5u);
  EXPECT_GT(right, rejected.size() * 4 / 5);
  EXPECT_LT(run.error().head<3>().norm(), 0.15);
}

TEST(WindowEstimator, GoesOnWithoutViews)
{
  Drive drive(4.0);
  WindowEstimator window(drive.calibration, drive.model, WindowOptions());
  FrameFeatures nothing;
  window.start(drive.truth(0), startCovariance(), nothing);
  Matrix15d before = window.newestCovariance();
  for (int keyframe = 1; keyframe < 15; ++keyframe)
  {
    const ImuPreintegration since = drive.since(keyframe, window.newest().bias);
    window.addKeyframe(since.predict(window.newest()), nothing, since, false);
    const WindowReport report = window.optimize(5);
    ASSERT_FALSE(report.failed);
    EXPECT_EQ(report.landmarks, 0);
    EXPECT_GT(window.newestCovariance().diagonal().head(3).sum(), before.diagonal().head(3).sum());
    before = window.newestCovariance();
  }
}

TEST(WindowEstimator, SurvivesLandmarksWithOneViewBehindOrNotFinite)
{
  Drive drive(4.0);
  WindowEstimator window(drive.calibration, drive.model, WindowOptions());
  const auto spoilt = [&](int keyframe)
  {
    FrameFeatures features = drive.world.at(drive.stampNs(keyframe));
    for (size_t i = 0; i < features.features.size(); ++i)
    {
      FeatureObservation& feature = features.features[i];
      if (i % 10 == 0)
      {
        feature.bearing[LEFT] = -feature.bearing[LEFT];
      }
      if (i % 10 == 1)
      {
        feature.bearing[RIGHT].y() = std::numeric_limits<double>::quiet_NaN();
      }
      if (i % 10 == 2)
      {
        feature.id += 1000000 * (keyframe + 1);  // never seen again
        feature.seen[RIGHT] = false;
      }
      if (i % 10 == 3)
      {
        feature.seen[LEFT] = feature.seen[RIGHT] = false;
      }
    }
    return features;
  };
  window.start(drive.truth(0), startCovariance(), spoilt(0));
  for (int keyframe = 1; keyframe < 20; ++keyframe)
  {
    const ImuPreintegration since = drive.since(keyframe, window.newest().bias);
    window.addKeyframe(since.predict(window.newest()), spoilt(keyframe), since, false);
    ASSERT_FALSE(window.optimize(5).failed);
    ASSERT_TRUE(window.newest().isFinite());
    ASSERT_TRUE(window.newestCovariance().allFinite());
    ASSERT_LT(window.newest().boxMinus(drive.truth(keyframe)).head<3>().norm(), 0.1);
  }
  for (const LandmarkEstimate& landmark : window.landmarks())
  {
    EXPECT_TRUE(landmark.p_odom.allFinite());
    EXPECT_TRUE(landmark.covariance.allFinite());
  }
}

TEST(WindowEstimator, HoldsStillWhenToldSo)
{
  Drive drive(4.0);
  NavState state = drive.truth(0);
  state.v.setZero();
  WindowEstimator window(drive.calibration, drive.model, WindowOptions());
  window.start(state, startCovariance(), FrameFeatures());
  for (int keyframe = 1; keyframe < 15; ++keyframe)
  {
    // The IMU says that it moves; it is not asked.
    window.addKeyframe(
        [&]
        {
          NavState next = window.newest();
          next.stamp_ns = drive.stampNs(keyframe);
          next.p.x() += 0.1;
          return next;
        }(),
        FrameFeatures(), drive.since(keyframe, window.newest().bias), true);
    ASSERT_FALSE(window.optimize(5).failed);
  }
  EXPECT_LT((window.newest().p - state.p).norm(), 1e-6);
  EXPECT_LT(window.newest().v.norm(), 1e-6);
}

TEST(WindowEstimator, StartsFromAnInitialSolution)
{
  Drive drive(4.0);
  InitialSolution solution;
  for (int keyframe = 0; keyframe < 12; ++keyframe)
  {
    NavState state = drive.truth(keyframe);
    state.p += Eigen::Vector3d(0.01, -0.01, 0.01) * (keyframe % 3 - 1);
    state.bias = ImuBias();
    solution.states.push_back(state);
    solution.frames.push_back(drive.world.at(drive.stampNs(keyframe)));
  }
  WindowOptions options;
  options.max_iterations = 20;
  WindowEstimator window(drive.calibration, drive.model, options);
  window.start(solution, drive.imu);
  EXPECT_EQ(window.states().size(), 9u);
  EXPECT_EQ(window.newest().stamp_ns, drive.stampNs(11));
  ASSERT_FALSE(window.optimize(20).failed);
  EXPECT_LT((window.newest().bias.gyro - drive.truth(11).bias.gyro).norm(), 1e-3);

  solution.frames.pop_back();
  EXPECT_THROW(window.start(solution, drive.imu), std::invalid_argument);
  solution.states.pop_back();
  EXPECT_THROW(window.start(solution, ImuBuffer(drive.model)), std::invalid_argument);
  EXPECT_TRUE(window.empty());
}

TEST(WindowEstimator, KeepsItsKeyframesWhenTheImuIsCorrected)
{
  Drive drive(8.0);
  // The IMU comes 20 ms late and is turned by 2 degrees.
  const ImuCorrection fault{0.02, expSo3(Eigen::Vector3d(0.03, -0.018, 0.0)).toRotationMatrix()};
  const ImuCorrection due{-fault.late_s, fault.R_body_imu.transpose()};
  ImuBuffer imu = drive.imu;
  imu.correct(fault);
  WindowEstimator window(drive.calibration, drive.model, WindowOptions());
  Matrix15d covariance = startCovariance();
  covariance.diagonal().segment<3>(3).setConstant(0.05 * 0.05);
  covariance.diagonal().segment<3>(12).setConstant(0.1 * 0.1);
  constexpr int FIRST = 1, LAST = 25;
  NavState first = drive.truth(FIRST);
  first.q = first.q * Eigen::Quaterniond(due.R_body_imu);  // upright by this IMU
  window.start(first, covariance, drive.world.at(drive.stampNs(FIRST)));
  for (int keyframe = FIRST + 1; keyframe <= LAST; ++keyframe)
  {
    const ImuPreintegration since =
        imu.integrate(drive.stampNs(keyframe - 1), drive.stampNs(keyframe), window.newest().bias, nullptr);
    window.addKeyframe(since.predict(window.newest()), drive.world.at(drive.stampNs(keyframe)), since, false);
    ASSERT_FALSE(window.optimize(5).failed);
  }
  const auto tilt = [&]
  {
    const Eigen::Vector3d up = window.newest().q.conjugate() * Eigen::Vector3d::UnitZ();
    return std::acos(up.dot(drive.truth(LAST).q.conjugate() * Eigen::Vector3d::UnitZ()));
  };
  const auto gyro_error = [&] { return (window.newest().bias.gyro - drive.truth(LAST).bias.gyro).norm(); };
  const double gyro_before = gyro_error();
  const double tilt_before = tilt();
  const double speed_before = (window.newest().v - drive.truth(LAST).v).norm();
  const std::vector<NavState> before = window.states();
  const size_t landmarks = window.landmarks().size();
  ASSERT_GT(tilt_before, 0.01);

  imu.correct(due);
  window.correct(due, imu);
  EXPECT_LT((window.newest().p - before.back().p).norm(), 1e-9);  // all turns about it
  ASSERT_FALSE(window.optimize(5).failed);

  ASSERT_EQ(window.states().size(), before.size());
  EXPECT_GE(window.landmarks().size() + 5, landmarks);
  // The accelerometer's bias and the tilt are one to these few metres; the window's relative poses are as they were.
  EXPECT_LT(tilt(), 0.8 * tilt_before);
  EXPECT_LT((window.newest().v - drive.truth(LAST).v).norm(), 0.5 * speed_before);
  EXPECT_LT(gyro_error(), 0.3 * gyro_before);
  EXPECT_LT((window.newest().p - before.back().p).norm(), 0.15);
}

TEST(WindowEstimator, LosesKeyframesOlderThanTheCorrectedSamples)
{
  Drive drive(6.0);
  KeyframeRun run(&drive, WindowOptions());
  while (run.keyframe < 20)
  {
    run.next(5);
  }
  ImuBuffer imu = drive.imu;
  imu.forgetBefore(drive.stampNs(17) + 1);
  run.window.correct(ImuCorrection(), imu);
  ASSERT_FALSE(run.window.optimize(5).failed);
  EXPECT_EQ(run.window.states().size(), 4U);
  EXPECT_LT(run.error().head<3>().norm(), 0.1);
}

TEST(Prior, IsLoosenedAsIfItsErrorsWereLarger)
{
  const Eigen::MatrixXd root = Eigen::MatrixXd::Random(15, 15);
  estimator::Prior prior;
  prior.H = root * root.transpose() + Eigen::MatrixXd::Identity(15, 15);
  prior.b = Eigen::VectorXd::Random(15);
  prior.linearized = {NavState()};
  const Eigen::MatrixXd errors = Eigen::MatrixXd::Random(15, 4);
  const Eigen::MatrixXd wanted = prior.H.inverse() + errors * errors.transpose();
  const Eigen::VectorXd minimum = -prior.H.ldlt().solve(prior.b);
  prior.loosen(errors);
  EXPECT_TRUE(prior.H.inverse().isApprox(wanted, 1e-9));
  EXPECT_TRUE((-prior.H.ldlt().solve(prior.b)).isApprox(minimum, 1e-9));
}

TEST(WindowEstimator, RefusesKeyframesThatAreNotJoined)
{
  Drive drive(2.0);
  WindowEstimator window(drive.calibration, drive.model, WindowOptions());
  const ImuPreintegration since = drive.since(1, ImuBias());
  EXPECT_THROW(window.addKeyframe(drive.truth(1), FrameFeatures(), since, false), std::logic_error);
  window.start(drive.truth(0), startCovariance(), FrameFeatures());
  EXPECT_THROW(window.addKeyframe(drive.truth(2), FrameFeatures(), since, false), std::logic_error);
  EXPECT_THROW(window.addKeyframe(drive.truth(1), FrameFeatures(), drive.since(2, ImuBias()), false), std::logic_error);
  EXPECT_THROW(window.addKeyframe(drive.truth(1), FrameFeatures(), ImuPreintegration(drive.model, ImuBias()), false),
               std::logic_error);
  EXPECT_NO_THROW(window.addKeyframe(drive.truth(1), FrameFeatures(), since, false));
  window.clear();
  EXPECT_TRUE(window.empty());
}

TEST(MarginalizeOldest, LeavesWhatTheBatchSolutionKnows)
{
  // Errors so small that all is linear: then the rest of the window and its prior know as much as all together.
  using namespace pi_slam::estimator;
  Drive drive(3.0);
  WindowProblem problem;
  problem.cameras = cameraGeometry(drive.calibration);
  problem.huber = 1e9;
  constexpr size_t STATES = 5;
  std::mt19937 random(2);
  std::normal_distribution<double> normal;
  NavState state = drive.truth(0);
  for (size_t i = 0; i < STATES; ++i)
  {
    if (i > 0)
    {
      const ImuPreintegration since = drive.since(static_cast<int>(i), state.bias);
      state = since.predict(state);
      problem.links.emplace_back(since, drive.model, false);
    }
    Keyframe keyframe;
    keyframe.state = state;
    problem.keyframes.push_back(keyframe);
  }
  problem.prior.H = startCovariance().inverse();
  problem.prior.b = Vector15d::Zero();
  problem.prior.linearized = {problem.keyframes[0].state};
  std::vector<Landmark*> leaving;
  std::vector<Landmark*> all;
  for (int64_t id = 0; id < 60; ++id)
  {
    // Half of them are seen by the first three states and leave with the first one, half by the last four.
    const bool leaves = id < 30;
    Landmark& landmark = problem.landmarks[id];
    landmark.estimate.id = id;
    landmark.known = true;
    landmark.estimate.p_odom =
        problem.keyframes[1].state.T_odom_body() *
        Eigen::Vector3d{4.0 + 0.1 * static_cast<double>(id % 30), 1.5 * normal(random), normal(random)};
    for (size_t slot = leaves ? 0 : 1; slot < (leaves ? 3 : STATES); ++slot)
    {
      for (int camera : {LEFT, RIGHT})
      {
        const NavState& from = problem.keyframes[slot].state;
        const CameraGeometry& geometry = problem.cameras[camera];
        View view;
        view.keyframe = slot;
        view.camera = camera;
        const Eigen::Vector3d exact =
            (geometry.R_camera_body * (from.q.conjugate() * (landmark.estimate.p_odom - from.p)) +
             geometry.p_camera_body)
                .normalized();
        view.bearing = (exact + tangentBasis(exact).transpose() * Eigen::Vector2d{normal(random), normal(random)} *
                                    1e-3 / geometry.focal_px)
                           .normalized();
        view.tangent = viewTangent(geometry, view.bearing);
        landmark.views.push_back(view);
      }
    }
  }
  for (auto& [id, landmark] : problem.landmarks)
  {
    all.push_back(&landmark);
    if (id < 30)
    {
      leaving.push_back(&landmark);
    }
  }
  // Away from the solution by some thousandths of a deviation.
  for (Keyframe& keyframe : problem.keyframes)
  {
    Vector15d moved = Vector15d::Zero();
    for (int i = 0; i < 6; ++i)
    {
      moved(i) = 1e-5 * normal(random);
    }
    keyframe.state.boxPlus(moved);
  }

  WindowProblem batch = problem;
  std::vector<Landmark*> batch_landmarks;
  for (auto& [id, landmark] : batch.landmarks)
  {
    batch_landmarks.push_back(&landmark);
  }
  NormalEquations equations;
  ASSERT_FALSE(solveSchur(&batch, batch_landmarks, 10, &equations).failed);
  const Matrix15d batch_covariance = equations.lastCovariance();

  marginalizeOldest(&problem, leaving, &equations);
  ASSERT_EQ(problem.keyframes.size(), STATES - 1);
  ASSERT_EQ(problem.links.size(), STATES - 2);
  EXPECT_EQ(problem.first_keyframe, 1u);
  EXPECT_EQ(problem.prior.linearized.size(), 2u);  // the third state is the last that is tied to the first
  std::vector<Landmark*> staying;
  for (auto& [id, landmark] : problem.landmarks)
  {
    if (id >= 30)
    {
      staying.push_back(&landmark);
    }
  }
  ASSERT_FALSE(solveSchur(&problem, staying, 10, &equations).failed);
  const Vector15d deviation = batch_covariance.diagonal().cwiseSqrt();
  for (size_t i = 0; i + 1 < STATES; ++i)
  {
    const Vector15d apart = problem.keyframes[i].state.boxMinus(batch.keyframes[i + 1].state);
    EXPECT_LT(apart.cwiseQuotient(deviation).cwiseAbs().maxCoeff(), 1e-3) << "state " << i;
  }
  const Matrix15d scaled = deviation.cwiseInverse().asDiagonal() * (equations.lastCovariance() - batch_covariance) *
                           deviation.cwiseInverse().asDiagonal();
  EXPECT_LT(scaled.cwiseAbs().maxCoeff(), 1e-3);
}

TEST(NormalEquations, SolvesAsADenseDecompositionDoes)
{
  Drive drive(3.0);
  using namespace pi_slam::estimator;
  for (size_t states : {1, 2, 3, 7})
  {
    WindowProblem problem;
    problem.cameras = cameraGeometry(drive.calibration);
    NavState state = drive.truth(0);
    for (size_t i = 0; i < states; ++i)
    {
      if (i > 0)
      {
        const ImuPreintegration since = drive.since(static_cast<int>(i), state.bias);
        state = since.predict(state);
        state.p.x() += 0.01;
        problem.links.emplace_back(since, drive.model, false);
      }
      problem.keyframes.push_back(Keyframe());
      problem.keyframes.back().state = state;
    }
    problem.prior.H = startCovariance().inverse();
    problem.prior.b = Vector15d::Ones();
    problem.prior.linearized = {problem.keyframes[0].state};
    NormalEquations equations;
    equations.reset(problem);
    equations.addPrior(problem);
    for (size_t i = 0; i + 1 < states; ++i)
    {
      equations.addLink(problem, i);
    }
    equations.eliminate(1e-3);
    Eigen::VectorXd step;
    ASSERT_TRUE(equations.solve(&step));
    Eigen::MatrixXd H;
    Eigen::VectorXd b;
    equations.reduced(&H, &b);
    const Eigen::VectorXd scale = H.diagonal().cwiseSqrt();
    EXPECT_LT(scale.cwiseInverse().cwiseProduct(H * step + b).norm(),
              1e-6 * scale.cwiseInverse().cwiseProduct(b).norm())
        << states << " states";
    const Matrix15d covariance = H.inverse().bottomRightCorner<15, 15>();
    EXPECT_LT((equations.lastCovariance() - covariance).norm(), 1e-5 * covariance.norm());
  }
}
