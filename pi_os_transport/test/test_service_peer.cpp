// A plain roscpp node with services and actions that the rostests of pi_os_transport steer, as test_peer.cpp is one
// with topics: it reads commands from stdin and answers each with one line of JSON on stdout that starts with '@'.
//
//   serve service=/x mode= to=             a server; the request says how large the answer has to be. mode: answer
//                                          (default), throw, refuse, hold (until release), forward (calls service to=)
//   served service=/x                      -> calls, wrong (requests that came damaged), header (keys of the last)
//   await_served service=/x n= timeout=    n calls have come
//   release service=/x                     mode=hold: lets callbacks end
//   unserve service=/x
//   await_service service=/x timeout=
//   call service=/x count= size= answer= persistent=0|1 rate=    calls one after another; count=0: until stop_calls
//        background=0|1 renew=0|1          -> calls, failed, wrong, slowest_us (of one call), reconnected, valid
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
#include <iostream>
#include <map>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "peer_command.h"
#include "service_pattern.h"
#include "service_peer_caller.h"
#include "service_peer_server.h"

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
  std::string execute(const Command& c)
  {
    static const std::map<std::string, bool (Peer::*)(const Command&, std::string*)> VERBS = {
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
    const auto it = VERBS.find(c.verb());
    if (it == VERBS.end())
    {
      throw std::invalid_argument("unknown verb \"" + c.verb() + "\"");
    }
    std::string fields;
    const bool ok = (this->*it->second)(c, &fields);
    return R"({"reply":")" + c.verb() + R"(","ok":)" + (ok ? "true" : "false") + fields + "}";
  }

private:
  bool serve(const Command& c, std::string*)
  {
    servers_[c.text("service")] = std::make_unique<Server>(&node_, c);
    return true;
  }
  bool served(const Command& c, std::string* fields)
  {
    *fields = servers_.at(c.text("service"))->report();
    return true;
  }
  bool awaitServed(const Command& c, std::string*)
  {
    return servers_.at(c.text("service"))->awaitCalls(static_cast<uint64_t>(c.integer("n", 1)), c.timeout());
  }
  bool release(const Command& c, std::string*)
  {
    servers_.at(c.text("service"))->release();
    return true;
  }
  bool unserve(const Command& c, std::string*) { return servers_.erase(c.text("service")) == 1; }
  bool awaitService(const Command& c, std::string*)
  {
    return ros::service::waitForService(c.text("service"), static_cast<int32_t>(c.timeout().count()));
  }
  bool call(const Command& c, std::string* fields)
  {
    caller_ = std::make_unique<Caller>(c);
    if (c.integer("background", 0) == 0)
    {
      caller_->join();
      *fields = caller_->report();
    }
    return true;
  }
  bool awaitCalls(const Command& c, std::string* fields)
  {
    const bool ok = caller_->awaitCalls(static_cast<uint64_t>(c.integer("n", 1)), c.timeout());
    *fields = caller_->report();
    return ok;
  }
  bool stopCalls(const Command&, std::string* fields)
  {
    caller_->stop();
    *fields = caller_->report();
    return true;
  }
  bool awaitFailed(const Command& c, std::string* fields)
  {
    const bool ok = caller_->awaitFailed(static_cast<uint64_t>(c.integer("n", 1)), c.timeout());
    *fields = caller_->report();
    return ok;
  }
  bool shutdownClient(const Command&, std::string*)
  {
    caller_->shutdownClient();
    return true;
  }
  bool share(const Command& c, std::string* fields)
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
    *fields = field("failed", std::to_string(failed)) + field("wrong", std::to_string(wrong));
    return true;
  }
  bool callAsEmpty(const Command& c, std::string* fields)
  {
    ros::ServiceClient client =
        node_.serviceClient<std_srvs::Empty>(c.text("service"), c.integer("persistent", 0) != 0);
    std_srvs::Empty service;
    *fields = field("called", client.call(service) ? "true" : "false");
    return true;
  }
  bool forkChild(const Command&, std::string* fields)
  {
    const pid_t child = fork();
    if (child == 0)
    {
      for (;;)
      {
        pause();
      }
    }
    *fields = field("pid", std::to_string(child));
    return child > 0;
  }
  bool serveAction(const Command& c, std::string*)
  {
    actions_[c.text("action")] = std::make_unique<Action>(node_, c.text("action"));
    return true;
  }
  bool awaitGoal(const Command& c, std::string*) { return actions_.at(c.text("action"))->awaitGoal(c.timeout()); }
  bool act(const Command& c, std::string* fields)
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
    *fields = field("state", "\"" + (ok ? client.getState().toString() : std::string("no result")) + "\"") +
              field("result", std::to_string(ok && result ? result->result : -1)) +
              field("feedback", std::to_string(feedback.load()));
    return ok;
  }

  ros::NodeHandle node_;
  std::map<std::string, std::unique_ptr<Server>> servers_;
  std::map<std::string, std::unique_ptr<Action>> actions_;
  std::unique_ptr<Caller> caller_;
};

void answer(const std::string& json)
{
  std::cout << "@" + json + "\n" << std::flush;
}
}  // namespace

int main(int argc, char** argv)
{
  ros::init(argc, argv, "test_service_peer");
  const uint32_t threads = argc > 1 ? static_cast<uint32_t>(std::stoul(argv[1])) : 1;
  ros::AsyncSpinner spinner(threads);
  spinner.start();
  Peer peer;
  answer(R"({"reply":"ready","ok":true,"name":")" + ros::this_node::getName() + "\"}");
  for (std::string line; ros::ok() && std::getline(std::cin, line) && line != "exit";)
  {
    try
    {
      answer(peer.execute(Command(line)));
    }
    catch (const std::exception& e)
    {
      answer(R"({"reply":"error","ok":false,"error":")" + std::string(e.what()) + "\"}");
    }
  }
  ros::shutdown();
  return 0;
}
