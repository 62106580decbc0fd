#pragma once

#include <vector>

#include "estimator/window_problem.h"

namespace pi_slam::estimator
{

/// A WindowSolver that hands the problem of the window to Ceres: the reference for the own solver, four times slower.
WindowReport solveCeres(WindowProblem* problem, const std::vector<Landmark*>& use, int max_iterations);

}  // namespace pi_slam::estimator
