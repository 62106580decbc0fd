#pragma once

#include <cstdlib>

namespace pi_node::test_support
{

/// How often a statistical or soak test repeats: `brief` times in "make check", `full` times in "make soak".
inline int repetitions(int brief, int full)
{
  return std::getenv("PI_EDGE_SOAK") != nullptr ? full : brief;
}

}  // namespace pi_node::test_support
