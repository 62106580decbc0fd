#pragma once

#include <image_transport/image_transport.h>

#include <string>

namespace pi_detect
{

/// Checks that a transport is installed, because transports are loaded only when somebody listens.
/// @param parameter  name of the parameter, for the message.
/// @throws std::invalid_argument with the list of installed transports.
void requireTransport(const image_transport::ImageTransport& transport, const std::string& name,
                      const std::string& parameter);

}  // namespace pi_detect
