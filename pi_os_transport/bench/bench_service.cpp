/// One end of the benchmark of services: an ordinary roscpp node that knows only roscpp's and actionlib's API.
///
/// Without arguments a client, with --server the server of "service" and "action". Commands come as lines on standard
/// input, answers go as lines "@ {json}" to standard output:
///   call COUNT REQUEST ANSWER PERSISTENT   COUNT calls, one after another, with REQUEST bytes there and ANSWER bytes
///                                          back, every answer checked -> the times of all calls in us
///   act COUNT FEEDBACK                     COUNT goals, one after another, each with FEEDBACK messages
///                                          -> the times from goal to result in us
///   quit                                   (or end of input)

#include "bench_commands.h"

#include <actionlib/TestAction.h>
#include <actionlib/client/simple_action_client.h>
#include <actionlib/server/simple_action_server.h>
#include <ros/ros.h>
#include <sensor_msgs/SetCameraInfo.h>

#include <chrono>
#include <cstdint>
#include <cstring>
#include <iostream>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

namespace pi_os_transport_bench
{
namespace
{
using Clock = std::chrono::steady_clock;

constexpr double CONNECT_S = 20.0;
constexpr double RESULT_S = 20.0;

double microseconds(Clock::duration span)
{
  return std::chrono::duration<double, std::micro>(span).count();
}

/// Writes one answer. @param what  "called" or "acted".
void answer(const char* what, const std::vector<double>& times_us)
{
  std::ostringstream text;
  text << "@ {\"event\": \"" << what << "\", \"times_us\": [";
  for (std::size_t i = 0; i < times_us.size(); ++i)
  {
    text << (i == 0 ? "" : ", ") << times_us[i];
  }
  std::cout << text.str() << "]}" << std::endl;
}

void complain(const std::string& text)
{
  std::cout << "@ {\"event\": \"error\", \"text\": \"" << text << "\"}" << std::endl;
}

class BenchServer
{
public:
  BenchServer()
    : service_(node_.advertiseService("service", &BenchServer::serve, this))
    , action_(
          node_, "action", [this](const actionlib::TestGoalConstPtr& goal) { execute(*goal); }, false)
  {
    action_.start();
  }

  bool obey(const std::string&, std::istream&) { return false; }

private:
  /// The first value of the request says how long the answer has to be, the last one comes back as its first bytes.
  bool serve(sensor_msgs::SetCameraInfoRequest& request, sensor_msgs::SetCameraInfoResponse& response)
  {
    response.status_message.resize(request.camera_info.height, 'a');
    const std::string mark = std::to_string(request.camera_info.D.back());
    response.status_message.replace(0, std::min(mark.size(), response.status_message.size()), mark, 0,
                                    std::min(mark.size(), response.status_message.size()));
    response.success = true;
    return true;
  }

  void execute(const actionlib::TestGoal& goal)
  {
    actionlib::TestFeedback feedback;
    for (feedback.feedback = goal.goal; feedback.feedback > 0; --feedback.feedback)
    {
      action_.publishFeedback(feedback);
    }
    actionlib::TestResult result;
    result.result = 2 * goal.goal;
    action_.setSucceeded(result);
  }

  ros::NodeHandle node_;
  ros::ServiceServer service_;
  actionlib::SimpleActionServer<actionlib::TestAction> action_;
};

class BenchClient
{
public:
  /// Carries out one command. @return false for "quit" and anything unknown.
  bool obey(const std::string& command, std::istream& words)
  {
    std::size_t count = 0;
    words >> count;
    if (command == "call")
    {
      std::size_t request = 0, answer_bytes = 0;
      int persistent = 0;
      words >> request >> answer_bytes >> persistent;
      call(count, request, answer_bytes, persistent != 0);
    }
    else if (command == "act")
    {
      int feedback = 0;
      words >> feedback;
      act(count, feedback);
    }
    else
    {
      return false;
    }
    return true;
  }

private:
  void call(std::size_t count, std::size_t request_bytes, std::size_t answer_bytes, bool persistent)
  {
    ros::service::waitForService(ros::names::resolve("service"), ros::Duration(CONNECT_S));
    ros::ServiceClient client = node_.serviceClient<sensor_msgs::SetCameraInfo>("service", persistent);
    sensor_msgs::SetCameraInfo service;
    service.request.camera_info.height = static_cast<std::uint32_t>(answer_bytes);
    service.request.camera_info.D.resize(std::max<std::size_t>(request_bytes / sizeof(double), 1));
    std::vector<double> times_us;
    for (std::size_t i = 0; i < count; ++i)
    {
      service.request.camera_info.D.back() = static_cast<double>(i);
      const Clock::time_point start = Clock::now();
      const bool ok = client.call(service);
      times_us.push_back(microseconds(Clock::now() - start));
      const std::string mark = std::to_string(service.request.camera_info.D.back());
      const std::string& text = service.response.status_message;
      if (!ok || text.size() != answer_bytes ||
          text.compare(0, std::min(mark.size(), text.size()), mark, 0, std::min(mark.size(), text.size())) != 0)
      {
        complain("call " + std::to_string(i) + (ok ? " got a wrong answer" : " failed"));
        return;
      }
    }
    answer("called", times_us);
  }

  void act(std::size_t count, int feedback)
  {
    if (!action_)
    {
      action_ = std::make_unique<actionlib::SimpleActionClient<actionlib::TestAction>>(node_, "action", true);
    }
    if (!action_->waitForServer(ros::Duration(CONNECT_S)))
    {
      complain("no action server");
      return;
    }
    std::vector<double> times_us;
    for (std::size_t i = 0; i < count; ++i)
    {
      actionlib::TestGoal goal;
      goal.goal = feedback;
      const Clock::time_point start = Clock::now();
      action_->sendGoal(goal);
      const bool ok = action_->waitForResult(ros::Duration(RESULT_S));
      times_us.push_back(microseconds(Clock::now() - start));
      const actionlib::TestResultConstPtr result = action_->getResult();
      if (!ok || !result || result->result != 2 * feedback)
      {
        complain("goal " + std::to_string(i) + (ok ? " got a wrong result" : " got no result"));
        return;
      }
    }
    answer("acted", times_us);
  }

  ros::NodeHandle node_;
  std::unique_ptr<actionlib::SimpleActionClient<actionlib::TestAction>> action_;
};

}  // namespace
}  // namespace pi_os_transport_bench

int main(int argc, char** argv)
{
  ros::init(argc, argv, "bench_service");
  if (argc > 1 && std::strcmp(argv[1], "--server") == 0)
  {
    pi_os_transport_bench::BenchServer server;
    pi_os_transport_bench::serveCommands(&server);
  }
  else
  {
    pi_os_transport_bench::BenchClient client;
    pi_os_transport_bench::serveCommands(&client);
  }
  return 0;
}
