#pragma once

#include <array>
#include <cstdint>
#include <cstdlib>
#include <deque>
#include <optional>
#include <utility>

namespace pi_node
{

/// Brings together what two cameras took at nearly the same time, as soon as the second picture comes; the approximate
/// time policy of message_filters would wait for the next one. Each picture is used once. A camera whose stamps go back
/// begins anew. Not thread safe.
/// @tparam StampOf  gives the stamp of a picture [ns].
template <typename Picture, typename StampOf>
class StereoPairs
{
public:
  static constexpr size_t MOST_WAITING = 8;  ///< pictures of a camera whose partner is silent

  /// @param most_ns  between the two; below half a period a picture has at most one partner, which is the nearest.
  explicit StereoPairs(int64_t most_ns) : most_ns_(most_ns) {}

  /// A picture came. @param side  0: left, 1: right.
  std::optional<std::pair<Picture, Picture>> add(size_t side, Picture picture)
  {
    const StampOf stamp_of;
    if (!waiting_[side].empty() && stamp_of(picture) <= stamp_of(waiting_[side].back()))
    {
      clear();
    }
    waiting_[side].push_back(std::move(picture));
    auto& [left, right] = waiting_;
    while (!left.empty() && !right.empty())
    {
      difference_ns_ = stamp_of(right.front()) - stamp_of(left.front());
      if (std::abs(difference_ns_) <= most_ns_)
      {
        std::pair<Picture, Picture> pair(std::move(left.front()), std::move(right.front()));
        left.pop_front();
        right.pop_front();
        return pair;
      }
      drop(difference_ns_ > 0 ? &left : &right);
    }
    if (waiting_[side].size() > MOST_WAITING)
    {
      drop(&waiting_[side]);
    }
    return std::nullopt;
  }

  /// Forgets what waits.
  void clear()
  {
    waiting_[0].clear();
    waiting_[1].clear();
  }

  /// Pictures without a partner.
  uint64_t dropped() const { return dropped_; }
  /// Right - left, of the two compared last [ns].
  int64_t difference() const { return difference_ns_; }

private:
  void drop(std::deque<Picture>* waiting)
  {
    waiting->pop_front();
    ++dropped_;
  }

  const int64_t most_ns_;
  std::array<std::deque<Picture>, 2> waiting_;
  uint64_t dropped_ = 0;
  int64_t difference_ns_ = 0;
};

}  // namespace pi_node
