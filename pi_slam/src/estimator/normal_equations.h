#pragma once

#include "estimator/window_problem.h"

#include <Eigen/Core>
#include <vector>

namespace pi_slam::estimator
{

/// The normal equations of a window with landmarks eliminated one by one (Schur complement): H d = -b for the errors of
/// all states, 15 each in the order of NavState. Keeps its memory between calls. Not thread safe.
///
/// Inside, velocities and biases of all states but the last come first, newest to oldest, then all poses, then velocity
/// and biases of the last state: since they are tied to neighbours only, the factor stays sparse, and what belongs to
/// the last state is its last block.
class NormalEquations
{
public:
  /// Begins with zeros for the states of now.
  void reset(const WindowProblem& problem);

  void addPrior(const WindowProblem& problem);
  void addLink(const WindowProblem& problem, size_t link);
  /// Adds the views of a landmark; it is eliminated by eliminate().
  void addLandmark(const WindowProblem& problem, Landmark* landmark);

  /// Makes the reduced equations, without the landmarks, with the diagonals of their blocks and of H raised by the
  /// factor 1 + damping. May be called again with another damping.
  void eliminate(double damping);

  /// Solves for the errors of the states. @return false if H is not positive definite. After eliminate().
  bool solve(Eigen::VectorXd* step);
  /// Moves the landmarks, given the step of the states.
  void moveLandmarks(const Eigen::VectorXd& step);
  /// Puts the landmarks back where they were before moveLandmarks().
  void restoreLandmarks();
  /// Covariance of each landmark given the states into its estimate. After eliminate(0).
  void storeCovariances();

  double cost() const { return cost_; }  ///< robust cost of what was added
  /// The reduced equations in the order of the states. After eliminate().
  void reduced(Eigen::MatrixXd* H, Eigen::VectorXd* b) const;
  /// Covariance of the last state. After solve().
  Matrix15d lastCovariance() const;

private:
  struct Coupling
  {
    Eigen::Index at;                ///< of the pose
    Eigen::Matrix<double, 6, 3> W;  ///< pose and landmark
  };
  struct Entry
  {
    Landmark* landmark;
    Eigen::Matrix3d H;
    Eigen::Vector3d b;
    Eigen::Matrix3d H_inverse;
    Eigen::Vector3d before;
    size_t first;  ///< of couplings_
    size_t count;
  };

  Eigen::Index poseAt(size_t state) const;
  Eigen::Index speedAt(size_t state) const;
  template <int ROWS, int COLS, typename Derived>
  void addBlock(Eigen::Index row, Eigen::Index column, const Eigen::MatrixBase<Derived>& block);
  bool factorize();

  size_t states_ = 0;
  Eigen::MatrixXd H_;  ///< lower triangle, with landmarks not eliminated
  Eigen::VectorXd b_;
  Eigen::MatrixXd reduced_H_;
  Eigen::VectorXd reduced_b_;
  Eigen::MatrixXd factor_;
  Eigen::VectorXd solution_;
  std::vector<Entry> entries_;
  std::vector<Coupling> couplings_;
  std::vector<BodyPose> bodies_;             ///< of the states
  std::vector<BodyPose> linearized_bodies_;  ///< where derivatives are taken
  double cost_ = 0.0;
};

/// Levenberg-Marquardt on these equations.
/// @param use  landmarks that take part.
/// @return what was done; equations hold H, b at the end without damping, and its factorisation.
WindowReport solveSchur(WindowProblem* problem, const std::vector<Landmark*>& use, int max_iterations,
                        NormalEquations* equations);

/// Takes the oldest state out, with the landmarks of `leaving`, whose views must all be in the window, into the prior.
void marginalizeOldest(WindowProblem* problem, const std::vector<Landmark*>& leaving, NormalEquations* equations);

}  // namespace pi_slam::estimator
