#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include <pi_runtime/codelet.h>

namespace pi_runtime::kernels
{

/// A default box of an SSD network (Liu et al. 2016), in parts of the image's width and height.
struct SsdPrior
{
  float cx;
  float cy;
  float width;
  float height;
};

struct SsdBoxSize
{
  float width;
  float height;
};

/// Default boxes of one feature map: the same sizes in each of its cells.
struct SsdFeatureMap
{
  int columns;
  int rows;
  std::vector<SsdBoxSize> boxes;
  float offset = 0.5F;  ///< of the centres in their cells [cells]
  float step_x = 0.0F;  ///< from cell to cell, in parts of the image; 0: 1 / columns
  float step_y = 0.0F;  ///< likewise; 0: 1 / rows
};

/// All default boxes, by feature map, row, column, box: the order of a network's outputs (as Caffe's PriorBox).
/// @param clip  cuts boxes at the image's border, as PriorBox does with clip
/// @throws std::invalid_argument naming a feature map without cells or boxes.
std::vector<SsdPrior> makeSsdPriors(const std::vector<SsdFeatureMap>& maps, bool clip);

/// How scores are made of confidences, and other choices: bits of SsdShape::flags.
enum SsdFlags : int32_t
{
  SSD_RAW = 0,             ///< confidences are scores
  SSD_SOFTMAX = 1,         ///< over the classes of a prior, background included
  SSD_SIGMOID = 2,         ///< of each
  SSD_CLASS_AGNOSTIC = 4,  ///< boxes of different classes suppress each other, too
  SSD_CLIP = 8,            ///< boxes are cut at the image's border (after suppression)
};

/// Argument 6 of the codelet.
struct SsdShape
{
  int32_t priors;           ///< 1 to 65536
  int32_t classes;          ///< 1 to 1024, background included
  int32_t background;       ///< class that is no object; -1: there is none
  int32_t top_k;            ///< candidates per class (all classes together if agnostic) that suppression looks at
  int32_t keep_top_k;       ///< detections at most, 1 to 1024
  float score_threshold;    ///< score of a detection, at least; in (0, 1]
  float overlap_threshold;  ///< a box is suppressed if its intersection over union with a better one is above this
  int32_t flags;            ///< of SsdFlags
};

/// Argument 7 of the codelet: factors of the four locations; 0.1, 0.1, 0.2, 0.2 are usual.
struct SsdVariances
{
  float x;
  float y;
  float width;
  float height;
};

/// A row of OpenCV's DetectionOutput.
struct SsdDetection
{
  float image;  ///< 0
  float class_id;
  float score;
  float x1;  ///< corners in parts of the image
  float y1;
  float x2;
  float y2;
};

/// Size of the memory for intermediate results [B].
size_t ssdWorkBytes(const SsdShape& shape);

/// Detections of an SSD network: (1) scores of the confidences, (2) per class the top_k candidates not below the
/// threshold, (3) boxes from priors p and locations l (cx = p.cx + l.x v.x p.width, width = p.width exp(l.z v.width),
/// likewise the others), (4) greedy suppression per class, (5) until the best keep_top_k of all classes are found.
/// Detections are ordered by score, then class, then prior. As OpenCV's DetectionOutput with code type CENTER_SIZE and
/// shared locations, which orders by class. Values must be finite.
/// @param locations    4 per prior: x, y, width, height (TensorFlow's y, x, height, width must be swapped first)
/// @param confidences  classes per prior
/// @param detections   room for keep_top_k
/// @return their number
int postprocessSsd(const float* locations, const float* confidences, const SsdPrior* priors, const SsdShape& shape,
                   const SsdVariances& variances, void* work, SsdDetection* detections);

/// "ssd_postprocess": postprocessSsd() above. Range: 1. Both implementations give the same bits on devices that divide
/// floats with correct rounding (CPUs do). Elsewhere scores may differ in the last two bits, and so may the order of
/// equal scores. Steps 3 to 5 are sequential: one work item on the device.
///   0 in   locations, float, priors * 4
///   1 in   confidences, float, priors * classes
///   2 in   SsdPrior, priors
///   3 out  work, ssdWorkBytes()
///   4 out  SsdDetection, keep_top_k; elements behind the found ones stay unchanged
///   5 out  int32: number of detections
///   6      SsdShape
///   7      SsdVariances
CodeletPtr ssdPostprocessCodelet();

}  // namespace pi_runtime::kernels
