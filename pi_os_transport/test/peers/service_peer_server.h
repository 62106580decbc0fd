#pragma once

#include <ros/ros.h>
#include <sensor_msgs/SetCameraInfo.h>

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <stdexcept>
#include <string>

#include "peers/peer_command.h"
#include "peers/peer_json.h"
#include "peers/service_pattern.h"

/// A server of one service; `mode` of the command says what its callback does.
class Server
{
public:
  Server(ros::NodeHandle* node, const Command& c)
    : mode_(c.text("mode", "answer"))
    , forward_(mode_ == "forward" ? node->serviceClient<sensor_msgs::SetCameraInfo>(c.text("to"), c.flag("persistent"))
                                  : ros::ServiceClient())
    , service_(node->advertiseService(c.text("service"), &Server::serve, this))
  {
  }
  ~Server() { release(); }

  void report(JsonObject* out)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    out->number("calls", calls_).number("wrong", wrong_);
    out->raw("header", jsonArray(header_, [](const auto& entry) { return quoted(entry.first); }));
  }
  bool awaitCalls(uint64_t calls, std::chrono::milliseconds timeout)
  {
    std::unique_lock<std::mutex> lock(mutex_);
    return changed_.wait_for(lock, timeout, [&] { return calls_ >= calls; });
  }
  void release()
  {
    std::lock_guard<std::mutex> lock(mutex_);
    released_ = true;
    changed_.notify_all();
  }

private:
  bool serve(ros::ServiceEvent<sensor_msgs::SetCameraInfoRequest, sensor_msgs::SetCameraInfoResponse>& event)
  {
    const sensor_msgs::SetCameraInfoRequest& request = event.getRequest();
    sensor_msgs::SetCameraInfoResponse& response = event.getResponse();
    const sensor_msgs::CameraInfo& info = request.camera_info;
    response.success = requestIntact(info);
    response.status_message = answerText(info.width, info.D.size(), info.height);
    {
      std::unique_lock<std::mutex> lock(mutex_);
      ++calls_;
      wrong_ += response.success ? 0 : 1;
      header_ = event.getConnectionHeader();
      changed_.notify_all();
      changed_.wait(lock, [this] { return mode_ != "hold" || released_; });
    }
    if (mode_ == "throw")
    {
      throw std::runtime_error("thrown on purpose");
    }
    if (mode_ == "forward")
    {
      sensor_msgs::SetCameraInfo onward;
      onward.request = request;
      const bool ok = forward_.call(onward);
      response = onward.response;
      return ok;
    }
    return mode_ != "refuse";
  }

  const std::string mode_;
  std::mutex mutex_;  ///< guards what follows
  std::condition_variable changed_;
  uint64_t calls_ = 0;
  uint64_t wrong_ = 0;
  ros::M_string header_;  ///< of the last call's connection
  bool released_ = false;
  ros::ServiceClient forward_;
  ros::ServiceServer service_;
};
