#pragma once

#include <pi_runtime/runtime.h>

namespace pi_detect
{

/// Where the runtime cannot interrupt a long stage: OpenCV works on the thread of the stage alone, in this process from
/// now on, and calls Stage::yield() between the pieces that its own pool would have got. So a network is cut into
/// pieces of a layer's stripes, with the same results. OpenCV's pool has threads of its own that no admission test
/// knows.
///
/// Elsewhere OpenCV's pool stays: its threads take what jobs with real-time priority leave.
/// Not while another thread works with OpenCV.
/// @param threads  of OpenCV, as the user wants them; above 0 nothing is changed.
void cutStages(const pi_runtime::Runtime& runtime, int threads);

}  // namespace pi_detect
