#include "estimator/normal_equations.h"

#include <pi_slam/so3.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace pi_slam::estimator
{

namespace
{

constexpr int POSE = 6;
constexpr int SPEED = 9;  ///< velocity and biases

/// The state at which derivatives are taken. The prior was linearised at earlier states. With derivatives at the
/// present states, the sum of both would contain information on the heading, which nothing has measured
/// (first-estimates Jacobians: Huang, Mourikis and Roumeliotis, "Observability-based rules for designing consistent EKF
/// SLAM estimators", IJRR 2010).
const NavState& linearizationPoint(const WindowProblem& problem, size_t state)
{
  return problem.prior.marginal && state < problem.prior.linearized.size() ? problem.prior.linearized[state]
                                                                           : problem.keyframes[state].state;
}

/// Gradient of the prior at the states of now, and its cost.
double priorCost(const Prior& prior, const std::vector<Keyframe>& keyframes, Eigen::VectorXd* gradient)
{
  const size_t states = prior.linearized.size();
  if (states == 0)
  {
    gradient->resize(0);
    return 0.0;
  }
  Eigen::VectorXd moved(15 * states);
  for (size_t i = 0; i < states; ++i)
  {
    moved.segment<15>(15 * i) = keyframes[i].state.boxMinus(prior.linearized[i]);
  }
  const Eigen::VectorXd pull = prior.H * moved;
  *gradient = prior.b + pull;
  return moved.dot(prior.b) + 0.5 * moved.dot(pull);
}

}  // namespace

Eigen::Index NormalEquations::poseAt(size_t state) const
{
  return static_cast<Eigen::Index>(SPEED * (states_ - 1) + POSE * state);
}

Eigen::Index NormalEquations::speedAt(size_t state) const
{
  return static_cast<Eigen::Index>(state + 1 < states_ ? SPEED * (states_ - 2 - state)
                                                       : SPEED * (states_ - 1) + POSE * states_);
}

/// Adds to the lower triangle what belongs to it.
template <int ROWS, int COLS, typename Derived>
void NormalEquations::addBlock(Eigen::Index row, Eigen::Index column, const Eigen::MatrixBase<Derived>& block)
{
  if (row >= column)
  {
    H_.block<ROWS, COLS>(row, column) += block;
  }
  else
  {
    H_.block<COLS, ROWS>(column, row) += block.transpose();
  }
}

void NormalEquations::reset(const WindowProblem& problem)
{
  states_ = problem.keyframes.size();
  const Eigen::Index size = static_cast<Eigen::Index>((POSE + SPEED) * states_);
  H_.setZero(size, size);
  b_.setZero(size);
  entries_.clear();
  couplings_.clear();
  bodies_.clear();
  linearized_bodies_.clear();
  for (size_t i = 0; i < states_; ++i)
  {
    bodies_.emplace_back(problem.keyframes[i].state);
    linearized_bodies_.emplace_back(linearizationPoint(problem, i));
  }
  cost_ = 0.0;
}

void NormalEquations::addPrior(const WindowProblem& problem)
{
  Eigen::VectorXd gradient;
  cost_ += priorCost(problem.prior, problem.keyframes, &gradient);
  const Eigen::MatrixXd& H = problem.prior.H;
  for (size_t i = 0; i < problem.prior.linearized.size(); ++i)
  {
    const Eigen::Index from = static_cast<Eigen::Index>(15 * i);
    b_.segment<POSE>(poseAt(i)) += gradient.segment<POSE>(from);
    for (size_t j = 0; j <= i; ++j)
    {
      addBlock<POSE, POSE>(poseAt(i), poseAt(j), H.block<POSE, POSE>(from, static_cast<Eigen::Index>(15 * j)));
    }
    addBlock<POSE, SPEED>(poseAt(i), speedAt(0), H.block<POSE, SPEED>(from, POSE));
  }
  if (!problem.prior.linearized.empty())
  {
    b_.segment<SPEED>(speedAt(0)) += gradient.segment<SPEED>(POSE);
    addBlock<SPEED, SPEED>(speedAt(0), speedAt(0), H.block<SPEED, SPEED>(POSE, POSE));
  }
}

void NormalEquations::addLink(const WindowProblem& problem, size_t link)
{
  Eigen::Matrix<double, 15, 30> J;
  const StateLink& tie = problem.links[link];
  const Vector15d error = tie.error(problem.keyframes[link].state, problem.keyframes[link + 1].state, &J);
  if (problem.prior.marginal && link < problem.prior.linearized.size())
  {
    tie.error(linearizationPoint(problem, link), linearizationPoint(problem, link + 1), &J);
  }
  Eigen::Matrix<double, 30, 30> H;
  H.noalias() = J.transpose() * J;
  Eigen::Matrix<double, 30, 1> b = J.transpose() * error;
  if (tie.wheels)
  {
    Eigen::Matrix<double, 3, 30> J_wheels;
    const Eigen::Vector3d off =
        tie.wheels->error(problem.keyframes[link].state, problem.keyframes[link + 1].state, &J_wheels);
    if (problem.prior.marginal && link < problem.prior.linearized.size())
    {
      tie.wheels->error(linearizationPoint(problem, link), linearizationPoint(problem, link + 1), &J_wheels);
    }
    double weight = 1.0;
    cost_ += huberCost(off.squaredNorm(), problem.huber, &weight);
    H.noalias() += weight * J_wheels.transpose() * J_wheels;
    b.noalias() += weight * J_wheels.transpose() * off;
  }
  for (int i = 0; i < 2; ++i)
  {
    const Eigen::Index pose = poseAt(link + static_cast<size_t>(i));
    const Eigen::Index speed = speedAt(link + static_cast<size_t>(i));
    b_.segment<POSE>(pose) += b.segment<POSE>(15 * i);
    b_.segment<SPEED>(speed) += b.segment<SPEED>(15 * i + POSE);
    addBlock<POSE, POSE>(pose, pose, H.block<POSE, POSE>(15 * i, 15 * i));
    addBlock<SPEED, SPEED>(speed, speed, H.block<SPEED, SPEED>(15 * i + POSE, 15 * i + POSE));
    for (int j = 0; j < 2; ++j)
    {
      addBlock<POSE, SPEED>(pose, speedAt(link + static_cast<size_t>(j)), H.block<POSE, SPEED>(15 * i, 15 * j + POSE));
    }
  }
  addBlock<POSE, POSE>(poseAt(link + 1), poseAt(link), H.block<POSE, POSE>(15, 0));
  addBlock<SPEED, SPEED>(speedAt(link + 1), speedAt(link), H.block<SPEED, SPEED>(15 + POSE, POSE));
  cost_ += 0.5 * error.squaredNorm();
}

void NormalEquations::addLandmark(const WindowProblem& problem, Landmark* landmark)
{
  Entry entry;
  entry.landmark = landmark;
  entry.H.setZero();
  entry.b.setZero();
  entry.H_inverse.setZero();
  entry.before = landmark->estimate.p_odom;
  entry.first = couplings_.size();
  const std::vector<View>& views = landmark->views;
  for (size_t i = 0; i < views.size();)
  {
    // Views of one keyframe, of the left camera and the right one, together: with J_b the derivative by the landmark in
    // the body frame, J_landmark = J_b R^T, J_position = -J_b R^T and J_angle = J_b [p_body]x.
    const size_t slot = problem.slot(views[i]);
    const BodyPose& body = bodies_[slot];
    const BodyPose& linearized = linearized_bodies_[slot];
    const bool apart = problem.prior.marginal && slot < problem.prior.linearized.size();
    const Eigen::Vector3d p_body = body.R_odom_body.transpose() * (landmark->estimate.p_odom - body.p_odom_body);
    const Eigen::Vector3d p_linearized =
        apart ? linearized.R_odom_body.transpose() * (landmark->estimate.p_odom - linearized.p_odom_body) : p_body;
    Eigen::Matrix3d H_body = Eigen::Matrix3d::Zero();
    Eigen::Vector3d b_body = Eigen::Vector3d::Zero();
    const uint64_t keyframe = views[i].keyframe;
    for (; i < views.size() && views[i].keyframe == keyframe; ++i)
    {
      const View& view = views[i];
      const CameraGeometry& camera = problem.cameras[view.camera];
      Eigen::Matrix<double, 2, 3> J;
      const Eigen::Vector2d error = viewError(camera, view.bearing, view.tangent, p_body, &J);
      if (apart)
      {
        viewError(camera, view.bearing, view.tangent, p_linearized, &J);
      }
      double weight = 1.0;
      cost_ += huberCost(error.squaredNorm(), problem.huber, &weight);
      H_body.noalias() += weight * J.transpose() * J;
      b_body.noalias() += weight * J.transpose() * error;
    }
    if (H_body.isZero(0.0))
    {
      continue;  // behind the cameras: no derivative
    }
    const Eigen::Matrix3d& R = linearized.R_odom_body;
    const Eigen::Matrix3d turn = hat(p_linearized);
    const Eigen::Matrix3d H_point_body = R * H_body;
    const Eigen::Matrix3d H_point = H_point_body * R.transpose();
    const Eigen::Matrix3d H_point_turn = H_point_body * turn;
    const Eigen::Vector3d b_point = R * b_body;
    Coupling coupling;
    coupling.at = poseAt(slot);
    coupling.W.topRows<3>() = -H_point;
    coupling.W.bottomRows<3>() = H_point_turn.transpose();
    couplings_.push_back(coupling);
    auto H_pose = H_.block<POSE, POSE>(coupling.at, coupling.at);
    H_pose.topLeftCorner<3, 3>() += H_point;
    H_pose.bottomLeftCorner<3, 3>() -= H_point_turn.transpose();
    H_pose.bottomRightCorner<3, 3>() += turn.transpose() * H_body * turn;
    b_.segment<3>(coupling.at) -= b_point;
    b_.segment<3>(coupling.at + 3) += turn.transpose() * b_body;
    entry.H += H_point;
    entry.b += b_point;
  }
  entry.count = couplings_.size() - entry.first;
  entries_.push_back(entry);
}

void NormalEquations::eliminate(double damping)
{
  reduced_H_ = H_;
  reduced_b_ = b_;
  if (damping > 0.0)
  {
    reduced_H_.diagonal() *= 1.0 + damping;
  }
  for (Entry& entry : entries_)
  {
    Eigen::Matrix3d H = entry.H;
    // A direction that no view fixes (infinitely far) must not make the inverse explode.
    H.diagonal() *= 1.0 + std::max(damping, 1e-9);
    H.diagonal().array() += 1e-9;
    entry.H_inverse = H.inverse();
    const Eigen::Vector3d pull = entry.H_inverse * entry.b;
    const Coupling* const couplings = couplings_.data() + entry.first;
    for (size_t i = 0; i < entry.count; ++i)
    {
      const Coupling& row = couplings[i];
      reduced_b_.segment<POSE>(row.at).noalias() -= row.W * pull;
      const Eigen::Matrix<double, 6, 3> WH = row.W * entry.H_inverse;
      for (size_t j = 0; j <= i; ++j)
      {
        reduced_H_.block<POSE, POSE>(row.at, couplings[j].at).noalias() -= WH * couplings[j].W.transpose();
      }
    }
  }
}

/// Cholesky decomposition of factor_ in place, block by block over velocities and biases, the rest at once.
bool NormalEquations::factorize()
{
  const Eigen::Index size = factor_.rows();
  const Eigen::Index poses = poseAt(0);
  for (size_t state = states_ - 1; state-- > 0;)
  {
    const Eigen::Index at = speedAt(state);
    auto diagonal = factor_.block<SPEED, SPEED>(at, at);
    const Eigen::LLT<Eigen::Matrix<double, SPEED, SPEED>> root(diagonal);
    if (root.info() != Eigen::Success)
    {
      return false;
    }
    const Eigen::Matrix<double, SPEED, SPEED> L = root.matrixL();
    diagonal = L;
    // Below: the next velocity and biases, and the poses from the one before on.
    const Eigen::Index from = poseAt(state > 0 ? state - 1 : 0);
    auto tail = factor_.block<Eigen::Dynamic, SPEED>(from, at, size - from, SPEED);
    L.triangularView<Eigen::Lower>().transpose().solveInPlace<Eigen::OnTheRight>(tail);
    factor_.bottomRightCorner(size - from, size - from).selfadjointView<Eigen::Lower>().rankUpdate(tail, -1.0);
    if (state > 0)
    {
      auto next = factor_.block<SPEED, SPEED>(at + SPEED, at);
      L.triangularView<Eigen::Lower>().transpose().solveInPlace<Eigen::OnTheRight>(next);
      factor_.block<SPEED, SPEED>(at + SPEED, at + SPEED).noalias() -= next * next.transpose();
      factor_.block<Eigen::Dynamic, SPEED>(from, at + SPEED, size - from, SPEED).noalias() -= tail * next.transpose();
    }
  }
  Eigen::Ref<Eigen::MatrixXd> rest = factor_.bottomRightCorner(size - poses, size - poses);
  const Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>> root(rest);
  return root.info() == Eigen::Success;
}

bool NormalEquations::solve(Eigen::VectorXd* step)
{
  factor_ = reduced_H_;
  if (!factorize())
  {
    return false;
  }
  const Eigen::Index size = factor_.rows();
  const Eigen::Index poses = poseAt(0);
  solution_ = -reduced_b_;
  for (size_t state = states_ - 1; state-- > 0;)
  {
    const Eigen::Index at = speedAt(state);
    const Eigen::Index from = poseAt(state > 0 ? state - 1 : 0);
    auto own = solution_.segment<SPEED>(at);
    factor_.block<SPEED, SPEED>(at, at).triangularView<Eigen::Lower>().solveInPlace(own);
    if (state > 0)
    {
      solution_.segment<SPEED>(at + SPEED).noalias() -= factor_.block<SPEED, SPEED>(at + SPEED, at) * own;
    }
    solution_.tail(size - from).noalias() -= factor_.block<Eigen::Dynamic, SPEED>(from, at, size - from, SPEED) * own;
  }
  auto rest = solution_.tail(size - poses);
  const auto L = factor_.bottomRightCorner(size - poses, size - poses).triangularView<Eigen::Lower>();
  L.solveInPlace(rest);
  L.transpose().solveInPlace(rest);
  for (size_t state = 0; state + 1 < states_; ++state)
  {
    const Eigen::Index at = speedAt(state);
    const Eigen::Index from = poseAt(state > 0 ? state - 1 : 0);
    auto own = solution_.segment<SPEED>(at);
    if (state > 0)
    {
      own.noalias() -= factor_.block<SPEED, SPEED>(at + SPEED, at).transpose() * solution_.segment<SPEED>(at + SPEED);
    }
    own.noalias() -=
        factor_.block<Eigen::Dynamic, SPEED>(from, at, size - from, SPEED).transpose() * solution_.tail(size - from);
    factor_.block<SPEED, SPEED>(at, at).triangularView<Eigen::Lower>().transpose().solveInPlace(own);
  }
  step->resize(size);
  for (size_t state = 0; state < states_; ++state)
  {
    step->segment<POSE>(static_cast<Eigen::Index>(15 * state)) = solution_.segment<POSE>(poseAt(state));
    step->segment<SPEED>(static_cast<Eigen::Index>(15 * state + POSE)) = solution_.segment<SPEED>(speedAt(state));
  }
  return step->allFinite();
}

void NormalEquations::moveLandmarks(const Eigen::VectorXd& step)
{
  for (Entry& entry : entries_)
  {
    Eigen::Vector3d pull = entry.b;
    for (size_t i = 0; i < entry.count; ++i)
    {
      const Coupling& coupling = couplings_[entry.first + i];
      pull.noalias() += coupling.W.transpose() * step.segment<POSE>((coupling.at - poseAt(0)) / POSE * (POSE + SPEED));
    }
    entry.before = entry.landmark->estimate.p_odom;
    entry.landmark->estimate.p_odom -= entry.H_inverse * pull;
  }
}

void NormalEquations::restoreLandmarks()
{
  for (const Entry& entry : entries_)
  {
    entry.landmark->estimate.p_odom = entry.before;
  }
}

void NormalEquations::storeCovariances()
{
  for (const Entry& entry : entries_)
  {
    entry.landmark->estimate.covariance = entry.H_inverse;
  }
}

void NormalEquations::reduced(Eigen::MatrixXd* H, Eigen::VectorXd* b) const
{
  std::vector<Eigen::Index> order;
  for (size_t state = 0; state < states_; ++state)
  {
    for (Eigen::Index i = 0; i < POSE; ++i)
    {
      order.push_back(poseAt(state) + i);
    }
    for (Eigen::Index i = 0; i < SPEED; ++i)
    {
      order.push_back(speedAt(state) + i);
    }
  }
  const Eigen::Index size = reduced_H_.rows();
  H->resize(size, size);
  b->resize(size);
  for (Eigen::Index i = 0; i < size; ++i)
  {
    (*b)(i) = reduced_b_(order[static_cast<size_t>(i)]);
    for (Eigen::Index j = 0; j <= i; ++j)
    {
      const Eigen::Index row = std::max(order[static_cast<size_t>(i)], order[static_cast<size_t>(j)]);
      const Eigen::Index column = std::min(order[static_cast<size_t>(i)], order[static_cast<size_t>(j)]);
      (*H)(i, j) = reduced_H_(row, column);
      (*H)(j, i) = reduced_H_(row, column);
    }
  }
}

Matrix15d NormalEquations::lastCovariance() const
{
  // The inverse's last block is that of the last block of the triangular factor.
  const Eigen::Index at = factor_.rows() - 15;
  const Matrix15d L = factor_.block<15, 15>(at, at).triangularView<Eigen::Lower>();
  const Matrix15d L_inverse = L.triangularView<Eigen::Lower>().solve(Matrix15d::Identity());
  return L_inverse.transpose() * L_inverse;
}

namespace
{

/// H, b and cost at the states of now, landmarks not yet eliminated.
double linearize(WindowProblem* problem, const std::vector<Landmark*>& use, NormalEquations* equations)
{
  equations->reset(*problem);
  equations->addPrior(*problem);
  for (size_t i = 0; i < problem->links.size(); ++i)
  {
    equations->addLink(*problem, i);
  }
  for (Landmark* const landmark : use)
  {
    equations->addLandmark(*problem, landmark);
  }
  return equations->cost();
}

}  // namespace

WindowReport solveSchur(WindowProblem* problem, const std::vector<Landmark*>& use, int max_iterations,
                        NormalEquations* equations)
{
  WindowReport report;
  double damping = 1e-5;
  double cost = linearize(problem, use, equations);
  std::vector<Keyframe> before;
  Eigen::VectorXd step;
  bool done = false;
  while (!done && report.iterations < max_iterations)
  {
    ++report.iterations;
    equations->eliminate(damping);
    if (!equations->solve(&step))
    {
      damping = std::max(damping * 100.0, 1e-3);
      continue;
    }
    before = problem->keyframes;
    for (size_t i = 0; i < problem->keyframes.size(); ++i)
    {
      problem->keyframes[i].state.boxPlus(step.segment<15>(static_cast<Eigen::Index>(15 * i)));
    }
    equations->moveLandmarks(step);
    const double next = linearize(problem, use, equations);
    if (next <= cost)
    {
      done = cost - next < 1e-5 * std::abs(cost) + 1e-6;
      cost = next;
      damping = std::max(damping * 0.2, 1e-7);
    }
    else
    {
      problem->keyframes = before;
      equations->restoreLandmarks();
      linearize(problem, use, equations);
      damping *= 20.0;
      done = damping > 1e8;
    }
  }
  equations->eliminate(0.0);
  report.failed = !std::isfinite(cost) || !equations->solve(&step);
  if (!report.failed)
  {
    equations->storeCovariances();
  }
  return report;
}

void marginalizeOldest(WindowProblem* problem, const std::vector<Landmark*>& leaving, NormalEquations* equations)
{
  equations->reset(*problem);
  equations->addPrior(*problem);
  equations->addLink(*problem, 0);
  size_t known = std::max<size_t>(problem->prior.linearized.size(), 2);
  for (Landmark* const landmark : leaving)
  {
    equations->addLandmark(*problem, landmark);
    known = std::max(known, problem->slot(landmark->views.back()) + 1);
  }
  equations->eliminate(0.0);

  // Of the states that something is known of, those but the first stay.
  Eigen::MatrixXd H;
  Eigen::VectorXd b;
  equations->reduced(&H, &b);
  const Eigen::Index rest = static_cast<Eigen::Index>(15 * (known - 1));
  const Eigen::LDLT<Matrix15d> oldest(H.topLeftCorner<15, 15>());
  const Eigen::MatrixXd pull = oldest.solve(H.block(0, 15, 15, rest));
  Prior prior;
  prior.H = H.block(15, 15, rest, rest) - H.block(15, 0, rest, 15) * pull;
  prior.H = (0.5 * (prior.H + prior.H.transpose())).eval();
  prior.b = b.segment(15, rest) - pull.transpose() * b.head<15>();
  Eigen::VectorXd moved(rest);
  for (size_t i = 1; i < known; ++i)
  {
    // b is the gradient at the states of now, which need not be where the prior is linearised.
    prior.linearized.push_back(linearizationPoint(*problem, i));
    moved.segment<15>(static_cast<Eigen::Index>(15 * (i - 1))) =
        problem->keyframes[i].state.boxMinus(prior.linearized.back());
  }
  prior.b -= prior.H * moved;
  prior.marginal = true;
  problem->prior = std::move(prior);
  problem->keyframes.erase(problem->keyframes.begin());
  problem->links.erase(problem->links.begin());
  ++problem->first_keyframe;
}

}  // namespace pi_slam::estimator
