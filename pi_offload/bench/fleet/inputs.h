#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace pi_offload_bench
{

constexpr int PICTURE_WIDTH = 640;   ///< [px]
constexpr int PICTURE_HEIGHT = 480;  ///< [px]

/// The first 32 JPEG pictures of a folder, by name, scaled to that size and encoded with quality 85.
/// @throws std::runtime_error naming the folder if none can be read.
std::vector<std::vector<uint8_t>> loadPictures(const std::string& folder);

/// A sound file as S16LE at 16 kHz. @throws std::runtime_error naming the file and what is wrong.
std::vector<uint8_t> loadSound(const std::string& path);

}  // namespace pi_offload_bench
