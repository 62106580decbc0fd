#pragma once

#include <pi_runtime/etc_matrix.h>
#include <pi_runtime/inter_core_scheduler.h>

namespace pi_runtime_bench
{

/// Runs an assignment in a model in which tasks take their actual times: every unit works through its queue in the
/// assigned order, without preemption.
/// @param etc      what the scheduler believed.
/// @param actual   how long the tasks really take, same size.
/// @param stealing an idle unit takes the waiting task of another one for which, by the believed times, the later end
/// of
///                 the two comes earlier by most compared with that other unit's end before.
/// @return when the last task is done.
double actualMakespan(const pi_runtime::EtcMatrix& etc, const pi_runtime::EtcMatrix& actual,
                      const pi_runtime::Assignment& assignment, bool stealing);

}  // namespace pi_runtime_bench
