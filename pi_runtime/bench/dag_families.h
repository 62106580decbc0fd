#pragma once

#include <array>
#include <cstdint>
#include <random>

#include <pi_runtime/etc_matrix.h>
#include <pi_runtime/task_graph.h>
#include <pi_runtime/transfer_model.h>

namespace pi_runtime_bench
{

/// Shapes of task graphs on which schedulers are commonly compared, and one of a vehicle.
enum class DagFamily
{
  RANDOM,   ///< layered, 20 to 40 nodes, with the shape and out-degree parameters of Topcuoglu, Hariri, Wu 2002, 5.2
  FFT,      ///< fast Fourier transform of 4 or 8 points, as there, 5.3: 15 or 39 nodes
  GAUSS,    ///< Gaussian elimination of 5 to 8 columns, as there: 14 to 35 nodes
  MONTAGE,  ///< in the shape of the astronomy workflow Montage, 4 to 8 images: 22 to 42 nodes
  VEHICLE,  ///< stereo front end beside a tiled detection network, 18 nodes
};
constexpr std::array<DagFamily, 5> DAG_FAMILIES = {DagFamily::RANDOM, DagFamily::FFT, DagFamily::GAUSS,
                                                   DagFamily::MONTAGE, DagFamily::VEHICLE};

const char* toString(DagFamily family);

struct DagSetting
{
  uint32_t units = 4;
  bool heterogeneous = false;  ///< else a node takes the same time on every unit
  double ccr = 0.0;            ///< communicationToComputation() of the problem; 0: all units share one memory
};

struct DagProblem
{
  pi_runtime::TaskGraph graph;
  pi_runtime::EtcMatrix etc;
  pi_runtime::TransferModel transfers;
};

/// Draws one problem. The mean time of a node is uniform in (0, 2) ms; on a unit it takes the mean * (1 + U(-beta / 2,
/// beta / 2)), with beta = 0 in homogeneous settings, else drawn per graph from {0.1, 0.25, 0.5, 0.75, 1}. The bytes of
/// an edge are uniform between 0 and twice the mean that gives the CCR. Different from the paper, nodes of one level of
/// an FFT differ. VEHICLE has fixed mean times and data sizes, varied by 20 %; in heterogeneous settings its last unit
/// is an accelerator that is up to ten times as fast and cannot run some nodes.
/// @param setting  units >= 1; a ccr > 0 needs units >= 2.
DagProblem makeDagProblem(DagFamily family, const DagSetting& setting, std::mt19937_64* random);

}  // namespace pi_runtime_bench
