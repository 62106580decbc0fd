#pragma once

#include <nodelet/nodelet.h>
#include <pi_node/ros/vehicle_time.h>

#include <exception>
#include <memory>

namespace pi_node
{

/// A nodelet that builds an adapter from its NodeHandles. Export it under a name of the package:
///
///   using VioNodelet = pi_node::AdapterNodelet<VioRos>;
///   PLUGINLIB_EXPORT_CLASS(pi_slam::VioNodelet, nodelet::Nodelet)
///
/// If the constructor of the adapter throws, the reason is logged and the load fails. The manager itself logs no
/// reason.
template <typename Adapter>
class AdapterNodelet : public nodelet::Nodelet
{
private:
  void onInit() override
  {
    followRosTime();
    try
    {
      adapter_ = std::make_unique<Adapter>(getNodeHandle(), getPrivateNodeHandle());
    }
    catch (const std::exception& error)
    {
      NODELET_FATAL_STREAM(error.what());
      throw;
    }
  }

  std::unique_ptr<Adapter> adapter_;
};

}  // namespace pi_node
