#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "simulation/simulation.h"

namespace pi_offload
{

/// A policy with a price of a miss, and its results over all seeds.
struct Case
{
  std::string policy;
  double lambda = 0.0;
  std::vector<SimulationResult> results;  ///< by seed
};

/// Whether the policy depends on the price of a miss.
bool usesLambda(const std::string& policy);

/// A number with as few digits as needed, at most nine.
std::string plain(double value);

/// One line per case and seed.
std::string csvText(const std::string& scenario, uint32_t first_seed, const std::vector<Case>& cases);
/// Means and standard deviations over the seeds.
std::string jsonText(const std::string& scenario, uint32_t first_seed, const std::vector<Case>& cases);
void printTable(const std::vector<Case>& cases);
/// Reasons of fallbacks and of missed deadlines, per run.
void printCauses(const std::vector<Case>& cases);

}  // namespace pi_offload
