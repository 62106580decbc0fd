#pragma once

#include <pi_detect/Detection2DArray.h>
#include <pi_detect/LabelArray.h>
#include <pi_detect/ros/conversions.h>
#include <pi_node/test_support/on_graph.h>
#include <pi_node/test_support/soak.h>
#include <pi_offload/Nodes.h>
#include <pi_offload/OffloadDecision.h>
#include <pi_offload/RegisterNode.h>
#include <pi_offload/Statistics.h>
#include <sensor_msgs/Image.h>
#include <std_srvs/SetBool.h>

#include <algorithm>
#include <boost/make_shared.hpp>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "client/fake_edge_node.h"
#include "ros/coordinator_ros.h"

namespace pi_offload
{

using namespace pi_node::test_support;

constexpr int LOCAL_CLASS = 7;   ///< what the vehicle's detector finds
constexpr int REMOTE_CLASS = 3;  ///< what the fake nodes find

/// The vehicle's detector, in place of pi_detect's: answers each picture at once, or when it is told to.
class FakeDetector
{
public:
  explicit FakeDetector(const std::string& name, const std::string& model = "street") : node_("/" + name)
  {
    labels_ = node_.advertise<pi_detect::LabelArray>("local/labels", 1, true);
    detections_ = node_.advertise<pi_detect::Detection2DArray>("local/detections", 100);
    pictures_ = node_.subscribe("local/image", 100, &FakeDetector::onImage, this);
    tell(model);
  }
  ~FakeDetector() { pictures_.shutdown(); }

  void tell(const std::string& model)
  {
    pi_detect::LabelArray labels;
    labels.model = model;
    labels.ids = {REMOTE_CLASS, LOCAL_CLASS};
    labels.names = {"car", "person"};
    labels_.publish(labels);
  }
  void hold(bool held)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    held_ = held;
  }
  /// Answers the newest picture; those before it, that were not answered, never will be.
  void release()
  {
    sensor_msgs::ImageConstPtr newest;
    {
      std::lock_guard<std::mutex> lock(mutex_);
      newest = came_.empty() ? nullptr : came_.back();
    }
    if (newest)
    {
      answer(newest->header);
    }
  }
  void answer(const std_msgs::Header& header)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    detections_.publish(pi_detect::toMsg(objects_, header));
  }
  void setObjects(const pi_detect::Detections& objects)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    objects_ = objects;
  }
  std::vector<sensor_msgs::ImageConstPtr> came() const
  {
    std::lock_guard<std::mutex> lock(mutex_);
    return came_;
  }
  bool waitFor(size_t count) const
  {
    return until(TIMEOUT_S, [this, count] { return came().size() >= count; });
  }
  uint32_t listeners() const { return detections_.getNumSubscribers(); }

private:
  void onImage(const sensor_msgs::ImageConstPtr& image)
  {
    {
      std::lock_guard<std::mutex> lock(mutex_);
      came_.push_back(image);
      if (held_)
      {
        return;
      }
    }
    answer(image->header);
  }

  ros::NodeHandle node_;
  mutable std::mutex mutex_;
  bool held_ = false;
  pi_detect::Detections objects_{{LOCAL_CLASS, 0.5F, {1.0F, 2.0F, 3.0F, 4.0F}}};
  std::vector<sensor_msgs::ImageConstPtr> came_;
  ros::Publisher labels_;
  ros::Publisher detections_;
  ros::Subscriber pictures_;
};

/// A coordinator in this process and a namespace of its name, with parameters for tests: a busy computer must not
/// change what comes out.
class CoordinatorOnGraph
{
public:
  explicit CoordinatorOnGraph(const std::string& name)
    : name_(name), private_name_("/" + name + "/coordinator"), decisions(private_name_ + "/decisions")
  {
    ros::param::del(private_name_);
    set("vehicle", name);
    set("detection/deadline_s", 20.0);
    set("speech/deadline_s", 20.0);
    set("local/lost_s", 30.0);
    set("probes/period_s", 0.05);
    set("probes/period_far_s", 0.1);
    set("probes/valid_s", 60.0);
    set("link/unanswered_s", 60.0);
    set("link/reconnect_s", 0.02);
    set("link/max_reconnect_s", 0.1);
    set("diagnostic_period", 0.1);
    set("warning_period_s", 2.0);
    set("odometry_timeout_s", 60.0);
    set("verify/every", 0);
    camera = ros::NodeHandle("/" + name).advertise<sensor_msgs::Image>("image", 100);
  }

  template <typename Value>
  void set(const std::string& parameter, const Value& value)
  {
    ros::param::set(private_name_ + "/" + parameter, value);
  }
  void start()
  {
    coordinator_ = std::make_unique<CoordinatorRos>(ros::NodeHandle("/" + name_), ros::NodeHandle(private_name_));
  }
  void stop() { coordinator_.reset(); }
  /// Listens to the results, and waits until pictures get through.
  bool listen()
  {
    detections = std::make_unique<Collector<pi_detect::Detection2DArray>>("/" + name_ + "/detections");
    return detections->waitForPublisher() && decisions.waitForPublisher() &&
           until(TIMEOUT_S, [this] { return camera.getNumSubscribers() == 1; });
  }

  /// With one node, "lamp", to which tasks go when this returns true. Listens to the results.
  bool startBeside(const FakeEdgeNode& node)
  {
    start();
    add("lamp", node.address());
    return listen() && waitUntilUsed("lamp");
  }

  template <typename Service>
  bool call(const std::string& service, Service* message) const
  {
    return ros::service::call(private_name_ + "/" + service, *message);
  }
  RegisterNode::Response add(const std::string& id, const std::string& address, double x = 0.0, double range = INFINITY,
                             const std::string& frame = "") const
  {
    RegisterNode service;
    service.request.node.id = id;
    service.request.node.address = address;
    service.request.node.x = x;
    service.request.node.range = range;
    service.request.node.frame_id = frame;
    EXPECT_TRUE(call("register_node", &service));
    return service.response;
  }
  RegisterNode::Response remove(const std::string& id) const
  {
    RegisterNode service;
    service.request.node.id = id;
    service.request.remove = true;
    EXPECT_TRUE(call("register_node", &service));
    return service.response;
  }
  /// Where a task would be done now. "?": the service failed.
  std::string place(const std::string& kind = "detection") const
  {
    Decide service;
    service.request.kind = kind;
    service.request.input_bytes = 2000.0;
    return call("decide", &service) && service.response.success ? service.response.node : "?";
  }
  /// @param node  empty: the vehicle.
  bool waitUntilUsed(const std::string& node, const std::string& kind = "detection") const
  {
    return until(TIMEOUT_S, [&] { return place(kind) == node; });
  }
  bool enable(bool enabled) const
  {
    std_srvs::SetBool service;
    service.request.data = enabled;
    return call("enable", &service) && service.response.success;
  }
  OffloadStatistics statistics(size_t kind = 0) const
  {
    Statistics service;
    EXPECT_TRUE(call("statistics", &service));
    return service.response.kinds.size() > kind ? service.response.kinds[kind] : OffloadStatistics();
  }
  EdgeNodeStatus node(const std::string& id) const
  {
    Nodes service;
    EXPECT_TRUE(call("nodes", &service));
    for (const EdgeNodeStatus& status : service.response.nodes)
    {
      if (status.node.id == id)
      {
        return status;
      }
    }
    return EdgeNodeStatus();
  }

  /// Stamps grow from picture to picture.
  sensor_msgs::ImagePtr makePicture()
  {
    stamp_ = std::max(ros::Time::now(), stamp_ + ros::Duration(0.001));
    const auto image = boost::make_shared<sensor_msgs::Image>();
    image->header.stamp = stamp_;
    image->header.frame_id = "camera";
    image->encoding = "mono8";
    image->width = 64;
    image->height = 48;
    image->step = 64;
    image->data.assign(64 * 48, 80);
    return image;
  }
  ros::Time show()
  {
    const sensor_msgs::ImagePtr image = makePicture();
    const ros::Time stamp = image->header.stamp;
    camera.publish(sensor_msgs::ImageConstPtr(image));
    return stamp;
  }
  /// What was found in a picture; -1: nothing was published.
  int found(const ros::Time& stamp) const
  {
    if (!detections->waitForStamp(stamp))
    {
      return -1;
    }
    for (const auto& message : detections->messages())
    {
      if (message->header.stamp == stamp && message->detections.size() == 1)
      {
        return static_cast<int>(message->detections[0].results.at(0).id);
      }
    }
    return -2;
  }
  size_t results(const ros::Time& stamp) const
  {
    const auto messages = detections->messages();
    return static_cast<size_t>(std::count_if(messages.begin(), messages.end(),
                                             [&stamp](const auto& message) { return message->header.stamp == stamp; }));
  }
  /// How a picture's task ended, as "remote lamp".
  std::string end(const ros::Time& stamp) const
  {
    if (!decisions.waitForStamp(stamp))
    {
      return "";
    }
    for (const auto& decision : decisions.messages())
    {
      if (decision->header.stamp == stamp)
      {
        return decision->how + (decision->node.empty() ? "" : " " + decision->node);
      }
    }
    return "";
  }

private:
  const std::string name_;
  const std::string private_name_;
  ros::Time stamp_;

public:
  ros::Publisher camera;
  Collector<OffloadDecision> decisions;
  std::unique_ptr<Collector<pi_detect::Detection2DArray>> detections;

private:
  std::unique_ptr<CoordinatorRos> coordinator_;
};

}  // namespace pi_offload
