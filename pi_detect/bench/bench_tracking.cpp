/// How well the tracker keeps identities on a video with known tracks, beside SORT (Bewley et al. 2016) on the same
/// detections.
///
///   bench_tracking VIDEO TRUTH.csv MODEL [--detections FILE] [--overlay FOLDER] [--every N] [--class LABEL]
///                  [--suppress OVERLAP] [--frame-rate HZ] [--predicted]
///
/// MODEL: description of a network, YAML.
/// --detections  kept there: written if the file does not exist, else read in place of running the network.
/// --overlay     pictures with true boxes (white) and tracks are written there.
/// --every       uses each N-th picture only, as a slower camera would give them.
/// --predicted   counts tracks also where they are not seen but predicted.
#include <pi_detect/detector.h>
#include <pi_detect/object_tracker.h>
#include "tracking/assignment.h"
#include "tracking/mot_metrics.h"

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iomanip>
#include <map>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "tracking/box_filter.h"

namespace
{

using namespace pi_detect;

constexpr float LEAST_SCORE = 0.1F;

struct Arguments
{
  std::string video;
  std::string truth;
  std::string model;
  std::string detections;
  std::string overlay;
  int every = 1;
  std::string label = "person";
  double suppress = 0.45;
  double frame_rate = 0.0;  ///< 0: that of the video
  bool predicted = false;
};

Arguments parse(int argc, char** argv)
{
  Arguments arguments;
  std::vector<std::string> names;
  for (int i = 1; i < argc; ++i)
  {
    const std::string name = argv[i];
    if (name.rfind("--", 0) != 0)
    {
      names.push_back(name);
      continue;
    }
    if (name == "--predicted")
    {
      arguments.predicted = true;
      continue;
    }
    if (i + 1 >= argc)
    {
      throw std::invalid_argument(name + " needs a value");
    }
    const std::string value = argv[++i];
    const std::map<std::string, std::function<void()>> setters = {
        {"--detections", [&] { arguments.detections = value; }},
        {"--overlay", [&] { arguments.overlay = value; }},
        {"--every", [&] { arguments.every = std::stoi(value); }},
        {"--class", [&] { arguments.label = value; }},
        {"--suppress", [&] { arguments.suppress = std::stod(value); }},
        {"--frame-rate", [&] { arguments.frame_rate = std::stod(value); }}};
    const auto setter = setters.find(name);
    if (setter == setters.end())
    {
      throw std::invalid_argument("unknown option " + name);
    }
    setter->second();
  }
  if (names.size() != 3 || arguments.every < 1)
  {
    throw std::invalid_argument("usage: bench_tracking VIDEO TRUTH.csv MODEL [options], see the head of its source");
  }
  arguments.video = names[0];
  arguments.truth = names[1];
  arguments.model = names[2];
  return arguments;
}

/// Rows "frame,class,score,x1,y1,x2,y2".
std::map<int, Detections> readDetections(const std::string& path)
{
  std::ifstream file(path);
  std::map<int, Detections> detections;
  std::string line;
  while (std::getline(file, line))
  {
    std::replace(line.begin(), line.end(), ',', ' ');
    std::istringstream text(line);
    int frame = 0;
    Detection row;
    if (!(text >> frame >> row.class_id >> row.score >> row.box.x1 >> row.box.y1 >> row.box.x2 >> row.box.y2))
    {
      throw std::runtime_error(path + ": '" + line + "', must be frame,class,score,x1,y1,x2,y2");
    }
    detections[frame].push_back(row);
  }
  return detections;
}

void writeDetections(const std::string& path, const std::map<int, Detections>& detections)
{
  std::ofstream file(path);
  file << std::fixed << std::setprecision(3);
  for (const auto& [frame, rows] : detections)
  {
    for (const Detection& row : rows)
    {
      file << frame << ',' << row.class_id << ',' << row.score << ',' << row.box.x1 << ',' << row.box.y1 << ','
           << row.box.x2 << ',' << row.box.y2 << '\n';
    }
  }
  if (!file.flush())
  {
    throw std::runtime_error(path + ": cannot be written");
  }
}

std::vector<cv::Mat> readPictures(const Arguments& arguments, const TruthTracks& truth)
{
  cv::VideoCapture video(arguments.video);
  std::vector<cv::Mat> pictures;
  cv::Mat picture;
  const int end = truth.first_frame + static_cast<int>(truth.pictures.size());
  for (int frame = 0; frame < end && video.read(picture); ++frame)
  {
    if (frame >= truth.first_frame)
    {
      pictures.push_back(picture.clone());
    }
  }
  if (pictures.size() != truth.pictures.size())
  {
    throw std::runtime_error(arguments.video + ": cannot be read up to frame " + std::to_string(end - 1));
  }
  return pictures;
}

std::map<int, Detections> detect(const Arguments& arguments, const std::vector<cv::Mat>& pictures, int first_frame)
{
  DetectorOptions options;
  options.filter.score_threshold = LEAST_SCORE;
  options.filter.classes = {arguments.label};
  options.filter.class_agnostic_overlap = static_cast<float>(arguments.suppress);
  Detector detector(ModelDescription::load(arguments.model), options, nullptr);
  std::map<int, Detections> detections;
  for (size_t i = 0; i < pictures.size(); ++i)
  {
    const cv::Mat& picture = pictures[i];
    detections[first_frame + static_cast<int>(i)] =
        detector.detect({picture.data, picture.cols, picture.rows, picture.step, PictureView::Format::BGR8}).detections;
  }
  return detections;
}

/// SORT: one round of detections from a score on, predicted boxes must overlap by 0.3, tracks end after more than some
/// pictures without detection. Boxes are filtered as by ObjectTracker.
class Sort
{
public:
  Sort(double score, int max_misses) : score_(score), max_misses_(max_misses) {}

  std::vector<ObjectTrack> update(int64_t stamp_ns, const Detections& all)
  {
    constexpr double FORBIDDEN = 2.0;
    const double dt_s = 1e-9 * static_cast<double>(stamp_ns - last_stamp_ns_);
    last_stamp_ns_ = stamp_ns;
    Detections detections;
    std::copy_if(all.begin(), all.end(), std::back_inserter(detections),
                 [this](const Detection& detection) { return detection.score >= score_; });
    Eigen::MatrixXd cost(static_cast<Eigen::Index>(tracks_.size()), static_cast<Eigen::Index>(detections.size()));
    for (size_t i = 0; i < tracks_.size(); ++i)
    {
      tracks_[i].filter.predict(dt_s);
      ++tracks_[i].misses;
      for (size_t j = 0; j < detections.size(); ++j)
      {
        const double common = overlap(tracks_[i].filter.box(), detections[j].box);
        cost(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) = common >= 0.3 ? 1.0 - common : FORBIDDEN;
      }
    }
    const std::vector<int> assigned = assign(cost, FORBIDDEN);
    std::vector<bool> taken(detections.size(), false);
    for (size_t i = 0; i < assigned.size(); ++i)
    {
      if (assigned[i] >= 0)
      {
        taken[static_cast<size_t>(assigned[i])] = true;
        tracks_[i].filter.correct(detections[static_cast<size_t>(assigned[i])].box);
        tracks_[i].misses = 0;
        ++tracks_[i].track.hits;
        tracks_[i].track.last_seen_ns = stamp_ns;
      }
    }
    for (size_t j = 0; j < detections.size(); ++j)
    {
      if (!taken[j])
      {
        tracks_.push_back({BoxFilter(detections[j].box, BoxFilterNoise()), {}, 0});
        tracks_.back().track.id = ++last_id_;
        tracks_.back().track.hits = 1;
        tracks_.back().track.last_seen_ns = stamp_ns;
      }
    }
    tracks_.erase(std::remove_if(tracks_.begin(), tracks_.end(),
                                 [this](const Followed& followed) { return followed.misses > max_misses_; }),
                  tracks_.end());
    std::vector<ObjectTrack> result;
    for (Followed& followed : tracks_)
    {
      followed.track.box = followed.filter.box();
      if (followed.track.hits >= 3)
      {
        result.push_back(followed.track);
      }
    }
    return result;
  }

private:
  struct Followed
  {
    BoxFilter filter;
    ObjectTrack track;
    int misses;
  };

  const double score_;
  const int max_misses_;
  std::vector<Followed> tracks_;
  int64_t last_stamp_ns_ = 0;
  int64_t last_id_ = 0;
};

void draw(const std::string& path, const cv::Mat& picture, const TruthTracks::Picture& truth,
          const std::vector<ObjectTrack>& tracks, int64_t stamp_ns)
{
  const auto rectangle = [](const Box& box) { return cv::Rect2f(box.x1, box.y1, box.width(), box.height()); };
  cv::Mat drawn = picture.clone();
  for (const IdentifiedBox& object : truth.boxes)
  {
    cv::rectangle(drawn, rectangle(object.box), cv::Scalar::all(255.0), 1);
  }
  for (const ObjectTrack& track : tracks)
  {
    const cv::Scalar colour(static_cast<double>(track.id * 67 % 200 + 55),
                            static_cast<double>(track.id * 131 % 200 + 55),
                            static_cast<double>(track.id * 29 % 200 + 55));
    cv::rectangle(drawn, rectangle(track.box), colour, track.last_seen_ns == stamp_ns ? 2 : 1);
    cv::putText(drawn, std::to_string(track.id), cv::Point2f(track.box.x1, track.box.y1 - 3.0F),
                cv::FONT_HERSHEY_SIMPLEX, 0.5, colour, 2);
  }
  if (!cv::imwrite(path, drawn))
  {
    throw std::runtime_error(path + ": cannot be written");
  }
}

using Update = std::function<std::vector<ObjectTrack>(int64_t, const Detections&)>;

struct Run
{
  const Arguments& arguments;
  const TruthTracks& truth;
  const std::vector<cv::Mat>& pictures;  ///< empty: nothing is drawn
  const std::map<int, Detections>& detections;
  double frame_rate;

  void print(const char* name, const Update& update, bool overlay) const
  {
    MotEvaluation evaluation;
    double seconds = 0.0;
    for (size_t i = 0; i < truth.pictures.size(); i += static_cast<size_t>(arguments.every))
    {
      const int frame = truth.first_frame + static_cast<int>(i);
      const int64_t stamp_ns = static_cast<int64_t>(1e9 * (1.0 + frame / frame_rate));
      const auto found = detections.find(frame);
      const Detections rows = found == detections.end() ? Detections() : found->second;
      const auto start = std::chrono::steady_clock::now();
      const std::vector<ObjectTrack> tracks = update(stamp_ns, rows);
      seconds += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
      std::vector<IdentifiedBox> boxes;
      for (const ObjectTrack& track : tracks)
      {
        if (arguments.predicted || track.last_seen_ns == stamp_ns)
        {
          boxes.push_back({track.id, track.box});
        }
      }
      evaluation.add(truth.pictures[i].boxes, boxes, truth.pictures[i].ignored);
      if (overlay && !arguments.overlay.empty())
      {
        draw(arguments.overlay + "/" + std::to_string(frame) + ".png", pictures[i], truth.pictures[i], tracks,
             stamp_ns);
      }
    }
    const MotMetrics metrics = evaluation.metrics();
    const double minutes = static_cast<double>(truth.pictures.size()) / frame_rate / 60.0;
    std::printf("%-22s %6.3f %6.3f %6.3f %8d %8.1f %9d %7d %7d %9.1f\n", name, metrics.mota, metrics.motp, metrics.idf1,
                metrics.switches, metrics.switches / minutes, metrics.fragments, metrics.misses,
                metrics.false_positives, 1e6 * seconds / metrics.pictures);
  }
};

void run(const Arguments& arguments)
{
  const TruthTracks truth = TruthTracks::load(arguments.truth);
  const double frame_rate =
      arguments.frame_rate > 0.0 ? arguments.frame_rate : cv::VideoCapture(arguments.video).get(cv::CAP_PROP_FPS);
  if (!(frame_rate > 0.0))
  {
    throw std::runtime_error(arguments.video + ": has no frame rate, give --frame-rate");
  }
  const bool known = !arguments.detections.empty() && std::filesystem::exists(arguments.detections);
  std::vector<cv::Mat> pictures;
  if (!known || !arguments.overlay.empty())
  {
    pictures = readPictures(arguments, truth);
  }
  const std::map<int, Detections> detections =
      known ? readDetections(arguments.detections) : detect(arguments, pictures, truth.first_frame);
  if (!known && !arguments.detections.empty())
  {
    writeDetections(arguments.detections, detections);
  }
  if (!arguments.overlay.empty())
  {
    std::filesystem::create_directories(arguments.overlay);
  }
  std::printf("%s: frames %d to %zu, every %d at %.1f Hz, class %s\n", arguments.video.c_str(), truth.first_frame,
              static_cast<size_t>(truth.first_frame) + truth.pictures.size() - 1, arguments.every, frame_rate,
              arguments.label.c_str());
  std::printf("%-22s %6s %6s %6s %8s %8s %9s %7s %7s %9s\n", "", "MOTA", "MOTP", "IDF1", "switches", "per min",
              "fragments", "misses", "false", "us/update");
  const Run bench{arguments, truth, pictures, detections, frame_rate};
  const ObjectTrackerOptions options;
  ObjectTracker tracker(options);
  bench.print(
      "ObjectTracker", [&](int64_t stamp, const Detections& rows) { return tracker.update(stamp, rows); }, true);
  for (const double score : {0.5, options.high_score})
  {
    for (const int misses : {1, 3})
    {
      char name[40];
      std::snprintf(name, sizeof(name), "SORT, %.1f, %d missed", score, misses);
      Sort sort(score, misses);
      bench.print(
          name, [&](int64_t stamp, const Detections& rows) { return sort.update(stamp, rows); }, false);
    }
  }
}

}  // namespace

int main(int argc, char** argv)
{
  try
  {
    run(parse(argc, argv));
  }
  catch (const std::exception& error)
  {
    std::fprintf(stderr, "bench_tracking: %s\n", error.what());
    return 1;
  }
  return 0;
}
