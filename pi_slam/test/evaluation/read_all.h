#pragma once

#include "evaluation/sequence_reader.h"

#include <cstdint>
#include <optional>
#include <variant>
#include <vector>

namespace pi_slam
{

// Of the recordings that tests make: their first pair, and from one pair or sample to the next.
constexpr int64_t START_NS = 1400000000000000000;
constexpr int64_t FRAME_NS = 50000000;
constexpr int64_t IMU_NS = 5000000;

/// What a source hands out until its end.
struct Content
{
  std::vector<StereoPair> pairs;
  std::vector<ImuSample> samples;
  std::vector<int64_t> order_ns;  ///< of everything
};

template <typename Source>
Content readAll(Source* source)
{
  Content content;
  while (std::optional<SequenceItem> item = source->next())
  {
    if (const StereoPair* pair = std::get_if<StereoPair>(&*item))
    {
      content.pairs.push_back(*pair);
      content.order_ns.push_back(pair->stamp_ns);
    }
    else
    {
      content.samples.push_back(std::get<ImuSample>(*item));
      content.order_ns.push_back(content.samples.back().stamp_ns);
    }
  }
  return content;
}

}  // namespace pi_slam
