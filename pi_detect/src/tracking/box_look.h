#pragma once

#include <pi_detect/detection.h>
#include <pi_detect/picture_view.h>

#include <vector>

namespace pi_detect
{

/// How an object looks: distribution of the colours, or of the grey levels, in the upper and the lower half of its box
/// (for a person: jacket and trousers). Costs some 5 us.
class BoxLook
{
public:
  /// Empty: unlike nothing.
  BoxLook() = default;
  /// @param box  parts outside of the picture do not count.
  BoxLook(const PictureView& picture, const Box& box);

  /// Bhattacharyya coefficient, 0 (no colour in common) to 1 (equal); 1 also if one of the two is empty or they come
  /// from pictures with and without colours.
  double similarity(const BoxLook& other) const;

  /// Takes over a part of what is seen now, so that light and posture may change slowly. @param part  0 to 1.
  void blend(const BoxLook& seen, float part);

private:
  std::vector<float> histogram_;  ///< sum 1; empty: nothing was seen
};

}  // namespace pi_detect
