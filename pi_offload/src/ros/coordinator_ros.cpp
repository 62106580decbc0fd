#include <pi_detect/ros/conversions.h>
#include "engine/node_file.h"
#include "ros/conversions.h"
#include "ros/coordinator_ros.h"
#include <pi_node/formatting.h>
#include <pi_node/ros/node_options.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <exception>
#include <utility>

namespace pi_offload
{
namespace
{

using pi_os_transport::zero_copy::ImageHandle;
using pi_node::format;

constexpr size_t MOST_POSTED = 16;      ///< pictures on their way to the engine
constexpr size_t RECENT_TASKS = 1000;   ///< for quantiles of the response time
constexpr double BEGINS_AGAIN_S = 1.0;  ///< stamps that go back so far are those of another drive
constexpr size_t DETECTION = static_cast<size_t>(TaskKind::DETECTION);
constexpr size_t SPEECH = static_cast<size_t>(TaskKind::SPEECH);

/// Two coordinators of one computer have two names.
std::string defaultVehicle(const std::string& node_name)
{
  char host[256] = "";
  gethostname(host, sizeof host - 1);
  std::string name = host + node_name;
  constexpr size_t LONGEST = 64;
  return name.size() <= LONGEST ? name : name.substr(name.size() - LONGEST);
}

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

}  // namespace

CoordinatorRos::CoordinatorRos(ros::NodeHandle node, ros::NodeHandle private_node)
  : input_thread_("offload_input")
  , service_thread_("offload_service")
  , input_node_(input_thread_.handle(node))
  , service_node_(service_thread_.handle(node))
  , service_private_node_(service_thread_.handle(private_node))
  , options_(pi_node::loadNodeOptions<CoordinatorRosOptions>(private_node, "coordinator"))
  , topic_(node.resolveName("image"))
  , vehicle_name_(options_.vehicle.empty() ? defaultVehicle(private_node.getNamespace()) : options_.vehicle)
  , warnings_(options_.warning_period_s, pi_node::warningLog<CoordinatorRosOptions>("coordinator"))
  , diagnostics_(service_node_, private_node, &warnings_, options_.input_timeout_s)
  , map_(node, options_.map_frame)
  , node_markers_(options_.map_frame)
  , local_(options_.max_local_waiting, options_.local_lost_s)
  , local_s_(options_.detection_local_s)
  , model_(options_.local_model)
  , response_s_{pi_node::RecentValues(RECENT_TASKS), pi_node::RecentValues(RECENT_TASKS)}
  , policy_name_(options_.client.engine.policy_name)
  , policy_(options_.client.engine.policy)
{
  OffloadClient::Callbacks callbacks;
  callbacks.run_local = [this](const Task& task) { runLocal(task); };
  callbacks.deliver = [this](const Outcome& outcome, const OffloadReply* reply) { deliver(outcome, reply); };
  callbacks.log = [this](bool error, const std::string& text) { error ? warnings_.error(text) : warnings_.warn(text); };
  client_ = std::make_unique<OffloadClient>(options_.clientOptions(vehicle_name_), std::move(callbacks));
  client_->setModel(model_);
  loadNodes();
  advertise();
  subscribe();

  client_->start();
  speech_threads_ = std::make_unique<ros::AsyncSpinner>(static_cast<uint32_t>(options_.max_calls) + 1, &speech_queue_);
  speech_threads_->start();
  input_thread_.start();
  service_thread_.start();
}

CoordinatorRos::~CoordinatorRos()
{
  {
    std::lock_guard<std::mutex> lock(calls_mutex_);
    stopping_ = true;
  }
  call_changed_.notify_all();
  utterances_.shutdown();
  speech_threads_->stop();
  input_thread_.stop();
  service_thread_.stop();
  client_->stop();
  image_.shutdown();
  local_detections_.shutdown();
  subscribers_.clear();
  services_.clear();
}

void CoordinatorRos::loadNodes()
{
  std::vector<NodeDescription> nodes = options_.nodes;
  if (!options_.nodes_file.empty())
  {
    const std::vector<NodeDescription> of_file = loadNodeFile(options_.nodes_file);
    nodes.insert(nodes.begin(), of_file.begin(), of_file.end());
    try
    {
      requireUniqueIds(nodes);
    }
    catch (const std::invalid_argument& error)
    {
      throw std::invalid_argument(options_.nodes_file + " and parameter nodes: " + error.what());
    }
  }
  if (nodes.size() > options_.max_nodes)
  {
    throw std::invalid_argument(options_.nodes_file + ": there are " + std::to_string(nodes.size()) +
                                " nodes, must be at most max_nodes = " + std::to_string(options_.max_nodes));
  }
  for (const NodeDescription& node : nodes)
  {
    client_->setNode(node, monotonicNs());
  }
}

// ------------------------------------------------------------------------------------------------------ offload_input

void CoordinatorRos::onImage(const ImageHandle& message)
{
  const int64_t arrived_ns = monotonicNs();
  came_at_ns_ = arrived_ns;
  ++pictures_came_;
  if (!rate_limit_.take(std::chrono::steady_clock::now()))
  {
    return;
  }
  std::shared_ptr<const pi_detect::MessagePicture> picture;
  try
  {
    picture = std::make_shared<const pi_detect::MessagePicture>(message);
  }
  catch (const std::invalid_argument& error)
  {
    warnings_.error(topic_ + ": " + error.what() + "; picture ignored");
    return;
  }
  if (pictures_posted_ >= MOST_POSTED)
  {
    ++pictures_crowded_;
    warnings_.warn(topic_ + ": too many pictures at once, some are dropped; the computer is too busy");
    return;
  }
  // The deadline counts from the stamp on, where that can be.
  int64_t created_ns = arrived_ns;
  if (!message->header.stamp.isZero())
  {
    const int64_t age_ns = pi_detect::fromMsg(ros::Time::now()) - pi_detect::fromMsg(message->header.stamp);
    if (age_ns > 0 && 1e-9 * static_cast<double>(age_ns) <= options_.client.engine.needs[DETECTION].deadline_s)
    {
      created_ns -= age_ns;
    }
  }
  ++pictures_posted_;
  client_->post(
      [this, picture, message, created_ns](int64_t now_ns)
      {
        --pictures_posted_;
        submit(picture, message, created_ns, now_ns);
      });
}

void CoordinatorRos::onLocalDetections(const pi_detect::Detection2DArrayConstPtr& message)
{
  client_->post(
      [this, message](int64_t now_ns)
      {
        const LocalQueue::Answer answer = local_.answered(pi_detect::fromMsg(message->header.stamp), now_ns);
        if (!answer.expected)
        {
          return;
        }
        if (answer.skipped)
        {
          client_->engine().onLocalFailed(answer.task, "the vehicle's detector left it out", now_ns);
        }
        else
        {
          local_s_ += 0.125 * (answer.work_s - local_s_);
          const auto picture = pictures_.find(answer.task);
          if (picture != pictures_.end())
          {
            picture->second.local = message;
          }
          client_->engine().onLocalDone(answer.task, answer.work_s, now_ns);
        }
        giveToDetector(monotonicNs());
      });
}

void CoordinatorRos::onLabels(const pi_detect::LabelArrayConstPtr& message)
{
  if (!options_.local_model.empty())
  {
    return;
  }
  client_->post(
      [this, message](int64_t now_ns)
      {
        model_ = message->model;
        client_->setModel(model_);
        giveToDetector(now_ns);
      });
}

// ----------------------------------------------------------------------------------------------------- offload_engine

void CoordinatorRos::submit(const std::shared_ptr<const pi_detect::MessagePicture>& picture, const ImageHandle& message,
                            int64_t created_ns, int64_t now_ns)
{
  const ros::Time& stamp = message->header.stamp;
  const double back_s = 1e-9 * static_cast<double>(pi_detect::fromMsg(submitted_stamp_) - pi_detect::fromMsg(stamp));
  if (back_s > BEGINS_AGAIN_S)
  {
    warnings_.warn(topic_ + format(": stamps went back by %.1f s", back_s) + "; a recording that begins again?");
    ++epoch_;
    published_stamp_ = ros::Time();
  }
  submitted_stamp_ = stamp;
  const double deadline_s = options_.client.engine.needs[DETECTION].deadline_s;
  const uint64_t task = next_task_++;
  Picture& entry = pictures_[task];
  entry.picture = picture;
  entry.message = message;
  entry.epoch = epoch_;
  entry.deadline_ns = created_ns + std::llround(1e9 * deadline_s);
  TaskData data;
  data.picture = dataOf(picture->view());
  data.keeper = picture;
  try
  {
    client_->submit(task, TaskKind::DETECTION, created_ns, deadline_s, std::move(data), now_ns);
  }
  catch (const std::invalid_argument&)
  {
    pictures_.erase(task);
    throw;
  }
}

void CoordinatorRos::runLocal(const Task& task)
{
  const int64_t now_ns = monotonicNs();
  if (task.kind == TaskKind::SPEECH)
  {
    answer(task.id, nullptr, "");
    client_->engine().onLocalDone(task.id, options_.speech_local_s, now_ns);
    return;
  }
  const auto picture = pictures_.find(task.id);
  if (picture == pictures_.end())
  {
    client_->engine().onLocalFailed(task.id, "the picture is gone", now_ns);
    return;
  }
  const LocalQueue::Entry entry{task.id, pi_detect::fromMsg(picture->second.message->header.stamp),
                                picture->second.deadline_ns};
  if (const auto dropped = local_.add(entry))
  {
    client_->engine().onLocalFailed(dropped->task, "too many pictures wait for the vehicle's detector", now_ns);
  }
  giveToDetector(now_ns);
}

bool CoordinatorRos::detectorReady() const
{
  return !model_.empty() && local_image_.getNumSubscribers() > 0;
}

void CoordinatorRos::giveToDetector(int64_t now_ns)
{
  if (!detectorReady())
  {
    return;  // they wait for it; giveToDetector() comes again with it
  }
  std::vector<LocalQueue::Entry> dropped;
  const std::optional<LocalQueue::Entry> next = local_.next(now_ns, local_s_, &dropped);
  if (next)
  {
    // The very message that came.
    const ImageHandle& message = pictures_.at(next->task).message;
    if (const sensor_msgs::ImageConstPtr standard = pi_os_transport::zero_copy::standardOf(message))
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
    client_->engine().onLocalFailed(entry.task, "too late for the vehicle's detector, or it did not answer", now_ns);
  }
}

void CoordinatorRos::deliver(const Outcome& outcome, const OffloadReply* reply)
{
  if (outcome.task.kind == TaskKind::DETECTION)
  {
    deliverPicture(outcome, reply);
  }
  else
  {
    deliverUtterance(outcome, reply);
  }
}

void CoordinatorRos::deliverPicture(const Outcome& outcome, const OffloadReply* reply)
{
  const auto found = pictures_.find(outcome.task.id);
  if (found == pictures_.end())
  {
    return;
  }
  const Picture picture = std::move(found->second);
  pictures_.erase(found);
  const std_msgs::Header header = pi_os_transport::zero_copy::standardHeader(picture.message->header);
  if (reply != nullptr)
  {
    publish(picture, toMsg(reply->objects, picture.message->width, picture.message->height, header));
  }
  else if (picture.local)
  {
    publish(picture, picture.local);
  }
  publishDecision(outcome, header);
  const int64_t now_ns = monotonicNs();
  if (local_.forget(outcome.task.id))
  {
    client_->engine().onLocalFailed(outcome.task.id, "its node answered first", now_ns);
  }
  if (outcome.how == Outcome::How::ABANDONED && local_.giveUp(outcome.task.id))
  {
    giveToDetector(now_ns);
  }
}

void CoordinatorRos::publish(const Picture& picture, const pi_detect::Detection2DArrayConstPtr& result)
{
  const ros::Time& stamp = picture.message->header.stamp;
  if (options_.keep_order && (picture.epoch != epoch_ || stamp < published_stamp_))
  {
    ++late_;
    return;
  }
  published_stamp_ = picture.epoch == epoch_ ? std::max(published_stamp_, stamp) : published_stamp_;
  detections_.publish(result);
}

void CoordinatorRos::deliverUtterance(const Outcome& outcome, const OffloadReply* reply)
{
  const auto found = calls_.find(outcome.task.id);
  if (found == calls_.end())
  {
    return;
  }
  const std::shared_ptr<Call> call = found->second;
  answer(outcome.task.id, reply, outcome.node);
  calls_.erase(outcome.task.id);
  publishDecision(outcome, call->header);
}

void CoordinatorRos::publishDecision(const Outcome& outcome, const std_msgs::Header& header)
{
  OffloadDecision decision = toMsg(outcome, header);
  const bool by_vehicle = outcome.how == Outcome::How::LOCAL || outcome.how == Outcome::How::FALLBACK;
  if (outcome.task.kind == TaskKind::SPEECH && by_vehicle)
  {
    decision.response_time += options_.speech_local_s;  // the recogniser begins now
    decision.by_deadline = static_cast<uint8_t>(decision.response_time <= decision.deadline);
  }
  response_s_[static_cast<size_t>(outcome.task.kind)].add(decision.response_time);
  decisions_.publish(decision);
}

void CoordinatorRos::answer(uint64_t task, const OffloadReply* reply, const std::string& node)
{
  const auto found = calls_.find(task);
  if (found == calls_.end())
  {
    return;
  }
  {
    std::lock_guard<std::mutex> lock(calls_mutex_);
    Call& call = *found->second;
    if (call.done)
    {
      return;
    }
    call.done = true;
    call.response.handled = static_cast<uint8_t>(reply != nullptr);
    if (reply != nullptr)
    {
      call.response.text = reply->text;
      call.response.confidence = static_cast<double>(reply->confidence);
      call.response.accepted = static_cast<uint8_t>(reply->accepted);
      call.response.node = node;
    }
  }
  call_changed_.notify_all();
}

CoordinatorFigures CoordinatorRos::figures(int64_t now_ns)
{
  CoordinatorFigures figures;
  figures.late = late_;
  figures.waiting = local_.waiting();
  figures.model = model_;
  figures.detector_listens = local_image_.getNumSubscribers() > 0;
  figures.eta = client_->eta();
  figures.enabled = client_->enabled();
  figures.jpeg_ms_per_mpixel = 1e3 * client_->encoder().jpegSecondsPerMpixel();
  figures.jpeg_bytes_per_pixel = client_->encoder().jpegBytesPerPixel();
  figures.statistics = client_->engine().statistics();
  for (size_t kind = 0; kind < TASK_KINDS; ++kind)
  {
    figures.p50_s[kind] = response_s_[kind].quantile(0.5);
    figures.p99_s[kind] = response_s_[kind].quantile(0.99);
    figures.last_node[kind] = client_->engine().lastNode(static_cast<TaskKind>(kind));
  }
  figures.nodes = client_->engine().nodes(now_ns);
  figures.links = client_->links();
  return figures;
}

// ----------------------------------------------------------------------------------------------------- speech threads

bool CoordinatorRos::recognizeUtterance(pi_speech::RecognizeUtterance::Request& request,
                                        pi_speech::RecognizeUtterance::Response& response)
{
  const int64_t began_ns = monotonicNs();
  const double usual_s = options_.client.engine.needs[SPEECH].deadline_s;
  const double deadline_s = request.deadline > 0.0 && request.deadline < 60.0 ? request.deadline : usual_s;
  response.handled = 0;
  if (request.samples.empty() || 2 * request.samples.size() > MAX_PAYLOAD)
  {
    warnings_.warn("recognize_utterance: " + std::to_string(request.samples.size()) + " samples, must be 1 to " +
                   std::to_string(MAX_PAYLOAD / 2) + "; the recogniser does it itself");
    return true;
  }
  // One thread always is free, so that no call waits for another's end.
  struct Running
  {
    std::atomic<int>& count;
    const int now;
    explicit Running(std::atomic<int>& calls) : count(calls), now(++calls) {}
    ~Running() { --count; }
  } const running(calls_running_);
  if (running.now > options_.max_calls)
  {
    warnings_.warn("recognize_utterance: more than " + std::to_string(options_.max_calls) +
                   " calls at a time; the recogniser does it itself");
    return true;
  }
  TaskData data;
  data.encoding = Encoding::S16LE;
  data.bytes.reserve(2 * request.samples.size());
  for (const int16_t sample : request.samples)
  {
    data.bytes.push_back(static_cast<uint8_t>(static_cast<uint16_t>(sample) & 0xFFU));
    data.bytes.push_back(static_cast<uint8_t>(static_cast<uint16_t>(sample) >> 8U));
  }
  for (std::string command : request.commands)
  {
    std::replace(command.begin(), command.end(), '\n', ' ');
    data.options += (data.options.empty() ? "" : "\n") + command;
  }
  data.speech_s = request.speech_s >= 0.0 && std::isfinite(request.speech_s) ? request.speech_s : 0.0;
  const auto call = std::make_shared<Call>();
  call->header = request.header;
  const auto shared = std::make_shared<TaskData>(std::move(data));
  client_->post(
      [this, call, shared, began_ns, deadline_s](int64_t now_ns)
      {
        const uint64_t task = next_task_++;
        calls_[task] = call;
        try
        {
          client_->submit(task, TaskKind::SPEECH, began_ns, deadline_s, std::move(*shared), now_ns);
        }
        catch (const std::invalid_argument&)
        {
          answer(task, nullptr, "");
          calls_.erase(task);
          throw;
        }
      });
  const auto until =
      std::chrono::steady_clock::time_point(std::chrono::nanoseconds(began_ns + std::llround(1e9 * deadline_s)));
  std::unique_lock<std::mutex> lock(calls_mutex_);
  call_changed_.wait_until(lock, until, [this, &call] { return call->done || stopping_; });
  call->done = true;  // what comes later is not told to anybody
  response = call->response;
  return true;
}

}  // namespace pi_offload
