#pragma once

#include <sys/types.h>

#include <array>
#include <cstddef>
#include <cstdint>

#include "wire/frame_transport.h"

namespace pi_os_transport
{

// SP over TCP (nanomsg, rfc/sp-tcp-mapping-01.txt): each end first sends an SP header with the number of its socket
// type. Each message is its length (64 bits, network byte order) and its bytes.
constexpr size_t GREETING_BYTES = 8;
constexpr std::array<uint8_t, GREETING_BYTES> PUSH_GREETING{0, 'S', 'P', 0, 0, 0x50, 0, 0};
constexpr std::array<uint8_t, GREETING_BYTES> PULL_GREETING{0, 'S', 'P', 0, 0, 0x51, 0, 0};
constexpr size_t LENGTH_BYTES = 8;
constexpr size_t HEAD_BYTES = LENGTH_BYTES + FrameHeader::BYTES;

/// Sets the options of both ends. With keep-alive, a dead machine or link is noticed although nothing is sent.
void setCommonOptions(int fd);
CloseReason reasonOf(int error);
bool isTemporary(int error);

}  // namespace pi_os_transport
