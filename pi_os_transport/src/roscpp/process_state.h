#pragma once

#include <string>

namespace pi_os_transport
{

/// The state of all links of this process as JSON, which `pi_os links` and `pi_os doctor` show. Takes roscpp's locks of
/// topics, services and links, one after another; the caller must hold none of them.
std::string describeProcess();

}  // namespace pi_os_transport
