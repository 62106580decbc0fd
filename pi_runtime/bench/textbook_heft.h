#pragma once

#include <pi_runtime/etc_matrix.h>
#include <pi_runtime/task_graph.h>
#include <pi_runtime/transfer_model.h>

namespace pi_runtime_bench
{

/// Two schedulers written down step by step from their papers, sharing no code with pi_runtime::InnerCoreScheduler: the
/// baseline of bench_dag and the reference of its tests. Slow, and simple enough to be checked by eye. Ties as there.
/// Every node must have a unit that can run it. Both return the makespan [s].

/// HEFT with insertion: Topcuoglu, Hariri, Wu 2002, section 4.2.
double textbookHeft(const pi_runtime::TaskGraph& graph, const pi_runtime::EtcMatrix& etc,
                    const pi_runtime::TransferModel& transfers);

/// Bittencourt, Sakellariou, Madeira 2010: for every unit a copy of the schedule in which the children are tried.
double textbookLookahead(const pi_runtime::TaskGraph& graph, const pi_runtime::EtcMatrix& etc,
                         const pi_runtime::TransferModel& transfers);

}  // namespace pi_runtime_bench
