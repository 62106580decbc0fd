#pragma once

#include <cstddef>
#include <cstdint>
#include <mutex>
#include <string>
#include <vector>

#include "policies/cost_model.h"
#include "wire/wire_message.h"

namespace pi_offload
{

/// A picture. The caller owns its pixels.
struct PictureData
{
  const uint8_t* data = nullptr;
  int width = 0;                       ///< [px]
  int height = 0;                      ///< [px]
  size_t stride = 0;                   ///< from row to row [bytes]
  Encoding encoding = Encoding::BGR8;  ///< BGR8, RGB8 or MONO8

  /// @throws std::invalid_argument for missing pixels, a side outside of 1 to 16384, a stride shorter than a row, or
  ///   another encoding.
  void validate() const;
  size_t bytes() const;  ///< raw, without gaps between rows
};

enum class PictureMode
{
  AUTO,  ///< the cheaper one
  JPEG,
  RAW,
};
const char* toString(PictureMode mode);

/// Encodes pictures as JPEG or raw, whichever costs less at the rate of the link, by the time and size of the last
/// JPEGs. Thread safe.
class PictureEncoder
{
public:
  struct Options
  {
    PictureMode mode = PictureMode::AUTO;
    int jpeg_quality = 85;                   ///< 1 to 100
    size_t max_raw_bytes = 4U << 20U;        ///< larger pictures are sent as JPEG
    double first_jpeg_s_per_mpixel = 0.012;  ///< until one is measured [s per 10^6 pixels]
    double first_jpeg_bytes_per_pixel = 0.3;
    int retry_after = 100;  ///< after so many raw pictures in a row, one JPEG is made to measure again

    /// @throws std::invalid_argument naming field, value and bound.
    void validate() const;
  };
  /// Input of the choice, which uses normalisedCost().
  struct Situation
  {
    double rate_mbps = 10.0;
    double deadline_s = 0.2;
    double eta = 0.5;
    double local_energy_j = 0.42;  ///< of the task on the vehicle
    double busy_w = 4.2;           ///< of the vehicle's computer while encoding
    double transmit_w = 1.2;
  };
  explicit PictureEncoder(const Options& options);

  /// @return JPEG, or the picture's own encoding for raw.
  Encoding choose(const PictureData& picture, const Situation& situation) const;
  /// Expected size [bytes].
  size_t expectedBytes(const PictureData& picture, Encoding encoding) const;

  /// @param encoding  that choose() gave.
  /// @throws std::invalid_argument for the picture, std::runtime_error if it cannot be encoded.
  std::vector<uint8_t> encode(const PictureData& picture, Encoding encoding);

  double jpegSecondsPerMpixel() const;
  double jpegBytesPerPixel() const;

private:
  const Options options_;
  mutable std::mutex mutex_;  ///< of all below
  double jpeg_s_per_mpixel_;
  double jpeg_bytes_per_pixel_;
  bool measured_ = false;
  int raw_in_row_ = 0;
};

}  // namespace pi_offload
