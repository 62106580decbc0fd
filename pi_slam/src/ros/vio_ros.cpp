#include "ros/vio_ros.h"

#include <pi_node/formatting.h>
#include <pi_node/ros/node_options.h>
#include <pi_runtime/runtime.h>
#include <ros/poll_manager.h>

#include <utility>

namespace pi_slam
{
namespace
{

constexpr double TICK_S = 0.1;

std::shared_ptr<pi_runtime::Runtime> runtimeFor(const VioRosOptions& options)
{
  const bool kernels = options.vio.tracker.kernel_tasks || options.mapper.kernel_tasks;
  return options.use_runtime ? pi_runtime::Runtime::shared(pi_runtime::RuntimeOptions::forService(kernels)) : nullptr;
}

}  // namespace

VioRos::VioRos(ros::NodeHandle node, ros::NodeHandle private_node)
  : imu_thread_("vio_imu")
  , input_thread_("vio_input")
  , output_thread_("vio_output")
  , service_thread_("vio_service")
  , output_node_(output_thread_.handle(node))
  , options_(pi_node::loadNodeOptions<VioRosOptions>(private_node, "vio"))
  , runtime_(runtimeFor(options_))
  , warnings_(options_.warning_period_s, pi_node::warningLog<VioRosOptions>("vio"))
  , diagnostics_(output_node_, private_node, &warnings_, options_.input_timeout_s)
  , session_(options_, runtime_, &warnings_, &diagnostics_)
  , calibrator_(options_, runtime_, topics_, &session_, &warnings_)
  , outputs_(options_, output_node_, service_thread_.handle(private_node), &session_, &output_thread_, &warnings_)
  , worker_(options_, topics_, &session_, &outputs_, &warnings_, &diagnostics_)
  , inputs_(options_, imu_thread_.handle(node), input_thread_.handle(node), &topics_, &session_, &calibrator_,
            &outputs_, &warnings_, &diagnostics_)
  , services_(options_, service_thread_.handle(private_node), &session_)
  , grid_(options_, service_thread_.handle(node), &session_, &warnings_)
  , gnss_(options_, service_thread_.handle(node), &session_, &topics_.gnss, &warnings_)
  , initial_pose_(options_, service_thread_.handle(node), &session_, &warnings_)
{
  const auto repeat = [this](double period_s, auto&& function)
  { timers_.push_back(pi_node::VehicleTimer(output_node_, period_s, [function] { function(); })); };
  repeat(TICK_S,
         [this]
         {
           calibrator_.prepare();
           watchInputs();
         });
  repeat(options_.path_period_s, [this] { outputs_.publishPath(); });
  repeat(options_.points_period_s, [this] { outputs_.publishPoints(); });
  repeat(options_.diagnostic_period, [this] { publishDiagnostics(); });
  timers_.push_back(
      pi_node::VehicleTimer(service_thread_.handle(node), options_.map_period_s, [this] { grid_.publish(); }));

  calibrator_.prepare();  // with everything from files there is nothing to wait for
  if (runtime_)
  {
    // The streams of this and of other services must not keep IMU samples and poses waiting.
    for (pi_node::CallbackThread* const thread : {&imu_thread_, &input_thread_})
    {
      thread->post([this] { runtime_->raiseThread(); });
    }
    receiving_ = ros::PollManager::instance()->addPollThreadListener(
        [this, raised = false]() mutable
        {
          if (!std::exchange(raised, true))
          {
            runtime_->raiseThread();
          }
        });
  }
  worker_.start(runtime_);
  imu_thread_.start();
  input_thread_.start();
  output_thread_.start();
  service_thread_.start();
}

VioRos::~VioRos()
{
  ros::PollManager::instance()->removePollThreadListener(receiving_);
  session_.stop();
  imu_thread_.stop();
  input_thread_.stop();
  output_thread_.stop();
  service_thread_.stop();
  services_.saveAtEnd();
}

void VioRos::watchInputs()
{
  for (const pi_node::InputTopic* input :
       {&topics_.imu, &topics_.pictures[LEFT], &topics_.pictures[RIGHT], &topics_.wheels, &topics_.gnss})
  {
    const double silent_s = input->silentSeconds();
    if (!input->topic.empty() && silent_s > options_.input_timeout_s)
    {
      warnings_.warn(input->topic + ": nothing for " + pi_node::format("%.1f", silent_s) +
                     " s; check that the driver runs and that the topic is its");
    }
  }
}

void VioRos::publishDiagnostics()
{
  VioFigures figures;
  for (const pi_node::InputTopic* input :
       {&topics_.imu, &topics_.pictures[LEFT], &topics_.pictures[RIGHT], &topics_.wheels, &topics_.gnss})
  {
    if (!input->topic.empty())
    {
      figures.inputs.push_back({input->topic, input->messages, input->silentSeconds()});
    }
  }
  session_.fill(&figures);
  figures.odometries = outputs_.odometries();
  diagnostics_.update(figures);
}

}  // namespace pi_slam
