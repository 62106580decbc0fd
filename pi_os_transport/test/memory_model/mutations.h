#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "weak_memory.h"

namespace weak_memory
{

struct NamedProgram
{
  const char* name;
  Model::Program program;
};

/// Test assertions: every program holds in all its executions.
void expectAllHold(const std::vector<NamedProgram>& programs);

/// Test assertions: each order of each operation that the programs come across, weakened by one step, breaks one of
/// them, but for those of `stronger_than_needed` (Mutation::toString() and why they stay).
/// @param at_least  mutations that have to be found, or the programs are blind.
void expectEveryOrderNeeded(const std::vector<NamedProgram>& programs,
                            const std::map<std::string, const char*>& stronger_than_needed, uint32_t at_least);

}  // namespace weak_memory
