// A plain roscpp node with services and actions that the rostests of pi_os_transport steer, as test_peer.cpp is one
// with topics: it reads commands from stdin and answers each with one line of JSON on stdout that starts with '@'.
//
//   serve service=/x                       a server; the request says how large the answer has to be
//   served service=/x                      -> calls, wrong (requests that came damaged)
//   unserve service=/x
//   await_service service=/x timeout=
//   call service=/x count= size= answer= persistent=0|1 rate=    calls one after another; count=0: until stop_calls
//        background=0|1                    -> calls, failed, wrong, slowest_us (of one call), reconnected
//   await_calls n= timeout=                n further successful calls of the background caller
//   stop_calls                             -> as call
//   serve_action action=/x                 an action server: goals count down, with feedback
//   act action=/x goal= timeout=           -> state, result, feedback (number of messages)
//
// The node ends at "exit", at the end of stdin (the judge died) and at a signal.

#include <actionlib/TestAction.h>
#include <actionlib/client/simple_action_client.h>
#include <actionlib/server/simple_action_server.h>
#include <ros/ros.h>
#include <sensor_msgs/SetCameraInfo.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <iostream>
#include <map>
#include <memory>
#include <mutex>
#include <sstream>
#include <stdexcept>
#include <string>
#include <thread>

namespace
{
using Clock = std::chrono::steady_clock;
using ActionServer = actionlib::SimpleActionServer<actionlib::TestAction>;
using ActionClient = actionlib::SimpleActionClient<actionlib::TestAction>;

constexpr auto ACTION_STEP = std::chrono::milliseconds(10);

// ------------------------------------------------------------------------------------------------------------ pattern

double patternValue(uint32_t call, size_t index)
{
  return static_cast<double>((call * 2654435761u + static_cast<uint32_t>(index) * 40503u) % 1000003u);
}

/// Request of `bytes` bytes (rounded down to whole doubles) that asks for an answer of `answer` bytes.
void fillRequest(uint32_t call, size_t bytes, uint32_t answer, sensor_msgs::CameraInfo* request)
{
  request->width = call;
  request->height = answer;
  request->D.resize(bytes / sizeof(double));
  for (size_t i = 0; i < request->D.size(); ++i)
  {
    request->D[i] = patternValue(call, i);
  }
}

bool requestIntact(const sensor_msgs::CameraInfo& request)
{
  for (size_t i = 0; i < request.D.size(); ++i)
  {
    if (request.D[i] != patternValue(request.width, i))
    {
      return false;
    }
  }
  return true;
}

/// The answer to a call depends on the call, so that a late answer to another one is seen.
std::string answerText(uint32_t call, size_t request_values, size_t bytes)
{
  std::string text = std::to_string(call) + ":" + std::to_string(request_values) + ":";
  while (text.size() < bytes)
  {
    text.push_back(static_cast<char>('a' + (call + text.size()) % 26));
  }
  return text;
}

// ----------------------------------------------------------------------------------------------------------- commands

class Command
{
public:
  explicit Command(const std::string& line)
  {
    std::istringstream in(line);
    in >> verb_;
    for (std::string token; in >> token;)
    {
      const size_t equal = token.find('=');
      if (equal == std::string::npos)
      {
        throw std::invalid_argument("argument \"" + token + "\" of " + verb_ + " is not key=value");
      }
      values_[token.substr(0, equal)] = token.substr(equal + 1);
    }
  }
  const std::string& verb() const { return verb_; }
  std::string text(const std::string& key) const
  {
    const auto it = values_.find(key);
    if (it == values_.end())
    {
      throw std::invalid_argument(verb_ + " needs " + key + "=");
    }
    return it->second;
  }
  long integer(const std::string& key, long fallback) const
  {
    return values_.count(key) != 0 ? std::stol(text(key)) : fallback;
  }
  double real(const std::string& key, double fallback) const
  {
    return values_.count(key) != 0 ? std::stod(text(key)) : fallback;
  }
  std::chrono::milliseconds timeout() const
  {
    return std::chrono::milliseconds(static_cast<int64_t>(1000 * real("timeout", 30)));
  }

private:
  std::string verb_;
  std::map<std::string, std::string> values_;
};

std::string field(const std::string& key, const std::string& json)
{
  return ",\"" + key + "\":" + json;
}

// ------------------------------------------------------------------------------------------------------------- server

class Server
{
public:
  Server(ros::NodeHandle* node, const std::string& name)
    : service_(node->advertiseService<Server, sensor_msgs::SetCameraInfoRequest, sensor_msgs::SetCameraInfoResponse>(
          name, &Server::serve, this))
  {
  }
  std::string report() const { return field("calls", std::to_string(calls_)) + field("wrong", std::to_string(wrong_)); }

private:
  bool serve(sensor_msgs::SetCameraInfoRequest& request, sensor_msgs::SetCameraInfoResponse& response)
  {
    ++calls_;
    const sensor_msgs::CameraInfo& info = request.camera_info;
    response.success = requestIntact(info);
    wrong_ += response.success ? 0 : 1;
    response.status_message = answerText(info.width, info.D.size(), info.height);
    return true;
  }

  std::atomic<uint64_t> calls_{0};
  std::atomic<uint64_t> wrong_{0};
  ros::ServiceServer service_;
};

// ------------------------------------------------------------------------------------------------------------- client

class Caller
{
public:
  explicit Caller(const Command& c)
    : service_(c.text("service"))
    , count_(c.integer("count", 1))
    , size_(static_cast<size_t>(c.integer("size", 80)))
    , answer_(static_cast<uint32_t>(c.integer("answer", 20)))
    , persistent_(c.integer("persistent", 0) != 0)
    , rate_hz_(c.real("rate", 0))
    , thread_([this] { run(); })
  {
  }
  ~Caller() { stop(); }

  void join()
  {
    if (thread_.joinable())
    {
      thread_.join();
    }
  }
  void stop()
  {
    stopped_ = true;
    join();
  }

  bool awaitCalls(uint64_t further, std::chrono::milliseconds timeout)
  {
    std::unique_lock<std::mutex> lock(mutex_);
    const uint64_t wanted = succeeded_ + further;
    return changed_.wait_for(lock, timeout, [&] { return succeeded_ >= wanted; });
  }

  std::string report()
  {
    std::lock_guard<std::mutex> lock(mutex_);
    return field("calls", std::to_string(succeeded_ + failed_)) + field("failed", std::to_string(failed_)) +
           field("wrong", std::to_string(wrong_)) + field("slowest_us", std::to_string(slowest_us_)) +
           field("reconnected", std::to_string(reconnected_));
  }

private:
  void run()
  {
    ros::NodeHandle node;
    ros::ServiceClient client;
    auto next = Clock::now();
    for (long done = 0; !stopped_ && ros::ok() && (count_ == 0 || done < count_); ++done)
    {
      if (!client || (persistent_ && !client.isValid()))
      {
        // A persistent client whose connection has ended has to be made anew, says roscpp's documentation.
        std::lock_guard<std::mutex> lock(mutex_);
        reconnected_ += client ? 1 : 0;
        client = node.serviceClient<sensor_msgs::SetCameraInfo>(service_, persistent_);
      }
      callOnce(static_cast<uint32_t>(done + 1), &client);
      if (rate_hz_ > 0)
      {
        next += std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(1.0 / rate_hz_));
        std::this_thread::sleep_until(next);
      }
    }
  }

  void callOnce(uint32_t number, ros::ServiceClient* client)
  {
    sensor_msgs::SetCameraInfo service;
    fillRequest(number, size_, answer_, &service.request.camera_info);
    const auto start = Clock::now();
    const bool ok = client->call(service);
    const int64_t took = std::chrono::duration_cast<std::chrono::microseconds>(Clock::now() - start).count();
    const bool right =
        ok && service.response.success &&
        service.response.status_message == answerText(number, service.request.camera_info.D.size(), answer_);
    std::lock_guard<std::mutex> lock(mutex_);
    slowest_us_ = std::max(slowest_us_, took);
    failed_ += ok ? 0 : 1;
    wrong_ += ok && !right ? 1 : 0;
    succeeded_ += ok ? 1 : 0;
    changed_.notify_all();
  }

  const std::string service_;
  const long count_;
  const size_t size_;
  const uint32_t answer_;
  const bool persistent_;
  const double rate_hz_;
  std::mutex mutex_;  ///< guards the counters
  std::condition_variable changed_;
  uint64_t succeeded_ = 0;
  uint64_t failed_ = 0;
  uint64_t wrong_ = 0;
  uint64_t reconnected_ = 0;
  int64_t slowest_us_ = 0;
  std::atomic<bool> stopped_{false};
  std::thread thread_;
};

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

private:
  void execute(const actionlib::TestGoal& goal)
  {
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
        {"unserve", &Peer::unserve},
        {"await_service", &Peer::awaitService},
        {"call", &Peer::call},
        {"await_calls", &Peer::awaitCalls},
        {"stop_calls", &Peer::stopCalls},
        {"serve_action", &Peer::serveAction},
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
    servers_[c.text("service")] = std::make_unique<Server>(&node_, c.text("service"));
    return true;
  }
  bool served(const Command& c, std::string* fields)
  {
    *fields = servers_.at(c.text("service"))->report();
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
  bool serveAction(const Command& c, std::string*)
  {
    actions_[c.text("action")] = std::make_unique<Action>(node_, c.text("action"));
    return true;
  }
  bool act(const Command& c, std::string* fields)
  {
    ActionClient client(c.text("action"), false);
    const ros::Duration timeout(static_cast<double>(c.timeout().count()) / 1000.0);
    std::atomic<int> feedback{0};
    bool ok = client.waitForServer(timeout);
    if (ok)
    {
      actionlib::TestGoal goal;
      goal.goal = static_cast<int>(c.integer("goal", 5));
      client.sendGoal(goal, ActionClient::SimpleDoneCallback(), ActionClient::SimpleActiveCallback(),
                      [&feedback](const actionlib::TestFeedbackConstPtr&) { ++feedback; });
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
