#include "estimator/ceres_solver.h"

#include "estimator/normal_equations.h"

#include <pi_slam/so3.h>

#include <ceres/ceres.h>

#include <Eigen/Eigenvalues>
#include <cmath>
#include <memory>
#include <vector>

namespace pi_slam::estimator
{

namespace
{

using RowMajor2x3 = Eigen::Matrix<double, 2, 3, Eigen::RowMajor>;
using RowMajor15x9 = Eigen::Matrix<double, 15, 9, Eigen::RowMajor>;
using RowMajor6x7 = Eigen::Matrix<double, 6, 7, Eigen::RowMajor>;

constexpr int POSE_SIZE = 7;   ///< position, then the quaternion x, y, z, w
constexpr int SPEED_SIZE = 9;  ///< velocity, bias of the gyro, bias of the accelerometer

/// Directions of the prior that hold less than this part of what is known are left out of its root.
constexpr double LEAST_EIGENVALUE = 1e-12;

Eigen::Map<Eigen::Vector3d> vectorAt(double* block)
{
  return Eigen::Map<Eigen::Vector3d>(block);
}

Eigen::Map<const Eigen::Vector3d> vectorAt(const double* block)
{
  return Eigen::Map<const Eigen::Vector3d>(block);
}

Eigen::Map<Eigen::Quaterniond> quaternionAt(double* block)
{
  return Eigen::Map<Eigen::Quaterniond>(block);
}

Eigen::Map<const Eigen::Quaterniond> quaternionAt(const double* block)
{
  return Eigen::Map<const Eigen::Quaterniond>(block);
}

/// Pose as a parameter block, with the errors of NavState: the first three are added, the others turn the body.
///
/// Cost functions here give their derivatives by these six errors, in the first six columns; the seventh is zero.
class PoseManifold : public ceres::Manifold
{
public:
  int AmbientSize() const override { return POSE_SIZE; }
  int TangentSize() const override { return 6; }

  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override
  {
    vectorAt(x_plus_delta) = vectorAt(x) + vectorAt(delta);
    quaternionAt(x_plus_delta + 3) = (quaternionAt(x + 3) * expSo3(vectorAt(delta + 3))).normalized();
    return true;
  }

  bool PlusJacobian(const double*, double* jacobian) const override
  {
    Eigen::Map<Eigen::Matrix<double, 7, 6, Eigen::RowMajor>> out(jacobian);
    out.setIdentity();
    return true;
  }

  bool Minus(const double* y, const double* x, double* y_minus_x) const override
  {
    vectorAt(y_minus_x) = vectorAt(y) - vectorAt(x);
    vectorAt(y_minus_x + 3) = logSo3(quaternionAt(x + 3).conjugate() * quaternionAt(y + 3));
    return true;
  }

  bool MinusJacobian(const double*, double* jacobian) const override
  {
    Eigen::Map<RowMajor6x7> out(jacobian);
    out.setIdentity();
    return true;
  }
};

/// A keyframe as parameter blocks.
struct StateBlocks
{
  double pose[POSE_SIZE];
  double speed[SPEED_SIZE];

  void set(const NavState& state)
  {
    vectorAt(pose) = state.p;
    quaternionAt(pose + 3) = state.q;
    vectorAt(speed) = state.v;
    vectorAt(speed + 3) = state.bias.gyro;
    vectorAt(speed + 6) = state.bias.accel;
  }
};

NavState stateOf(const double* pose, const double* speed)
{
  NavState state;
  state.p = vectorAt(pose);
  state.q = quaternionAt(pose + 3);
  state.v = vectorAt(speed);
  state.bias.gyro = vectorAt(speed + 3);
  state.bias.accel = vectorAt(speed + 6);
  return state;
}

/// The derivatives of a pose, zero in the seventh column.
template <int ROWS, typename Derived>
void storePoseJacobian(const Eigen::MatrixBase<Derived>& J, double* jacobian)
{
  Eigen::Map<Eigen::Matrix<double, ROWS, POSE_SIZE, Eigen::RowMajor>> out(jacobian);
  out.template leftCols<6>() = J;
  out.col(6).setZero();
}

/// A view of a landmark: blocks pose, landmark.
class ReprojectionCost : public ceres::SizedCostFunction<2, POSE_SIZE, 3>
{
public:
  ReprojectionCost(const View& view, const CameraGeometry& camera) : view_(view), camera_(camera) {}

  bool Evaluate(double const* const* blocks, double* residuals, double** jacobians) const override
  {
    const Eigen::Vector3d p = vectorAt(blocks[0]);
    const Eigen::Matrix3d R = quaternionAt(blocks[0] + 3).toRotationMatrix();
    Eigen::Matrix<double, 2, 6> J_pose;
    Eigen::Matrix<double, 2, 3> J_landmark;
    Eigen::Map<Eigen::Vector2d> error(residuals);
    error = reprojectionError(R, p, camera_, view_.bearing, view_.tangent, vectorAt(blocks[1]),
                              jacobians != nullptr ? &J_pose : nullptr, jacobians != nullptr ? &J_landmark : nullptr);
    if (jacobians != nullptr && jacobians[0] != nullptr)
    {
      storePoseJacobian<2>(J_pose, jacobians[0]);
    }
    if (jacobians != nullptr && jacobians[1] != nullptr)
    {
      Eigen::Map<RowMajor2x3> out(jacobians[1]);
      out = J_landmark;
    }
    return true;
  }

private:
  const View& view_;
  const CameraGeometry& camera_;
};

/// Two neighbouring keyframes: blocks pose and speed of the first, pose and speed of the second.
class LinkCost : public ceres::SizedCostFunction<15, POSE_SIZE, SPEED_SIZE, POSE_SIZE, SPEED_SIZE>
{
public:
  explicit LinkCost(const StateLink& link) : link_(link) {}

  bool Evaluate(double const* const* blocks, double* residuals, double** jacobians) const override
  {
    const NavState begin = stateOf(blocks[0], blocks[1]);
    const NavState end = stateOf(blocks[2], blocks[3]);
    Eigen::Matrix<double, 15, 30> J;
    Eigen::Map<Vector15d> error(residuals);
    error = link_.error(begin, end, jacobians != nullptr ? &J : nullptr);
    if (jacobians == nullptr)
    {
      return true;
    }
    for (int state = 0; state < 2; ++state)
    {
      if (jacobians[2 * state] != nullptr)
      {
        storePoseJacobian<15>(J.middleCols<6>(15 * state), jacobians[2 * state]);
      }
      if (jacobians[2 * state + 1] != nullptr)
      {
        Eigen::Map<RowMajor15x9> out(jacobians[2 * state + 1]);
        out = J.middleCols<9>(15 * state + 6);
      }
    }
    return true;
  }

private:
  const StateLink& link_;
};

/// The prior as a square: H = D^-1 V S V^T D^-1, and so error = S^1/2 V^T D^-1 d + S^-1/2 V^T D b, where D makes the
/// diagonal of D H D one. Blocks: pose and speed of each state in turn.
class PriorCost : public ceres::CostFunction
{
public:
  explicit PriorCost(const Prior& prior) : prior_(prior)
  {
    const Eigen::Index size = prior.H.rows();
    const Eigen::VectorXd scale = prior.H.diagonal().cwiseMax(1e-12).cwiseSqrt().cwiseInverse();
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(scale.asDiagonal() * prior.H * scale.asDiagonal());
    const Eigen::Index left_out =
        (eigen.eigenvalues().array() <= LEAST_EIGENVALUE * eigen.eigenvalues()(size - 1)).count();
    const Eigen::Index rows = size - left_out;
    const Eigen::VectorXd root = eigen.eigenvalues().tail(rows).cwiseSqrt();
    const Eigen::MatrixXd V = eigen.eigenvectors().rightCols(rows);
    J_ = root.asDiagonal() * V.transpose() * scale.cwiseInverse().asDiagonal();
    error_ = root.cwiseInverse().asDiagonal() * (V.transpose() * scale.cwiseProduct(prior.b));
    set_num_residuals(static_cast<int>(rows));
    for (size_t i = 0; i < prior.linearized.size(); ++i)
    {
      mutable_parameter_block_sizes()->push_back(POSE_SIZE);
      mutable_parameter_block_sizes()->push_back(SPEED_SIZE);
    }
  }

  bool Evaluate(double const* const* blocks, double* residuals, double** jacobians) const override
  {
    using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    Eigen::Map<Eigen::VectorXd> error(residuals, error_.size());
    error = error_;
    for (size_t i = 0; i < prior_.linearized.size(); ++i)
    {
      const Eigen::Index at = static_cast<Eigen::Index>(15 * i);
      const Vector15d moved = stateOf(blocks[2 * i], blocks[2 * i + 1]).boxMinus(prior_.linearized[i]);
      error.noalias() += J_.middleCols<15>(at) * moved;
      if (jacobians != nullptr && jacobians[2 * i] != nullptr)
      {
        Eigen::Map<RowMajor> out(jacobians[2 * i], J_.rows(), POSE_SIZE);
        out.leftCols<3>() = J_.middleCols<3>(at);
        out.middleCols<3>(3) = J_.middleCols<3>(at + 3) * rightJacobianInverse(moved.segment<3>(3));
        out.col(6).setZero();
      }
      if (jacobians != nullptr && jacobians[2 * i + 1] != nullptr)
      {
        Eigen::Map<RowMajor> out(jacobians[2 * i + 1], J_.rows(), SPEED_SIZE);
        out = J_.middleCols<9>(at + 6);
      }
    }
    return true;
  }

private:
  const Prior& prior_;
  Eigen::MatrixXd J_;
  Eigen::VectorXd error_;
};

/// Parameter blocks and costs of one optimisation.
class CeresWindow
{
public:
  CeresWindow(WindowProblem* window, const std::vector<Landmark*>& use)
    : window_(window), states_(window->keyframes.size()), huber_(window->huber), problem_(ownership())
  {
    for (size_t i = 0; i < states_.size(); ++i)
    {
      states_[i].set(window->keyframes[i].state);
      problem_.AddParameterBlock(states_[i].pose, POSE_SIZE, &pose_manifold_);
      problem_.AddParameterBlock(states_[i].speed, SPEED_SIZE);
    }
    addPrior();
    for (size_t i = 0; i < window->links.size(); ++i)
    {
      problem_.AddResidualBlock(keep<LinkCost>(window->links[i]), nullptr, states_[i].pose, states_[i].speed,
                                states_[i + 1].pose, states_[i + 1].speed);
    }
    for (Landmark* const landmark : use)
    {
      addViews(landmark);
    }
  }

  ceres::Solver::Summary solve(int max_iterations)
  {
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::DENSE_SCHUR;
    options.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>(ordering_);
    for (const StateBlocks& state : states_)
    {
      options.linear_solver_ordering->AddElementToGroup(const_cast<double*>(state.pose), 1);
      options.linear_solver_ordering->AddElementToGroup(const_cast<double*>(state.speed), 1);
    }
    options.max_num_iterations = max_iterations;
    options.function_tolerance = 1e-8;
    options.num_threads = 1;
    options.logging_type = ceres::SILENT;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem_, &summary);
    return summary;
  }

  /// Takes the states over; landmarks were optimised in place.
  void store() const
  {
    for (size_t i = 0; i < states_.size(); ++i)
    {
      const int64_t stamp_ns = window_->keyframes[i].state.stamp_ns;
      window_->keyframes[i].state = stateOf(states_[i].pose, states_[i].speed);
      window_->keyframes[i].state.stamp_ns = stamp_ns;
    }
  }

private:
  static ceres::Problem::Options ownership()
  {
    ceres::Problem::Options options;
    options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    options.disable_all_safety_checks = true;
    return options;
  }

  template <typename Cost, typename... Arguments>
  Cost* keep(Arguments&&... arguments)
  {
    auto cost = std::make_unique<Cost>(std::forward<Arguments>(arguments)...);
    Cost* const raw = cost.get();
    costs_.push_back(std::move(cost));
    return raw;
  }

  void addPrior()
  {
    if (window_->prior.linearized.empty())
    {
      return;
    }
    std::vector<double*> blocks;
    for (size_t i = 0; i < window_->prior.linearized.size(); ++i)
    {
      blocks.push_back(states_[i].pose);
      blocks.push_back(states_[i].speed);
    }
    problem_.AddResidualBlock(keep<PriorCost>(window_->prior), nullptr, blocks);
  }

  void addViews(Landmark* landmark)
  {
    double* const point = landmark->estimate.p_odom.data();
    ordering_.AddElementToGroup(point, 0);
    for (const View& view : landmark->views)
    {
      const size_t slot = window_->slot(view);
      const CameraGeometry& camera = window_->cameras[view.camera];
      problem_.AddResidualBlock(keep<ReprojectionCost>(view, camera), &huber_, states_[slot].pose, point);
    }
  }

  WindowProblem* const window_;
  std::vector<StateBlocks> states_;
  PoseManifold pose_manifold_;
  ceres::HuberLoss huber_;
  std::vector<std::unique_ptr<ceres::CostFunction>> costs_;
  ceres::ParameterBlockOrdering ordering_;
  ceres::Problem problem_;
};

}  // namespace

WindowReport solveCeres(WindowProblem* problem, const std::vector<Landmark*>& use, int max_iterations)
{
  WindowReport report;
  std::vector<Eigen::Vector3d> landmarks_before;
  landmarks_before.reserve(use.size());
  for (const Landmark* landmark : use)
  {
    landmarks_before.push_back(landmark->estimate.p_odom);
  }
  CeresWindow window(problem, use);
  const ceres::Solver::Summary summary = window.solve(max_iterations);
  report.iterations = summary.num_successful_steps + summary.num_unsuccessful_steps;
  report.failed = !summary.IsSolutionUsable() || !std::isfinite(summary.final_cost);
  if (report.failed)
  {
    for (size_t i = 0; i < use.size(); ++i)
    {
      use[i]->estimate.p_odom = landmarks_before[i];
    }
  }
  else
  {
    window.store();
  }
  return report;
}

}  // namespace pi_slam::estimator
