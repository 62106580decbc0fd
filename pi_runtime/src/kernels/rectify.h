#pragma once

#include <array>
#include <cstdint>

#include <pi_runtime/codelet.h>
#include <pi_runtime/kernels/image_view.h>

namespace pi_runtime
{
namespace kernels
{

/// Pixel positions in a remap table are multiples of 1 / 2^5 px.
constexpr int REMAP_FRACTION_BITS = 5;

/// How a lens bends rays; both as in OpenCV's calib3d.
enum class LensModel : uint8_t
{
  RADTAN,       ///< k1, k2, p1, p2, k3 (Brown 1971; k3 = 0 for the four-parameter form)
  EQUIDISTANT,  ///< k1, k2, k3, k4 (Kannala and Brandt 2006; cv::fisheye)
};

/// A real camera: intrinsics [px] and distortion.
struct CameraIntrinsics
{
  LensModel model = LensModel::RADTAN;
  double fx = 0.0;
  double fy = 0.0;
  double cx = 0.0;
  double cy = 0.0;
  std::array<double, 5> distortion{};  ///< in the order of its model; entries that the model does not have are ignored
};

/// The ideal pinhole camera whose image is to be made, at the place of the real one.
struct RectifiedCamera
{
  std::array<double, 9> R_rect_cam{1, 0, 0, 0, 1, 0, 0, 0, 1};  ///< rotation, row-major: camera to rectified frame
  double fx = 0.0;                                              ///< [px]
  double fy = 0.0;
  double cx = 0.0;
  double cy = 0.0;
};

/// For each pixel of the rectified image, where the real one has it (as cv::initUndistortRectifyMap and
/// cv::fisheye::initUndistortRectifyMap with CV_16SC2 do, in double precision). Runs once per camera, hence no codelet.
/// @param[out] xy        width * height * 2 elements: x and y in px, rounded down. Rays that the lens cannot see
///                       (behind the camera) give -32768.
/// @param[out] fraction  width * height elements: fraction of y times 32 in bits 5 to 9, of x in bits 0 to 4.
/// @throws std::invalid_argument if a size is not positive, or a focal length is not positive and finite.
void buildRemapTable(const CameraIntrinsics& camera, const RectifiedCamera& rectified, int width, int height,
                     int16_t* xy, uint16_t* fraction);

/// Bilinear image warp by a table as above: out = (sum of the four neighbours, weighted by products of 32nds, + 512)
/// >> 10. Neighbours outside the source count as 0. Bit-exact with cv::remap(INTER_LINEAR, BORDER_CONSTANT) for such
/// tables, which it also takes from cv::convertMaps.
/// @param source       1 or 3 channels of 8 bit
/// @param xy           destination.width * destination.height * 2 elements
/// @param fraction     destination.width * destination.height elements
/// @param destination  as many channels as source; must not overlap it
/// @param begin, end   rows of destination to make
void remap(const ImageView<const uint8_t>& source, const int16_t* xy, const uint16_t* fraction,
           const ImageView<uint8_t>& destination, int begin, int end);

/// Argument 4 of the codelet. Strides in bytes.
struct RemapGeometry
{
  int32_t source_width;
  int32_t source_height;
  int32_t source_stride;
  int32_t channels;  ///< 1 or 3
  int32_t width;     ///< of the destination
  int32_t height;
  int32_t stride;
};

/// "remap": remap() above. Range: rows of the destination; sliceable. Both implementations give the same bits.
///   0 in   source, uint8, source_height rows
///   1 in   xy, int16, height * width * 2
///   2 in   fraction, uint16, height * width
///   3 out  destination, uint8, height rows (inOut if the bytes between rows matter)
///   4      RemapGeometry
CodeletPtr remapCodelet();

}  // namespace kernels
}  // namespace pi_runtime
