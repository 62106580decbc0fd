#include "ros/ssd_worker.h"

#include <pi_detect/ros/conversions.h>
#include <pi_node/durations.h>
#include <pi_node/vehicle_clock.h>
#include <pthread.h>

#include <algorithm>
#include <exception>
#include <iterator>
#include <map>
#include <stdexcept>
#include <utility>

namespace pi_detect
{

using pi_node::secondsSince;

namespace zero_copy = pi_os_transport::zero_copy;

std::string describe(const Detector& detector)
{
  const TargetInUse& target = detector.target();
  return detector.model().name + " on " + toString(target.used) +
         (target.device.empty() ? "" : " (" + target.device + ")");
}

SsdWorker::SsdWorker(const SsdRosOptions& options, const std::string& topic, pi_node::WarningBoard* warnings,
                     SsdDiagnostics* diagnostics, const CameraTurn& turn,
                     std::function<void(const FoundObjects&)> publish)
  : options_(options)
  , topic_(topic)
  , warnings_(warnings)
  , diagnostics_(diagnostics)
  , turn_(turn)
  , publish_(std::move(publish))
  , rate_limit_(options.max_rate_hz)
  , answers_("detection", "ssd", topic)
{
}

void SsdWorker::start()
{
  thread_ = std::thread([this] { work(); });
}

void SsdWorker::stop()
{
  {
    std::lock_guard<std::mutex> lock(mutex_);
    stopping_ = true;
  }
  work_changed_.notify_all();
  thread_.join();
}

// ---------------------------------------------------------------------------------------------------------- any thread

void SsdWorker::add(const zero_copy::ImageHandle& picture)
{
  {
    std::lock_guard<std::mutex> lock(mutex_);
    ++figures_.pictures;
    came_at_ns_ = pi_node::vehicleNs();
    const ros::Time& stamp = picture->header.stamp;
    if (!detector_)
    {
      return;
    }
    if (!rate_limit_.take(stamp.isZero() ? came_at_ns_ : fromMsg(stamp)))
    {
      ++figures_.left_out;
      answers_.leftOut(fromMsg(stamp));
      return;
    }
    answers_.taken(fromMsg(stamp));
    figures_.dropped += picture_ ? 1 : 0;
    picture_ = picture;
  }
  work_changed_.notify_one();
}

void SsdWorker::awaitPictures()
{
  answers_.take(true);
  std::lock_guard<std::mutex> lock(mutex_);
  came_at_ns_ = pi_node::vehicleNs();
}

void SsdWorker::dropPicture()
{
  answers_.take(false);
  std::lock_guard<std::mutex> lock(mutex_);
  picture_.reset();
}

bool SsdWorker::detect(const zero_copy::ImageHandle& picture, DetectObjects::Response* response)
{
  Call call{picture, response};
  std::unique_lock<std::mutex> lock(mutex_);
  if (ended_)
  {
    return false;
  }
  if (!detector_)
  {
    response->message = figures_.problem.empty() ? "the model is being loaded: " + figures_.loading : figures_.problem;
    return true;
  }
  calls_.push_back(&call);
  work_changed_.notify_one();
  call_done_.wait(lock, [this, &call] { return call.done || ended_; });
  return call.done;
}

void SsdWorker::beginLoading(const std::string& model)
{
  std::lock_guard<std::mutex> lock(mutex_);
  figures_.loading = model;
}

void SsdWorker::use(std::shared_ptr<Detector> detector, const std::string& notice)
{
  std::lock_guard<std::mutex> lock(mutex_);
  detector_.swap(detector);  // the old one is destroyed with the parameter, after the lock is released
  figures_.loading.clear();
  figures_.problem.clear();
  figures_.notice = notice;
}

std::shared_ptr<const Detector> SsdWorker::failLoading(const std::string& problem)
{
  std::lock_guard<std::mutex> lock(mutex_);
  figures_.loading.clear();
  figures_.problem = problem;
  return detector_;
}

void SsdWorker::report(SsdFigures* figures)
{
  std::lock_guard<std::mutex> lock(mutex_);
  *figures = figures_;
  figures->silent_s = pi_node::secondsBetween(came_at_ns_, pi_node::vehicleNs());
  if (detector_)
  {
    figures->model = detector_->model().name;
    figures->runtime = detector_->target().used == Target::CPU ? detector_->stage().text() : "tasks";
    figures->target = detector_->target();
  }
}

// ---------------------------------------------------------------------------------------------------------- ssd_worker

void SsdWorker::work()
{
  pthread_setname_np(pthread_self(), "ssd_worker");
  std::unique_lock<std::mutex> lock(mutex_);
  while (true)
  {
    work_changed_.wait(lock, [this] { return stopping_ || !calls_.empty() || (picture_ && detector_); });
    if (stopping_)
    {
      ended_ = true;
      call_done_.notify_all();
      return;
    }
    std::shared_ptr<Detector> detector = detector_;
    if (!calls_.empty())
    {
      Call* const call = calls_.front();
      calls_.pop_front();
      lock.unlock();
      serve(*call, detector.get());
      detector.reset();
      lock.lock();
      ++figures_.calls;
      call->done = true;
      call_done_.notify_all();
      continue;
    }
    const zero_copy::ImageHandle message = std::move(picture_);
    picture_.reset();
    lock.unlock();
    try
    {
      workOn(message, detector);
    }
    catch (const std::invalid_argument& error)
    {
      warnings_->error(topic_ + ": " + error.what() + "; picture ignored");
    }
    catch (const std::exception& error)
    {
      warnings_->error(std::string("detection failed: ") + error.what());
    }
    detector.reset();  // may be the last to hold an old one, whose end takes time
    answers_.workedOff(fromMsg(message->header.stamp));
    lock.lock();
  }
}

void SsdWorker::workOn(const zero_copy::ImageHandle& message, const std::shared_ptr<Detector>& detector)
{
  const auto begin = std::chrono::steady_clock::now();
  const auto picture = std::make_shared<const MessagePicture>(message, &used_bits_);
  DetectionResult result = detector->detect(picture->view());
  if (worked_with_.lock() != detector)
  {
    tracker_.restart(options_.tracker.forNetwork(detector->model().tracker));  // ids of classes mean something else
    worked_with_ = detector;
  }
  std::vector<ObjectTrack> tracks;
  const ros::Time stamp = message->header.stamp;
  if (stamp.isZero())
  {
    warnings_->warn(topic_ + ": stamp is 0, so nothing can be followed; the driver must stamp its messages");
  }
  else if (following_)
  {
    tracks = follow(*picture, result.detections);
  }
  result.detections = wanted(result.detections, detector->model());
  publish_({picture, result.detections, tracks, detector});
  diagnostics_->addPicture(result, stamp.isZero() ? 0.0 : (ros::Time::now() - stamp).toSec(), secondsSince(begin));
}

std::vector<ObjectTrack> SsdWorker::follow(const MessagePicture& picture, const Detections& detections)
{
  const ros::Time stamp = picture.message().header.stamp;
  const std::string frame = picture.message().header.frame_id;
  TrackerView view;
  view.picture = &picture.view();
  view.motion = turn_.between(last_followed_, stamp, frame);
  if (options_.picture_motion)
  {
    const PictureMotion seen = picture_motion_.update(picture.view(), boxes_, !view.motion);
    view.motion = view.motion ? view.motion : seen;
  }
  boxes_.clear();
  for (const Detection& detection : detections)
  {
    boxes_.push_back(detection.box);
  }
  last_followed_ = stamp;
  return tracker_.update(fromMsg(stamp), detections, view);
}

void SsdWorker::serve(const Call& call, Detector* detector)
{
  DetectObjects::Response& response = *call.response;
  try
  {
    const MessagePicture picture(call.picture);
    const DetectionResult result = detector->detect(picture.view());
    response.detections =
        *toMsg(wanted(result.detections, detector->model()), zero_copy::standardHeader(call.picture->header));
    response.success = true;
    response.message = describe(*detector);
  }
  catch (const std::exception& error)
  {
    response.message = error.what();
  }
}

Detections SsdWorker::wanted(const Detections& all, const ModelDescription& model) const
{
  const std::map<int, float> thresholds = options_.detector.filter.thresholds(model);
  Detections detections;
  std::copy_if(all.begin(), all.end(), std::back_inserter(detections),
               [&thresholds](const Detection& detection)
               {
                 const auto threshold = thresholds.find(detection.class_id);
                 return threshold != thresholds.end() && detection.score >= threshold->second;
               });
  return detections;
}

}  // namespace pi_detect
