#pragma once

#include <cstdint>
#include <vector>

#include "image_codec/image_codec.h"

namespace pi_os_transport
{

/// Compresses or restores one image as CodecHeader describes it. The data may be hostile.
/// @param data  of the request; replaced by that of the answer.
/// @param max_bytes  no answer is larger [B].
/// @return the header of the answer
CodecHeader convertImage(const CodecHeader& request, std::vector<uint8_t>* data, uint64_t max_bytes);

}  // namespace pi_os_transport
