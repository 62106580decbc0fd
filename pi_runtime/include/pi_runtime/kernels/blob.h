#pragma once

#include <cstddef>
#include <cstdint>

#include <pi_runtime/codelet.h>

namespace pi_runtime::kernels
{

/// How an image fills the network input: BlobGeometry::letterbox.
enum BlobFit : int32_t
{
  BLOB_STRETCHED = 0,  ///< to the whole input
  BLOB_CENTRED = 1,    ///< keeps its aspect ratio, between bars
  BLOB_AT_TOP_LEFT =
      2  ///< keeps its aspect ratio, bars at the right or below; sides are cut to whole pixels, as in YOLOX
};

/// Size and layout of an image and of the network input made of it. Argument 3 of the codelet.
struct BlobGeometry
{
  int32_t source_width;   ///< [px], 2 to 32767
  int32_t source_height;  ///< [px], 1 to 32767
  int32_t source_stride;  ///< from row to row [bytes]
  int32_t channels;       ///< 1 or 3, interleaved, 8 bit
  int32_t width;          ///< of the network input [px], 1 to 32767
  int32_t height;
  int32_t letterbox;  ///< of BlobFit
};

/// Colours of the network input. Argument 4 of the codelet.
struct BlobColours
{
  float mean[3];    ///< subtracted from the planes of the output, in their order
  float scale[3];   ///< then multiplied, likewise
  int32_t swap_rb;  ///< 1: planes in the opposite order of the image's channels
  int32_t fill;     ///< grey level of the bars, 0 to 255
};

/// Where the picture lies in the network input [px]; the rest is bars.
struct BlobContent
{
  int32_t x;
  int32_t y;
  int32_t width;
  int32_t height;
};
BlobContent blobContent(const BlobGeometry& geometry);

/// Source pixels and weights of each column and row. Make it once per geometry; tasks share it. Content, int32, with
/// columns = width rounded up to 16: offset of the left pixel in its row [bytes] (columns), its weight in the low half
/// and its right neighbour's in the high half (columns), upper row (height), lower row (height), weights likewise
/// (height). Weights are 2048ths, rounded as cv::resize does.
/// @throws std::invalid_argument naming the field that is out of its bounds.
BufferPtr makeBlobPlan(const BlobGeometry& geometry);
size_t blobPlanBytes(const BlobGeometry& geometry);

/// "blob": resizes an image and makes planes of (value - mean) * scale (HWC to CHW), as cv::dnn::blobFromImage does
/// with ddepth CV_32F. Resized grey levels equal those of cv::resize(INTER_LINEAR) bit for bit, except if the image is
/// exactly twice as large: OpenCV then averages areas (at most 1 level apart). Both implementations give the same bits.
/// Range: rows of the destination; sliceable.
///   0 in   source, uint8, source_height rows
///   1 in   plan, of makeBlobPlan() for the same geometry
///   2 out  destination, float, channels * height * width
///   3      BlobGeometry
///   4      BlobColours
CodeletPtr blobCodelet();

/// The native twin: rows [begin, end) of all planes.
/// @param plan         content of makeBlobPlan() for this geometry
/// @param destination  channels * height * width
void makeBlob(const uint8_t* source, const int32_t* plan, const BlobGeometry& geometry, const BlobColours& colours,
              int begin, int end, float* destination);

}  // namespace pi_runtime::kernels
