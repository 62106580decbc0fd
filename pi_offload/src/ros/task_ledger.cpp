#include "ros/task_ledger.h"

#include <pi_offload/OffloadDecision.h>

#include "ros/conversions.h"

namespace pi_offload
{
namespace
{

constexpr size_t RECENT_TASKS = 1000;  ///< for quantiles of the response time

}  // namespace

TaskLedger::TaskLedger(ros::NodeHandle private_node, double speech_local_s)
  : speech_local_s_(speech_local_s)
  , decisions_(private_node.advertise<OffloadDecision>("decisions", 100))
  , response_s_{pi_node::RecentValues(RECENT_TASKS), pi_node::RecentValues(RECENT_TASKS)}
{
}

void TaskLedger::publish(const Outcome& outcome, const std_msgs::Header& header, bool dropped)
{
  OffloadDecision decision = toMsg(outcome, header, dropped);
  const bool by_vehicle = outcome.how == Outcome::How::LOCAL || outcome.how == Outcome::How::FALLBACK;
  if (outcome.task.kind == TaskKind::SPEECH && by_vehicle)
  {
    decision.response_time += speech_local_s_;  // the recogniser begins now
    decision.by_deadline = static_cast<uint8_t>(decision.response_time <= decision.deadline);
  }
  response_s_[static_cast<size_t>(outcome.task.kind)].add(decision.response_time);
  decisions_.publish(decision);
}

}  // namespace pi_offload
