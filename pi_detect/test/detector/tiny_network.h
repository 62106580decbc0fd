#pragma once

#include <string>

namespace pi_detect
{

enum class TinyOutput
{
  DETECTIONS,    ///< with a DetectionOutput layer
  GRID,          ///< per cell a box, objectness and scores
  DISTRIBUTION,  ///< per cell scores and distributions of distances
};

/// Writes a detector without learned weights into a folder: tiny.prototxt and tiny.yaml. It divides a picture into 4 x
/// 4 cells; where a cell is bright it reports class 1, "bright", with a box a quarter of the picture wide and high.
/// Score: 1 / (1 + exp(-8 * b)) for a mean level b in -1 (black) to 1 (white), or nearly. Class 2, "dark", never comes.
/// @return path of tiny.yaml. @throws std::runtime_error if the folder cannot be written.
std::string writeTinyNetwork(const std::string& folder, TinyOutput output = TinyOutput::DETECTIONS);

}  // namespace pi_detect
