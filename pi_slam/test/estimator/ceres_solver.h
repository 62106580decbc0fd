#pragma once

#include <vector>

#include "estimator/window_problem.h"

namespace pi_slam::estimator
{

/// A WindowSolver that hands the problem of the window to Ceres: the reference for the own solver, four times slower.
/// If `options` ask for it, the mounting of the cameras and the time offset of the pictures are estimated too: both
/// stay near the calibration, and change slowly from one call to the next.
WindowReport solveCeres(WindowProblem* problem, const std::vector<Landmark*>& use, int max_iterations,
                        const WindowOptions& options);

}  // namespace pi_slam::estimator
