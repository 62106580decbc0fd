#pragma once

#include <pi_slam/stereo_calibration.h>
#include "map/mapper.h"

#include <cstdint>
#include <functional>
#include <iosfwd>
#include <string>
#include <vector>

#include "map/map_data.h"

namespace pi_slam::map
{

/// The content of a map file, little-endian:
///   magic "PISLMAP" and a zero, version (u32), 0 (u32), length of the whole file (u64)
///   calibration, per camera: width, height (i32), fx, fy, cx, cy (f64), distortion (i32), first 4 coefficients (f64),
///     position and quaternion x, y, z, w of T_body_camera (7 f64)
///   number of nodes and edges (u64), then nodes and edges one after the other
///   from version 2 on: number of patches of the grid (u64), then each: segment (u32), way, corner and cell (4 f64),
///     width and height (u32), cells (i8)
///   from version 3 on: whether an origin on earth is known (u32), its latitude, longitude [degrees] and height (3
///   f64);
///     whether the place on earth is known (u32), its x, y, z and heading (4 f64); number of fixes (u64), then each:
///     node (u32), shift, place (3 f64 each), deviations (2 f64)
///   CRC-64 (ECMA-182, reflected, as in XZ) of all bytes before (u64)
/// Node by node, so that features that lie on disk do not come into memory together.
/// @throws MapError if such features cannot be read.
void encodeMap(const MapData& map, const StereoCalibration& calibration, std::ostream* stream);

/// @param stream  with `size` bytes; can be read twice.
/// @param name    of the file, for messages.
/// @param taken   called with each node, which may bring its features to the disk.
/// @throws MapError for anything but what encodeMap() makes, with numbers in range, or a map of cameras of another size
///         than those of `calibration`.
MapData decodeMap(std::istream* stream, uint64_t size, const StereoCalibration& calibration, const std::string& name,
                  const std::function<void(MapNode*)>& taken);

/// A set of features as in a map file, without their number.
std::vector<uint8_t> encodeFeatures(const FeatureSet& set);
/// @throws MapError for anything but what encodeFeatures() makes of `count` features.
FeatureSetPtr decodeFeatures(const std::vector<uint8_t>& bytes, size_t count, const std::string& name);

/// @throws MapError as encodeMap(), or for a file that cannot be written.
void writeMap(const std::string& file, const MapData& map, const StereoCalibration& calibration);
/// @throws MapError as decodeMap(), or for a file that cannot be read.
MapData readMap(const std::string& file, const StereoCalibration& calibration,
                const std::function<void(MapNode*)>& taken);

/// Writes beside the file, brings that to the disk, and puts it in the file's place.
/// @throws MapError
void writeFileAtomically(const std::string& file, const std::function<void(std::ostream*)>& write);

uint64_t crc64(const uint8_t* bytes, size_t count);

}  // namespace pi_slam::map
