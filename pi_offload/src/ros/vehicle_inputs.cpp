#include "ros/vehicle_inputs.h"

#include <pi_node/durations.h>
#include <pi_node/formatting.h>
#include <pi_node/vehicle_clock.h>

#include <cmath>
#include <exception>

#include "ros/conversions.h"

namespace pi_offload
{
namespace
{

using pi_node::format;

constexpr double ETA_STEP = 0.005;  ///< the battery changes eta by at least this much

}  // namespace

VehicleInputs::VehicleInputs(ros::NodeHandle node, const CoordinatorRosOptions* options, OffloadClient* client,
                             MapFrame* map, pi_node::WarningBoard* warnings)
  : options_(options), client_(client), map_(map), warnings_(warnings)
{
  const ros::TransportHints hints = ros::TransportHints().tcpNoDelay();
  subscribers_.push_back(node.subscribe("odometry", 1, &VehicleInputs::onOdometry, this, hints));
  subscribers_.push_back(node.subscribe("route", 1, &VehicleInputs::onRoute, this, hints));
  subscribers_.push_back(node.subscribe("battery", 1, &VehicleInputs::onBattery, this, hints));
}

void VehicleInputs::onOdometry(const nav_msgs::OdometryConstPtr& message)
{
  std::string problem;
  const auto transform = map_->from(message->header.frame_id, &problem);
  if (!problem.empty())
  {
    warnings_->warn("odometry: " + problem + "; without it nodes of finite range are not used");
  }
  if (!transform)
  {
    return;
  }
  const VehicleState state = fromMsg(*message, *transform);
  if (!state.known)
  {
    warnings_->warn("odometry: pose or speed is not finite; message ignored");
    return;
  }
  odometry_at_ns_ = pi_node::vehicleNs();
  vehicle_ = state;
  client_->post([this, state](int64_t) { client_->engine().setVehicle(state); });
}

void VehicleInputs::onRoute(const nav_msgs::PathConstPtr& message)
{
  std::string problem;
  const auto transform = map_->from(message->header.frame_id, &problem);
  if (!transform)
  {
    warnings_->warn("route: tf has no " + map_->name() + " -> " + message->header.frame_id +
                    "; this route is ignored, publish it again once there is one");
    return;
  }
  try
  {
    const std::vector<Point> route = fromMsg(*message, *transform);
    client_->call([this, &route](int64_t) { client_->engine().setRoute(route); });
  }
  catch (const std::exception& error)
  {
    warnings_->warn(std::string("route: ") + error.what() + "; the former one stays");
  }
}

void VehicleInputs::onBattery(const sensor_msgs::BatteryStateConstPtr& message)
{
  const std::optional<double> charge = chargeOf(*message);
  if (!charge)
  {
    if (!std::isnan(message->percentage))  // NaN: not measured
    {
      warnings_->warn(format("battery: percentage = %g", static_cast<double>(message->percentage)) +
                      ", must be in [0, 1], or NaN if it is not measured; eta stays as it is");
    }
    return;
  }
  charge_ = charge;
  const double eta = options_->battery.eta(*charge);
  if (eta_by_battery_)
  {
    client_->call(
        [this, eta](int64_t)
        {
          if (std::abs(client_->eta() - eta) >= ETA_STEP)
          {
            client_->setEta(eta);
          }
        });
  }
}

void VehicleInputs::watch()
{
  if (vehicle_.known && pi_node::seconds(pi_node::vehicleNs() - odometry_at_ns_) > options_->odometry_timeout_s)
  {
    vehicle_ = VehicleState();
    client_->post([this](int64_t) { client_->engine().setVehicle(VehicleState()); });
    warnings_->warn(format("odometry: nothing for %.1f s", options_->odometry_timeout_s) +
                    "; nodes of finite range are not used");
  }
}

bool VehicleInputs::setEta(SetEta::Request& request, SetEta::Response& response)
{
  try
  {
    const double eta = !request.by_battery ? request.eta
                       : charge_           ? options_->battery.eta(*charge_)
                                           : options_->client.engine.eta;
    client_->call([this, eta](int64_t) { client_->setEta(eta); });
    eta_by_battery_ = request.by_battery != 0;
    response.success = 1;
    response.message = !eta_by_battery_ ? "eta holds until by_battery"
                       : charge_        ? format("the battery decides, %.0f %% full", 100.0 * *charge_)
                                        : "the battery decides once it says how full it is";
  }
  catch (const std::exception& error)
  {
    response.message = error.what();
  }
  response.eta = client_->call([this](int64_t) { return client_->eta(); });
  return true;
}

void VehicleInputs::fill(CoordinatorFigures* figures) const
{
  figures->position_known = vehicle_.known;
  figures->position = vehicle_.known         ? "known"
                      : odometry_at_ns_ == 0 ? "not known, no odometry that fits came"
                                             : "not known, no odometry comes any more";
}

}  // namespace pi_offload
