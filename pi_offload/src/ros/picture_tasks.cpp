#include "ros/picture_tasks.h"

#include <pi_detect/model_description.h>
#include <pi_detect/ros/conversions.h>
#include <pi_node/durations.h>
#include <pi_node/formatting.h>
#include <pi_node/vehicle_clock.h>
#include <ros/package.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <limits>
#include <stdexcept>
#include <vector>

#include "ros/conversions.h"

namespace pi_offload
{
namespace
{

namespace zero_copy = pi_os_transport::zero_copy;
using pi_node::format;

constexpr size_t MOST_POSTED = 16;       ///< pictures on their way to the engine thread
constexpr uint32_t RESULTS_QUEUE = 128;  ///< all that waited for an older result are published at once
constexpr double BEGINS_AGAIN_S = 1.0;   ///< a stamp that goes back further starts another drive
constexpr double CHECK_WAITS_S = 2.0;    ///< then it begins though a task may come late by it
constexpr double CHECK_LOST_S = 10.0;    ///< then it is given up
constexpr double CHECK_FACTOR = 2.2;     ///< times of the detector that a check leaves for a fallback and itself
constexpr double WORK_GAIN = 0.125;      ///< weight of the newest time of the vehicle's detector

PictureData dataOf(const pi_detect::PictureView& view)
{
  PictureData data;
  data.data = view.data;
  data.width = view.width;
  data.height = view.height;
  data.stride = view.stride;
  switch (view.format)
  {
    case pi_detect::PictureView::Format::BGR8:
      data.encoding = Encoding::BGR8;
      break;
    case pi_detect::PictureView::Format::RGB8:
      data.encoding = Encoding::RGB8;
      break;
    case pi_detect::PictureView::Format::MONO8:
      data.encoding = Encoding::MONO8;
      break;
  }
  return data;
}

/// Classes of pi_detect's networks, by the network's name.
std::map<std::string, std::set<std::string>> packagedNetworks()
{
  std::map<std::string, std::set<std::string>> networks;
  std::error_code error;
  const std::string folder = ros::package::getPath("pi_detect") + "/config/models";
  for (const auto& entry : std::filesystem::directory_iterator(folder, error))
  {
    try
    {
      const auto model = pi_detect::ModelDescription::load(entry.path().string());
      for (const auto& [id, label] : model.labels)
      {
        networks[model.name].insert(label);
      }
    }
    catch (const pi_detect::ModelError&)
    {
      continue;  // no description of a network
    }
  }
  return networks;
}

}  // namespace

PictureTasks::PictureTasks(ros::NodeHandle input_node, ros::NodeHandle service_node,
                           const CoordinatorRosOptions* options, OffloadClient* client, AnswerCheck* checks,
                           TaskLedger* ledger, pi_node::WarningBoard* warnings)
  : input_node_(std::move(input_node))
  , topic_(input_node_.resolveName("image"))
  , options_(options)
  , deadline_s_(options->client.engine.needs[static_cast<size_t>(TaskKind::DETECTION)].deadline_s)
  , client_(client)
  , checks_(checks)
  , ledger_(ledger)
  , warnings_(warnings)
  , rate_limit_(options->max_rate_hz)
  , local_queue_(options->max_local_waiting, options->local_lost_s)
  , local_work_s_(options->detection_local_s)
  , networks_(packagedNetworks())
{
  const auto look = [this](const ros::SingleSubscriberPublisher&) { updateSubscription(); };
  detections_ = pi_detect::DetectionPublisher(service_node, RESULTS_QUEUE, look);
  const auto look_local = [this](const ros::SingleSubscriberPublisher&)
  { client_->post([this](int64_t now_ns) { giveNext(now_ns); }); };
  local_image_ = service_node.advertise<sensor_msgs::Image>("local/image", 2, look_local, look_local);
  local_labels_ =
      input_node_.subscribe("local/labels", 1, &PictureTasks::onLocalLabels, this, ros::TransportHints().tcpNoDelay());
}

// ------------------------------------------------------------------------------------------------------ service thread

void PictureTasks::updateSubscription()
{
  const bool wanted = options_->always_on || detections_.getNumSubscribers() > 0;
  if (wanted == subscribed_)
  {
    return;
  }
  subscribed_ = wanted;
  if (!wanted)
  {
    image_.shutdown();
    local_detections_.shutdown();
    client_->post(
        [this](int64_t now_ns)
        {
          for (const LocalQueue::Entry& entry : local_queue_.clear())
          {
            localFailed(entry.task, now_ns);
          }
        });
    return;
  }
  came_at_ns_ = pi_node::vehicleNs();
  const ros::TransportHints hints = ros::TransportHints().tcpNoDelay();
  local_detections_ = input_node_.subscribe("local/detections", 8, &PictureTasks::onLocalDetections, this, hints);
  image_ = zero_copy::subscribeImages(
      input_node_, "image", 8, options_->zero_copy, [this](const zero_copy::ImageHandle& message) { onImage(message); },
      hints);
}

void PictureTasks::fillInput(CoordinatorFigures* figures) const
{
  figures->topic = topic_;
  figures->subscribed = subscribed_;
  figures->pictures = came_;
  figures->silent_s = pi_node::secondsBetween(came_at_ns_, pi_node::vehicleNs());
  figures->crowded = crowded_;
}

// -------------------------------------------------------------------------------------------------------- input thread

void PictureTasks::onImage(const zero_copy::ImageHandle& message)
{
  const int64_t arrived_ns = pi_node::monotonicNs();
  came_at_ns_ = pi_node::vehicleNs();
  ++came_;
  if (!rate_limit_.take(message->header.stamp.isZero() ? came_at_ns_.load() : pi_node::fromMsg(message->header.stamp)))
  {
    return;
  }
  std::shared_ptr<const pi_detect::MessagePicture> picture;
  try
  {
    picture = std::make_shared<const pi_detect::MessagePicture>(message, &used_bits_);
  }
  catch (const std::invalid_argument& error)
  {
    warnings_->error(topic_ + ": " + error.what() + "; picture ignored");
    return;
  }
  if (posted_ >= MOST_POSTED)
  {
    ++crowded_;
    warnings_->warn(topic_ + ": too many pictures at once, some are dropped; the computer is too busy");
    return;
  }
  // The deadline counts from the stamp, unless the stamp is in the future or older than the deadline.
  int64_t created_ns = arrived_ns;
  if (!message->header.stamp.isZero())
  {
    const int64_t age_ns = pi_detect::fromMsg(ros::Time::now()) - pi_detect::fromMsg(message->header.stamp);
    if (age_ns > 0 && pi_node::seconds(age_ns) <= deadline_s_)
    {
      created_ns -= age_ns;
    }
  }
  ++posted_;
  client_->post(
      [this, picture, message, created_ns](int64_t now_ns)
      {
        --posted_;
        submit(picture, message, created_ns, now_ns);
      });
}

void PictureTasks::onLocalDetections(const pi_detect::Detection2DArrayConstPtr& message)
{
  client_->post([this, message](int64_t now_ns) { onLocalResult(message, now_ns); });
}

void PictureTasks::onLocalLabels(const pi_detect::LabelArrayConstPtr& message)
{
  client_->post(
      [this, message](int64_t now_ns)
      {
        local_model_ = message->model;
        class_ids_ = idsByName(*message);
        client_->setClassesKnown(!class_ids_.empty());
        giveNext(now_ns);
      });
}

// ------------------------------------------------------------------------------------------------------- engine thread

void PictureTasks::submit(const std::shared_ptr<const pi_detect::MessagePicture>& picture,
                          const zero_copy::ImageHandle& message, int64_t created_ns, int64_t now_ns)
{
  const ros::Time& stamp = message->header.stamp;
  const double back_s = pi_node::seconds(pi_detect::fromMsg(submitted_stamp_) - pi_detect::fromMsg(stamp));
  if (back_s > BEGINS_AGAIN_S)
  {
    warnings_->warn(topic_ + format(": stamps went back by %.1f s", back_s) + "; a recording that begins again?");
    while (!ready_.empty())
    {
      publishFirst();
    }
    ++epoch_;
    published_stamp_ = ros::Time();
  }
  submitted_stamp_ = stamp;
  const uint64_t task = ledger_->newTask();
  pictures_[task] = {picture, message, epoch_, created_ns + std::llround(1e9 * deadline_s_), nullptr};
  TaskData data;
  data.picture = dataOf(picture->view());
  data.keeper = picture;
  try
  {
    client_->submit(task, TaskKind::DETECTION, created_ns, deadline_s_, std::move(data), now_ns);
  }
  catch (const std::invalid_argument&)
  {
    pictures_.erase(task);
    throw;
  }
}

void PictureTasks::runLocal(const Task& task)
{
  const int64_t now_ns = pi_node::monotonicNs();
  const auto picture = pictures_.find(task.id);
  if (picture == pictures_.end())
  {
    client_->engine().onLocalFailed(task.id, now_ns);
    return;
  }
  const int64_t stamp_ns = pi_detect::fromMsg(picture->second.message->header.stamp);
  if (const auto dropped = local_queue_.add({task.id, stamp_ns, picture->second.deadline_ns}))
  {
    localFailed(dropped->task, now_ns);
  }
  giveNext(now_ns);
}

void PictureTasks::onLocalResult(const pi_detect::Detection2DArrayConstPtr& message, int64_t now_ns)
{
  const LocalQueue::Answer answer = local_queue_.answered(pi_detect::fromMsg(message->header.stamp), now_ns);
  if (!answer.expected)
  {
    return;
  }
  if (answer.skipped)
  {
    localFailed(answer.task, now_ns);
  }
  else
  {
    local_work_s_ += WORK_GAIN * (answer.work_s - local_work_s_);
    const auto picture = pictures_.find(answer.task);
    if (picture != pictures_.end())
    {
      picture->second.local = message;
    }
    client_->engine().onLocalDone(answer.task, answer.work_s, now_ns);
    if (check_ && check_->run == answer.task)
    {
      endCheck(*message, now_ns);
    }
  }
  giveNext(pi_node::monotonicNs());
}

/// Gives the detector the next picture. Does nothing while it is not there; is called again when it comes.
void PictureTasks::giveNext(int64_t now_ns)
{
  if (local_model_.empty() || local_image_.getNumSubscribers() == 0)
  {
    return;
  }
  beginCheck(now_ns);
  std::vector<LocalQueue::Entry> dropped;
  if (const auto next = local_queue_.next(now_ns, local_work_s_, &dropped))
  {
    // The message that came, not a copy.
    const bool checks = check_ && check_->run == next->task;
    const zero_copy::ImageHandle message = checks ? check_->message : pictures_.at(next->task).message;
    if (const sensor_msgs::ImageConstPtr standard = zero_copy::standardOf(message))
    {
      local_image_.publish(standard);
    }
    else
    {
      local_image_.publish(message);
    }
  }
  for (const LocalQueue::Entry& entry : dropped)
  {
    localFailed(entry.task, now_ns);
  }
}

void PictureTasks::localFailed(uint64_t task, int64_t now_ns)
{
  if (check_ && check_->run == task)
  {
    check_.reset();
  }
  client_->engine().onLocalFailed(task, now_ns);
}

/// Queues the picture of the check if the detector is free, and if tasks at nodes leave time for it.
void PictureTasks::beginCheck(int64_t now_ns)
{
  if (!check_ || check_->run != 0 || local_queue_.busy() || local_queue_.waiting() > 0)
  {
    return;
  }
  const int64_t need_ns = std::llround(1e9 * CHECK_FACTOR * local_work_s_);
  const bool waits = std::any_of(pictures_.begin(), pictures_.end(),
                                 [&](const auto& picture) { return picture.second.deadline_ns - now_ns < need_ns; });
  if (waits && pi_node::secondsBetween(check_->since_ns, now_ns) < CHECK_WAITS_S)
  {
    return;
  }
  check_->run = ledger_->newTask();
  client_->engine().onExtraRun(check_->run, TaskKind::DETECTION, now_ns);
  local_queue_.add(
      {check_->run, pi_detect::fromMsg(check_->message->header.stamp), std::numeric_limits<int64_t>::max()});
}

void PictureTasks::endCheck(const pi_detect::Detection2DArray& own, int64_t now_ns)
{
  const Check check = std::move(*check_);
  check_.reset();
  AnswerCheck::Pair pair;
  pair.answered = pi_detect::fromMsg(*check.answered);
  pair.own = pi_detect::fromMsg(own);
  pair.area = static_cast<float>(check.message->width) * static_cast<float>(check.message->height);
  std::set<int> common;
  const auto network = networks_.find(check.network);
  if (network != networks_.end())
  {
    for (const auto& [label, id] : class_ids_)
    {
      if (network->second.count(label) != 0)
      {
        common.insert(id);
      }
    }
    pair.common = &common;
  }
  if (checks_->judge(check.node, pair, now_ns))
  {
    warnings_->error("node " + check.node + ": " + checks_->status(check.node).reason);
    client_->engine().setTrusted(check.node, false, now_ns);
  }
}

void PictureTasks::deliver(const Outcome& outcome, const OffloadReply* reply)
{
  const auto found = pictures_.find(outcome.task.id);
  if (found == pictures_.end())
  {
    return;
  }
  const Picture picture = std::move(found->second);
  pictures_.erase(found);
  const std_msgs::Header header = zero_copy::standardHeader(picture.message->header);
  const int64_t now_ns = pi_node::monotonicNs();
  bool published = false;
  if (reply != nullptr)
  {
    const auto result = toMsg(reply->objects, class_ids_, picture.message->width, picture.message->height, header);
    published = publish(picture, result);
    if (!check_ && checks_->due(outcome.node))
    {
      check_ = Check{0, outcome.node, reply->model, result, picture.message, now_ns};
    }
  }
  else if (picture.local)
  {
    published = publish(picture, picture.local);
  }
  onTime(now_ns);
  ledger_->publish(outcome, header, !published);
  if (local_queue_.forget(outcome.task.id))
  {
    client_->engine().onLocalFailed(outcome.task.id, now_ns);
  }
  if (outcome.how == Outcome::How::ABANDONED && local_queue_.giveUp(outcome.task.id))
  {
    giveNext(now_ns);
  }
  if (check_ && check_->run == 0)
  {
    giveNext(now_ns);
  }
}

/// In order, a result that comes before its deadline is never too late: later ones wait for it until then.
bool PictureTasks::publish(const Picture& picture, const pi_detect::Detection2DArrayConstPtr& result)
{
  const ros::Time& stamp = picture.message->header.stamp;
  if (!options_->keep_order)
  {
    detections_.publish(result);
  }
  else if (picture.epoch != epoch_ || stamp < published_stamp_)
  {
    ++late_;
    return false;
  }
  else
  {
    ready_.emplace(stamp, result);
  }
  return true;
}

void PictureTasks::publishFirst()
{
  published_stamp_ = ready_.begin()->first;
  detections_.publish(ready_.begin()->second);
  ready_.erase(ready_.begin());
}

/// The latest deadline of older pictures without a result [ns]; INT64_MIN: there are none.
int64_t PictureTasks::firstWaitsUntil() const
{
  int64_t until_ns = std::numeric_limits<int64_t>::min();
  for (const auto& [task, picture] : pictures_)
  {
    if (picture.epoch == epoch_ && picture.message->header.stamp < ready_.begin()->first)
    {
      until_ns = std::max(until_ns, picture.deadline_ns);
    }
  }
  return until_ns;
}

int64_t PictureTasks::nextTime() const
{
  return ready_.empty() ? std::numeric_limits<int64_t>::max() : firstWaitsUntil();
}

void PictureTasks::onTime(int64_t now_ns)
{
  while (!ready_.empty() && firstWaitsUntil() <= now_ns)
  {
    publishFirst();
  }
}

void PictureTasks::tidy(int64_t now_ns)
{
  for (const std::string& node : checks_->pardoned(now_ns))
  {
    client_->engine().setTrusted(node, true, now_ns);
    warnings_->warn("node " + node + ": gets tasks again, its time out is over");
  }
  if (check_ && check_->run == 0 && pi_node::secondsBetween(check_->since_ns, now_ns) > CHECK_LOST_S)
  {
    check_.reset();  // the detector is not there
  }
  if (check_ || local_queue_.busy() || local_queue_.waiting() > 0)
  {
    giveNext(now_ns);
  }
}

void PictureTasks::fill(CoordinatorFigures* figures) const
{
  figures->late = late_;
  figures->held = ready_.size();
  figures->waiting = local_queue_.waiting();
  figures->checks = checks_->statuses();
  figures->model = local_model_;
  figures->detector_listens = local_image_.getNumSubscribers() > 0;
}

}  // namespace pi_offload
