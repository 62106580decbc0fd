#pragma once

#include <image_transport/image_transport.h>

#include <string>

namespace pi_detect
{

/// Transports are loaded when somebody listens; one that is missing has to be known before.
/// @param parameter  that asks for it, for the message.
/// @throws std::invalid_argument listing those that are installed.
void requireTransport(const image_transport::ImageTransport& transport, const std::string& name,
                      const std::string& parameter);

}  // namespace pi_detect
