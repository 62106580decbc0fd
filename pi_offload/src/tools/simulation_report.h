#pragma once

#include "simulation/simulation.h"

#include <cstdint>
#include <string>
#include <vector>

namespace pi_offload
{

/// What simulate found, as text.

/// A policy with its price of a miss, over all seeds.
struct Case
{
  std::string policy;
  double lambda = 0.0;
  std::vector<SimulationResult> results;  ///< by seed
};

/// Whether the price of a miss makes a difference.
bool usesLambda(const std::string& policy);

/// A number in as few digits as it needs, nine at most.
std::string plain(double value);

/// One line per case and seed.
std::string csvText(const std::string& scenario, uint32_t first_seed, const std::vector<Case>& cases);
/// Means and standard deviations over the seeds.
std::string jsonText(const std::string& scenario, uint32_t first_seed, const std::vector<Case>& cases);
void printTable(const std::vector<Case>& cases);
/// Why tasks that went to nodes came home, and why deadlines were missed, per run.
void printCauses(const std::vector<Case>& cases);

}  // namespace pi_offload
