#include "estimator/window_problem.h"

#include <pi_slam/so3.h>

#include <Eigen/Cholesky>
#include <algorithm>

namespace pi_slam::estimator
{

Turn::Turn(const ImuCorrection& due, const NavState& state, double gravity)
  : centre(state.p), R_body_imu(due.R_body_imu)
{
  const Eigen::Vector3d up(0.0, 0.0, 1.0);
  const Eigen::Vector3d up_body = state.q.conjugate() * up;
  const Eigen::Vector3d bias = R_body_imu * state.bias.accel;
  const Eigen::Vector3d most = gravity * (R_body_imu * up_body - up_body);
  const double part = most.isZero() ? 0.0 : std::clamp(-bias.dot(most) / most.squaredNorm(), 0.0, 1.0);
  accel_bias = part * most;
  const Eigen::Quaterniond tilt = Eigen::Quaterniond::FromTwoVectors(up, state.q * (R_body_imu.transpose() * up_body));
  R_turn = expSo3((1.0 - part) * logSo3(tilt)).toRotationMatrix();
}

void Turn::apply(NavState* state) const
{
  state->p = centre + R_turn * (state->p - centre);
  state->q = (Eigen::Quaterniond(R_turn) * state->q).normalized();
  state->v = R_turn * state->v;
  state->bias.gyro = R_body_imu * state->bias.gyro;
  state->bias.accel = R_body_imu * state->bias.accel + accel_bias;
}

void Prior::turn(const Turn& turn)
{
  Matrix15d T = Matrix15d::Identity();  // errors of attitude are in the body frame, which stays
  T.block<3, 3>(0, 0) = turn.R_turn;
  T.block<3, 3>(6, 6) = turn.R_turn;
  T.block<3, 3>(9, 9) = turn.R_body_imu;
  T.block<3, 3>(12, 12) = turn.R_body_imu;
  for (Eigen::Index at = 0; at < H.rows(); at += 15)
  {
    H.middleRows<15>(at) = (T * H.middleRows<15>(at)).eval();
    H.middleCols<15>(at) = (H.middleCols<15>(at) * T.transpose()).eval();
    b.segment<15>(at) = (T * b.segment<15>(at)).eval();
  }
  for (NavState& state : linearized)
  {
    turn.apply(&state);
  }
}

void Prior::loosen(const Eigen::MatrixXd& errors)
{
  // (H^-1 + E E^T)^-1 by the matrix inversion lemma, which needs no inverse of H.
  const Eigen::MatrixXd HE = H * errors;
  Eigen::MatrixXd S = errors.transpose() * HE;
  S.diagonal().array() += 1.0;
  const Eigen::LLT<Eigen::MatrixXd> factor(S);
  b -= HE * factor.solve(errors.transpose() * b);
  H -= HE * factor.solve(HE.transpose());
  H = (0.5 * (H + H.transpose())).eval();
}

}  // namespace pi_slam::estimator
