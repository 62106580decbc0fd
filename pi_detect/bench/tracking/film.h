#pragma once

#include <pi_detect/picture_motion.h>

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>
#include <string>
#include <vector>

#include "tracking/mot_metrics.h"

namespace pi_detect
{

/// A part of the picture that may move, as if the camera turned.
struct Window
{
  int width = 0;       ///< [px]; 0: the whole picture
  int start = 0;       ///< left edge in the first picture [px]
  double speed = 0.0;  ///< of the pan; below 0: to the left at first [px/s]. It turns back at the picture's edges.
};

/// The pictures of a recording in which the truth is known.
struct Film
{
  TruthTracks truth;
  double frame_rate = 0.0;        ///< [Hz]
  std::vector<cv::Mat> pictures;  ///< of the window; BGR
  std::vector<int> left;          ///< edge of the window in the recording's picture, of each [px]

  /// @param frame_rate  0: that of the recording.
  /// @throws std::runtime_error naming the file and what is wrong with it, std::invalid_argument for a window that does
  ///         not fit.
  static Film load(const std::string& video, const std::string& truth, double frame_rate, const Window& window);

  /// How the pan moved the picture from one picture to a later one.
  PictureMotion motion(size_t from, size_t to) const;
};

/// What of the truth a window shows. A box is cut at the window's edges and shifted into it. Where less than half of a
/// box is inside, what is inside becomes an ignored region, and an object that comes back has a new id.
/// @param left  edge of the window in each picture [px].
TruthTracks throughWindow(const TruthTracks& truth, const std::vector<int>& left, int width);

}  // namespace pi_detect
