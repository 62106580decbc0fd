#pragma once

#include "decision/pose_keeper.h"

#include <optional>
#include <string>

namespace pi_vehicle
{

/// Writes a pose with the time of the computer's clock: beside the file first, then in its place.
/// @throws std::runtime_error naming the file, the reason and the way out.
void writeSavedPose(const std::string& file, const std::string& map_frame, const SavedPose& pose);

/// @return nullopt: there is no such file.
/// @throws std::invalid_argument for a file that is damaged, of another map_frame, older than max_age_s, or of the
///         future; names file, value and bound.
std::optional<SavedPose> readSavedPose(const std::string& file, const std::string& map_frame, double max_age_s);

}  // namespace pi_vehicle
