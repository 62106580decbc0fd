#pragma once

#include <ros/serialized_message.h>

#include <cstdint>
#include <optional>

#include "shm/side_channel.h"

namespace pi_os_transport
{

/// Messages that a bridge may have delivered before it ended are sent again over TCPROS. Their number on the link
/// precedes them, behind the link's token, so that the subscriber leaves out what it has. An application sees neither.
///
/// @param bytes  the message without its length.
ros::SerializedMessage numberedMessage(const Token& link, uint32_t number, const uint8_t* bytes, size_t length);

/// Removes token and number from a message if it has them.
/// @param link  Token() if the link has none.
/// @param prefix  bytes before the message in its buffer: LENGTH_PREFIX at the publisher, 0 at the subscriber.
/// @return the number; nothing for other messages, which remain unchanged.
std::optional<uint32_t> takeNumber(const Token& link, size_t prefix, ros::SerializedMessage* message);

}  // namespace pi_os_transport
