#pragma once

#include <string>

#include "bridge/bridge_context.h"
#include "bridge/sessions.h"

namespace pi_os_transport
{

/// The counters and states of a bridge as one line of JSON. `pi_os status` shows them.
std::string bridgeStatus(const BridgeContext& context, const Sessions& sessions);

}  // namespace pi_os_transport
