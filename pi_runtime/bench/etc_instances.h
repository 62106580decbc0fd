#pragma once

#include <pi_runtime/etc_matrix.h>

#include <cstddef>
#include <functional>
#include <random>
#include <string>
#include <vector>

namespace pi_runtime_bench
{

/// The paper's simulation: every entry uniform in {1, ..., 30}, or in [1, 30) if `whole` is false.
pi_runtime::EtcMatrix paperEtc(size_t tasks, size_t units, bool whole, std::mt19937_64* random);

/// A kind of metatask and machine.
struct EtcClass
{
  std::string name;
  size_t tasks;
  size_t units;
  std::function<pi_runtime::EtcMatrix(std::mt19937_64* random)> draw;
};

/// The twelve range-based classes of Braun et al. (2001), in which an entry is the product of a task's and a pair's
/// random number; theirs have 512 tasks and 16 units.
std::vector<EtcClass> braunClasses(size_t tasks, size_t units);

/// Six of these with 30 tasks and 4 units, and kinds of machines seen on vehicles: CPU cores with a GPU, units that
/// cannot run everything, equal cores.
std::vector<EtcClass> etcClasses();

/// Every finite entry times a log-normal factor of median 1.
/// @param sigma standard deviation of the factor's logarithm, >= 0.
pi_runtime::EtcMatrix withNoise(const pi_runtime::EtcMatrix& etc, double sigma, std::mt19937_64* random);

}  // namespace pi_runtime_bench
