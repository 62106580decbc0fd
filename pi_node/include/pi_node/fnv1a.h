#pragma once

#include <cstdint>
#include <string_view>

namespace pi_node
{

/// FNV-1a of 64 bits: the same in every program and version, which std::hash does not promise. Not against intent.
constexpr uint64_t fnv1a(std::string_view bytes)
{
  uint64_t hash = 14695981039346656037ULL;
  for (const char byte : bytes)
  {
    hash = (hash ^ static_cast<unsigned char>(byte)) * 1099511628211ULL;
  }
  return hash;
}

}  // namespace pi_node
