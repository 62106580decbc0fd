#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <string>

#include "wire/wire_frame.h"

namespace pi_os_transport
{

/// Timeout of a connection attempt. TCP would wait a second before it sends again; the next attempt sends at once.
constexpr std::chrono::milliseconds SP_CONNECT_TIME{300};
/// Every third attempt waits longer, for distant peers.
constexpr std::chrono::milliseconds SP_CONNECT_TIME_FAR{700};
/// Timeout for the SP header of a peer that this bridge connected to. Only a hanging peer exceeds it.
constexpr std::chrono::milliseconds SP_ANSWER_TIME{500};
/// Timeout for the SP header of a peer that connected to this bridge.
constexpr std::chrono::milliseconds SP_GREETING_TIME{2000};
/// Sent data must be acknowledged in this time, else the peer counts as unreachable. This includes a peer that runs but
/// reads nothing.
constexpr std::chrono::milliseconds SP_ACKNOWLEDGE_TIME{5000};
/// Most incoming connections; more are closed at once.
constexpr size_t SP_MAX_SOURCES = 256;
/// Bytes read from one source before other descriptors have their turn.
constexpr size_t SP_BYTES_PER_TURN = 1024 * 1024;

/// Why an incoming connection was closed, for counters.
enum class SourceFault
{
  MALFORMED,      ///< no SP header, or no frame of this protocol
  OVERSIZED,      ///< announced a frame that is too large
  WRONG_VERSION,  ///< a bridge of another version
  REFUSED,        ///< onHeader() refused a frame, or there were too many connections
};

// The `detail` of Listener::onSourceClosed() begins with one of these.
constexpr char NO_FRAME_DETAIL[] = "no frame of ours";
constexpr char NO_GREETING_DETAIL[] = "no SP header of a PUSH socket";
constexpr char OVERSIZED_DETAIL[] = "oversized frame";
constexpr char WRONG_VERSION_DETAIL[] = "wire version ";
constexpr char FRAME_REFUSED_DETAIL[] = "frame refused";
constexpr char TOO_MANY_DETAIL[] = "too many connections";

/// The fault that the `detail` of Listener::onSourceClosed() describes.
inline SourceFault faultOf(const std::string& detail)
{
  const auto begins = [&detail](const char* words) { return detail.rfind(words, 0) == 0; };
  if (begins(OVERSIZED_DETAIL))
  {
    return SourceFault::OVERSIZED;
  }
  if (begins(WRONG_VERSION_DETAIL))
  {
    return SourceFault::WRONG_VERSION;
  }
  if (begins(FRAME_REFUSED_DETAIL) || begins(TOO_MANY_DETAIL))
  {
    return SourceFault::REFUSED;
  }
  return SourceFault::MALFORMED;
}

/// @return why an SP message of `length` bytes cannot be a frame; empty if it can.
inline std::string faultOfLength(uint64_t length)
{
  if (length > FrameHeader::BYTES + MAX_PAYLOAD)
  {
    return OVERSIZED_DETAIL + (" of " + std::to_string(length)) + " bytes";
  }
  return length < FrameHeader::BYTES ? NO_FRAME_DETAIL : std::string();
}

/// Decodes the header at the start of an SP message. @return what is wrong with the header; empty if nothing.
inline std::string decodeHeader(const uint8_t* bytes, FrameHeader* header)
{
  if (!FrameHeader::decode(bytes, header))
  {
    return NO_FRAME_DETAIL;
  }
  if (header->version != WIRE_VERSION)
  {
    return WRONG_VERSION_DETAIL + std::to_string(header->version) + ", this bridge speaks " +
           std::to_string(WIRE_VERSION);
  }
  return {};
}

}  // namespace pi_os_transport
