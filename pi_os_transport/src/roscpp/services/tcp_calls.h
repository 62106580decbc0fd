#pragma once

#include <ros/service_server_link.h>

namespace pi_os_transport
{

// Service calls over TCPROS. They replace functions of ros::ServiceServerLink, which sometimes leave a call waiting
// forever when its connection ends. Any thread.

/// Replaces ServiceServerLink::call(), which checks the connection before it locks the queue of calls. If the
/// connection ends in between, that call never returns.
bool callOverTcp(ros::ServiceServerLink* link, const ros::SerializedMessage& request, ros::SerializedMessage& response);

/// Waits for the answer to a request that has been sent already.
bool awaitTcpAnswer(ros::ServiceServerLink* link, ros::SerializedMessage& response);

/// Replaces ServiceServerLink::clearCalls(): the connection has ended, so every waiting call fails. roscpp's function
/// misses a call that becomes current while it runs. It also waits for the calls to return while it locks the
/// transport, which a call may need. The link is invalid before a call fails: the thread that ends the connection says
/// so to roscpp at any time later.
void endCalls(ros::ServiceServerLink* link);

}  // namespace pi_os_transport
