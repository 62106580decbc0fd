#pragma once

#include <cstddef>

#include "pi_os_transport/sp_stream.h"
#include "wire/frame_transport.h"

namespace pi_os_transport
{

/// What begins each SP message of a bridge.
constexpr size_t HEAD_BYTES = SP_LENGTH_BYTES + FrameHeader::BYTES;

CloseReason reasonOf(int error);
CloseReason reasonOf(const SpReader::Result& result);

}  // namespace pi_os_transport
