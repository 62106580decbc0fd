#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <string>

#include "wire/wire_frame.h"

namespace pi_os_transport
{

/// A connection attempt that nobody answered for so long is given up: TCP would wait a second before it asks again, and
/// the caller's next attempt asks at once.
constexpr std::chrono::milliseconds SP_CONNECT_TIME{300};
/// Every third attempt waits longer, for peers behind a long way.
constexpr std::chrono::milliseconds SP_CONNECT_TIME_FAR{700};
/// How long the other bridge may take for its SP header once TCP has connected: it answers at once, unless it hangs.
constexpr std::chrono::milliseconds SP_ANSWER_TIME{500};
/// How long who connects to this bridge may take for it.
constexpr std::chrono::milliseconds SP_GREETING_TIME{2000};
/// What was sent must be acknowledged in this time, else the peer counts as unreachable. That includes a peer that
/// lives but reads nothing for so long.
constexpr std::chrono::milliseconds SP_ACKNOWLEDGE_TIME{5000};
/// Incoming connections at a time; more are closed at once.
constexpr size_t SP_MAX_SOURCES = 256;

/// What was wrong with an incoming connection, for counters.
enum class SourceFault
{
  MALFORMED,      ///< no SP header, or no frame of ours
  OVERSIZED,      ///< announced a frame that is too large
  WRONG_VERSION,  ///< a bridge that speaks another version
  REFUSED,        ///< a frame that onHeader() did not want, or one connection too many
};

// The details that the transports give to Listener::onSourceClosed(). Some go on after these words.
constexpr char NO_FRAME_DETAIL[] = "no frame of ours";
constexpr char NO_GREETING_DETAIL[] = "no SP header of a PUSH socket";
constexpr char OVERSIZED_DETAIL[] = "oversized frame";
constexpr char WRONG_VERSION_DETAIL[] = "wire version ";
constexpr char FRAME_REFUSED_DETAIL[] = "frame refused";
constexpr char TOO_MANY_DETAIL[] = "too many connections";

/// Tells from the detail given to Listener::onSourceClosed() what is to be counted.
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

/// @return what keeps an SP message of `length` bytes from being a frame; empty if nothing.
inline std::string faultOfLength(uint64_t length)
{
  if (length > FrameHeader::BYTES + MAX_PAYLOAD)
  {
    return OVERSIZED_DETAIL + (" of " + std::to_string(length)) + " bytes";
  }
  return length < FrameHeader::BYTES ? NO_FRAME_DETAIL : std::string();
}

/// Decodes the header that an SP message begins with. @return what is wrong with it; empty if nothing.
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
