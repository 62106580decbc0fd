#pragma once

#include "estimator/window_problem.h"

namespace pi_slam::estimator
{

/// Position of a landmark from its views: the point nearest to all rays, then Gauss-Newton on the reprojection error.
/// Sets estimate.p_odom, estimate.covariance and known.
/// @param max_error  largest mean error of a view that is believed [standard deviations].
/// @return false, and known unset, if the rays are nearly parallel, meet behind a camera, or do not meet.
bool triangulate(const WindowProblem& problem, double max_error, Landmark* landmark);

}  // namespace pi_slam::estimator
