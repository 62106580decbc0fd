// A plain roscpp node with services and actions that the rostests of pi_os_transport steer, as test_peer.cpp is one
// with topics: it reads commands from stdin and answers each with one line of JSON on stdout that starts with '@'.
//
//   serve service=/x mode= to=             a server; the request says how large the answer has to be. mode: answer
//         persistent=0|1                   (default), throw, refuse, hold (until release), forward (calls service to=)
//   served service=/x                      -> calls, wrong (requests that came damaged), header (keys of the last)
//   await_served service=/x n= timeout=    n calls have come
//   release service=/x                     mode=hold: lets callbacks end
//   unserve service=/x
//   await_service service=/x timeout=
//   call service=/x count= size= answer= persistent=0|1 rate=    calls one after another; count=0: until stop_calls
//        background=0|1 renew=0|1          -> calls, failed, wrong, slowest_us (of one call), reconnected, valid,
//                                             still_valid (after failed calls)
//        renew: a persistent client is made anew after each failure, since roscpp calls one valid for ever whose
//        connection was refused at once
//   await_calls n= timeout=                n further successful calls of the background caller
//   await_failed n= timeout=               n failed calls of it in all
//   stop_calls                             -> as call
//   shutdown_client                        of the background caller, also while it waits
//   share service=/x threads= count= size= answer= handles=1    several threads on the same persistent handles, in turn
//                                          -> failed, wrong
//   call_as_empty service=/x persistent=0|1    with another type -> called
//   fork                                   a child that only waits -> pid
//   serve_action action=/x                 an action server: goals count down, with feedback
//   await_goal action=/x timeout=          a goal is at work
//   act action=/x goal= timeout=           -> state, result, feedback (number of messages)
//       cancel=n                           after the n-th feedback the goal is cancelled
//
// The node ends at "exit", at the end of stdin (the judge died) and at a signal.

#include <actionlib/TestAction.h>
#include <actionlib/client/simple_action_client.h>
#include <actionlib/server/simple_action_server.h>
#include <ros/ros.h>
#include <sensor_msgs/SetCameraInfo.h>
#include <std_srvs/Empty.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "peers/peer_verbs.h"
#include "peers/service_pattern.h"
#include "peers/service_peer_caller.h"
#include "peers/service_peer_server.h"

namespace
{
using ActionServer = actionlib::SimpleActionServer<actionlib::TestAction>;
using ActionClient = actionlib::SimpleActionClient<actionlib::TestAction>;

constexpr auto ACTION_STEP = std::chrono::milliseconds(10);

// ------------------------------------------------------------------------------------------------------------- action

class Action
{
public:
  Action(const ros::NodeHandle& node, const std::string& name)
    : server_(
          node, name, [this](const actionlib::TestGoalConstPtr& goal) { execute(*goal); }, false)
  {
    server_.start();
  }
  bool awaitGoal(std::chrono::milliseconds timeout)
  {
    std::unique_lock<std::mutex> lock(mutex_);
    return changed_.wait_for(lock, timeout, [this] { return started_; });
  }

private:
  void execute(const actionlib::TestGoal& goal)
  {
    {
      std::lock_guard<std::mutex> lock(mutex_);
      started_ = true;
      changed_.notify_all();
    }
    actionlib::TestFeedback feedback;
    for (feedback.feedback = goal.goal; feedback.feedback > 0; --feedback.feedback)
    {
      if (server_.isPreemptRequested() || !ros::ok())
      {
        server_.setPreempted();
        return;
      }
      server_.publishFeedback(feedback);
      std::this_thread::sleep_for(ACTION_STEP);
    }
    actionlib::TestResult result;
    result.result = 2 * goal.goal;
    server_.setSucceeded(result);
  }

  std::mutex mutex_;
  std::condition_variable changed_;
  bool started_ = false;
  ActionServer server_;
};

// --------------------------------------------------------------------------------------------------------------- node

class Peer
{
public:
  static const Verbs<Peer> VERBS;

private:
  bool serve(const Command& c, JsonObject*)
  {
    servers_[c.text("service")] = std::make_unique<Server>(&node_, c);
    return true;
  }
  bool served(const Command& c, JsonObject* out)
  {
    servers_.at(c.text("service"))->report(out);
    return true;
  }
  bool awaitServed(const Command& c, JsonObject*)
  {
    return servers_.at(c.text("service"))->awaitCalls(static_cast<uint64_t>(c.integer("n", 1)), c.timeout());
  }
  bool release(const Command& c, JsonObject*)
  {
    servers_.at(c.text("service"))->release();
    return true;
  }
  bool unserve(const Command& c, JsonObject*) { return servers_.erase(c.text("service")) == 1; }
  bool awaitService(const Command& c, JsonObject*)
  {
    return ros::service::waitForService(c.text("service"), static_cast<int32_t>(c.timeout().count()));
  }
  bool call(const Command& c, JsonObject* out)
  {
    caller_ = std::make_unique<Caller>(c);
    if (c.integer("background", 0) == 0)
    {
      caller_->join();
      caller_->report(out);
    }
    return true;
  }
  bool awaitCalls(const Command& c, JsonObject* out)
  {
    const bool ok = caller_->awaitCalls(static_cast<uint64_t>(c.integer("n", 1)), c.timeout());
    caller_->report(out);
    return ok;
  }
  bool stopCalls(const Command&, JsonObject* out)
  {
    caller_->stop();
    caller_->report(out);
    return true;
  }
  bool awaitFailed(const Command& c, JsonObject* out)
  {
    const bool ok = caller_->awaitFailed(static_cast<uint64_t>(c.integer("n", 1)), c.timeout());
    caller_->report(out);
    return ok;
  }
  bool shutdownClient(const Command&, JsonObject*)
  {
    caller_->shutdownClient();
    return true;
  }
  bool share(const Command& c, JsonObject* out)
  {
    std::vector<ros::ServiceClient> shared(static_cast<size_t>(c.integer("handles", 1)));
    for (ros::ServiceClient& handle : shared)
    {
      handle = node_.serviceClient<sensor_msgs::SetCameraInfo>(c.text("service"), true);
    }
    const auto count = static_cast<uint32_t>(c.integer("count", 100));
    const auto size = static_cast<size_t>(c.integer("size", 80));
    const auto answer_bytes = static_cast<uint32_t>(c.integer("answer", 20));
    std::atomic<uint64_t> failed{0};
    std::atomic<uint64_t> wrong{0};
    std::vector<std::thread> threads;
    for (uint32_t thread = 0; thread < static_cast<uint32_t>(c.integer("threads", 4)); ++thread)
    {
      threads.emplace_back(
          [&, thread]
          {
            for (uint32_t call = 0; call < count; ++call)
            {
              ros::ServiceClient client = shared[call % shared.size()];
              const uint32_t number = 1 + thread * count + call;
              sensor_msgs::SetCameraInfo service;
              fillRequest(number, size, answer_bytes, &service.request.camera_info);
              const bool ok = client.call(service);
              failed += ok ? 0 : 1;
              wrong += ok && service.response.status_message !=
                                   answerText(number, service.request.camera_info.D.size(), answer_bytes)
                           ? 1
                           : 0;
            }
          });
    }
    for (std::thread& thread : threads)
    {
      thread.join();
    }
    out->number("failed", failed.load()).number("wrong", wrong.load());
    return true;
  }
  bool callAsEmpty(const Command& c, JsonObject* out)
  {
    ros::ServiceClient client =
        node_.serviceClient<std_srvs::Empty>(c.text("service"), c.integer("persistent", 0) != 0);
    std_srvs::Empty service;
    out->boolean("called", client.call(service));
    return true;
  }
  bool forkChild(const Command&, JsonObject* out)
  {
    const pid_t child = fork();
    if (child == 0)
    {
      for (;;)
      {
        pause();
      }
    }
    out->number("pid", child);
    return child > 0;
  }
  bool serveAction(const Command& c, JsonObject*)
  {
    actions_[c.text("action")] = std::make_unique<Action>(node_, c.text("action"));
    return true;
  }
  bool awaitGoal(const Command& c, JsonObject*) { return actions_.at(c.text("action"))->awaitGoal(c.timeout()); }
  bool act(const Command& c, JsonObject* out)
  {
    ActionClient client(c.text("action"), false);
    const ros::Duration timeout(static_cast<double>(c.timeout().count()) / 1000.0);
    const long cancel = c.integer("cancel", 0);
    std::atomic<int> feedback{0};
    bool ok = client.waitForServer(timeout);
    if (ok)
    {
      actionlib::TestGoal goal;
      goal.goal = static_cast<int>(c.integer("goal", 5));
      client.sendGoal(goal, ActionClient::SimpleDoneCallback(), ActionClient::SimpleActiveCallback(),
                      [&](const actionlib::TestFeedbackConstPtr&)
                      {
                        if (++feedback == cancel)
                        {
                          client.cancelGoal();
                        }
                      });
      ok = client.waitForResult(timeout);
    }
    const actionlib::TestResultConstPtr result = client.getResult();
    out->text("state", ok ? client.getState().toString() : "no result");
    out->number("result", ok && result ? result->result : -1).number("feedback", feedback.load());
    return ok;
  }

  ros::NodeHandle node_;
  std::map<std::string, std::unique_ptr<Server>> servers_;
  std::map<std::string, std::unique_ptr<Action>> actions_;
  std::unique_ptr<Caller> caller_;
};

const Verbs<Peer> Peer::VERBS = {
    {"serve", &Peer::serve},
    {"served", &Peer::served},
    {"await_served", &Peer::awaitServed},
    {"release", &Peer::release},
    {"unserve", &Peer::unserve},
    {"await_service", &Peer::awaitService},
    {"call", &Peer::call},
    {"await_calls", &Peer::awaitCalls},
    {"await_failed", &Peer::awaitFailed},
    {"stop_calls", &Peer::stopCalls},
    {"shutdown_client", &Peer::shutdownClient},
    {"share", &Peer::share},
    {"call_as_empty", &Peer::callAsEmpty},
    {"fork", &Peer::forkChild},
    {"serve_action", &Peer::serveAction},
    {"await_goal", &Peer::awaitGoal},
    {"act", &Peer::act},
};
}  // namespace

int main(int argc, char** argv)
{
  ros::init(argc, argv, "test_service_peer");
  const uint32_t threads = argc > 1 ? static_cast<uint32_t>(std::stoul(argv[1])) : 1;
  ros::AsyncSpinner spinner(threads);
  spinner.start();
  Peer peer;
  serveCommands(ros::this_node::getName(), Peer::VERBS, &peer, ros::ok);
  ros::shutdown();
  return 0;
}
