#pragma once

#include <ros/service_server_link.h>

namespace pi_os_transport
{

// Calls of a service over TCPROS, in place of ros::ServiceServerLink's own functions, which now and then leave a call
// waiting for ever when its connection ends. Any thread.

/// As ServiceServerLink::call(). That looks whether the connection has ended before it locks the queue of calls, so one
/// that ends in between never hears of the call.
bool callOverTcp(ros::ServiceServerLink* link, const ros::SerializedMessage& request, ros::SerializedMessage& response);

/// Waits for the answer to a request that has been sent already; what follows the writing of one in callOverTcp().
bool awaitTcpAnswer(ros::ServiceServerLink* link, ros::SerializedMessage& response);

/// As ServiceServerLink::clearCalls(): the connection has ended, and every call that waits for an answer fails. That
/// looks at the current call first and at those that wait then, so it misses one that becomes current in between; and
/// it waits until the calls have returned, with the transport locked for which one of them may be waiting. A call holds
/// its link itself.
void endCalls(ros::ServiceServerLink* link);

}  // namespace pi_os_transport
