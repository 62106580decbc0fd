#pragma once

#include <cstdint>
#include <string_view>

#include "shm/side_channel.h"

namespace pi_os_transport
{

/// SipHash-2-4 of a topic's name under the token of a link; never 0. Nobody finds another name with the same mark.
uint64_t topicMark(const Token& link, std::string_view topic);

}  // namespace pi_os_transport
