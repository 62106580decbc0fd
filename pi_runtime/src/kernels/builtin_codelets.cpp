#include "kernels/builtin_codelets.h"

#include <pi_runtime/kernels/blob.h>
#include <pi_runtime/kernels/fast_corners.h>
#include <pi_runtime/kernels/hamming.h>
#include <pi_runtime/kernels/lucas_kanade.h>
#include <pi_runtime/kernels/pyramid.h>

namespace pi_runtime::kernels
{

// The texts follow the headers, where the exact definitions are. Fields of structs are 4 bytes each, in this order.
void registerBuiltinCodelets(CodeletRegistry& registry)
{
  registry.add({blobCodelet(), "resizes an 8-bit image and makes the planes of a network input of it",
                "0 in uint8[source_height * source_stride]; 1 in plan of makeBlobPlan(); "
                "2 out float[channels * height * width]; "
                "3 value {source_width, source_height, source_stride, channels, width, height, letterbox}; "
                "4 value {float mean[3], float scale, swap_rb, fill}; range: height"});
  registry.add({fastCornersCodelet(), "FAST-9 corners with non-maximum suppression",
                "0 in uint8[height * stride]; 1 out {uint16 x, uint16 y, int32 score}[capacity]; "
                "2 out uint32 number of corners found; 3 out working memory of fastCornersWorkBytes(); "
                "4 value {width, height, stride, threshold, capacity}; range: 1"});
  registry.add({hammingCodelet(), "the two nearest of a set of 256-bit descriptors to each of another",
                "0 in uint8 queries[32 each]; 1 in uint8 trains[32 each]; "
                "2 out {int32 best, second, best_distance, second_distance} per query; "
                "3 value {queries, trains}; range: queries"});
  registry.add({imagePyramidCodelet(), "all levels of the Gaussian pyramid of an 8-bit image",
                "0 in uint8[height * source_stride]; 1 out uint8[PyramidLayout::bytes]; "
                "2 value {width, height, source_stride, destination_stride, levels}; range: 1"});
  registry.add({pyramidDownCodelet(), "the next smaller level of the Gaussian pyramid of an 8-bit image",
                "0 in uint8[height * source_stride]; 1 out uint8[(height + 1) / 2 * destination_stride]; "
                "2 value {width, height, source_stride, destination_stride, levels}; range: (height + 1) / 2"});
  registry.add({trackPointsCodelet(), "tracks points from one image to the next (pyramidal Lucas-Kanade)",
                "0 in previous pyramid of image_pyramid; 1 in next pyramid; 2 in float x, y per point; "
                "3 in/out float x, y per point: guesses, then results; 4 out uint8 status per point; "
                "5 out float residual per point; 6 value TrackOptions; range: points"});
}

}  // namespace pi_runtime::kernels
