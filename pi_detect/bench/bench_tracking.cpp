// How well the tracker keeps identities on a video with known tracks, beside SORT (Bewley et al. 2016) on the same
// detections. bench_tracking --help shows the arguments.

#include <pi_detect/detector.h>
#include <pi_detect/object_tracker.h>
#include <pi_node/command_line.h>
#include <pi_node/formatting.h>
#include "tracking/film.h"
#include "tracking/mot_metrics.h"
#include "tracking/sort.h"

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
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

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
  Window window;
  std::string motion = "flow";
  bool no_looks = false;
  bool predicted = false;
  int threads = 0;
  std::string json;
};

bool parse(int argc, char** argv, Arguments* arguments)
{
  namespace po = boost::program_options;
  pi_node::CommandLine options("bench_tracking VIDEO TRUTH.csv MODEL.yaml [options]");
  options.add("detections", po::value(&arguments->detections),
              "file of detections: written if it does not exist, else read in place of running the network");
  options.add("overlay", po::value(&arguments->overlay), "folder for pictures with true boxes (white) and tracks");
  options.addValue("every", &arguments->every, "use each N-th picture only, as a slower camera would give them");
  options.addValue("class", &arguments->label, "that is followed");
  options.addValue("suppress", &arguments->suppress,
                   "overlap of boxes above which the better one suppresses the other");
  options.add("frame-rate", po::value(&arguments->frame_rate)->default_value(0.0, "the video's"), "[Hz]");
  options.addValue("window", &arguments->window.width, "width of the part of the picture that is used [px]; 0: all");
  options.addValue("start", &arguments->window.start, "left edge of the window in the first picture [px]");
  options.addValue(
      "pan", &arguments->window.speed,
      "speed of the window, which turns back at the picture's edges; below 0: to the left at first [px/s]");
  options.addValue("motion", &arguments->motion,
                   "what the tracker knows of the pan: flow (of the pictures), known (as from tf) or none");
  options.addFlag("no-looks", &arguments->no_looks, "objects are told apart by their places alone");
  options.addValue("threads", &arguments->threads, "of OpenCV; 0: as many as cores");
  options.add("json", po::value(&arguments->json), "file for the figures of ObjectTracker");
  options.addFlag("predicted", &arguments->predicted, "count tracks also where they are not seen but predicted");
  options.addPositional("video", &arguments->video, "no video is named; see --help");
  options.addPositional("truth", &arguments->truth, "no file of true tracks is named; see --help");
  options.addPositional("model", &arguments->model, "no description of a network is named; see --help");
  if (!options.parse(argc, argv))
  {
    return false;
  }
  if (arguments->every < 1)
  {
    throw po::error("--every " + std::to_string(arguments->every) + ", must be at least 1");
  }
  if (arguments->motion != "flow" && arguments->motion != "known" && arguments->motion != "none")
  {
    throw po::error("--motion " + arguments->motion + ", must be flow, known or none");
  }
  return true;
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

PictureView viewOf(const cv::Mat& picture)
{
  return {picture.data, picture.cols, picture.rows, picture.step, PictureView::Format::BGR8};
}

std::map<int, Detections> detect(const Arguments& arguments, const ModelDescription& model, const Film& film)
{
  DetectorOptions options;
  options.threads = arguments.threads;
  options.filter.score_threshold = LEAST_SCORE;
  options.filter.classes = {arguments.label};
  options.filter.class_agnostic_overlap = static_cast<float>(arguments.suppress);
  Detector detector(model, options, nullptr);
  std::map<int, Detections> detections;
  for (size_t i = 0; i < film.pictures.size(); ++i)
  {
    detections[film.truth.first_frame + static_cast<int>(i)] = detector.detect(viewOf(film.pictures[i])).detections;
  }
  return detections;
}

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

/// @param picture  number within the film.
using Update = std::function<std::vector<ObjectTrack>(size_t picture, int64_t stamp_ns, const Detections&)>;

struct Run
{
  const Arguments& arguments;
  const Film& film;
  const std::map<int, Detections>& detections;

  MotMetrics measure(const std::string& name, const Update& update, bool overlay) const
  {
    MotEvaluation evaluation;
    double seconds = 0.0;
    for (size_t i = 0; i < film.pictures.size(); i += static_cast<size_t>(arguments.every))
    {
      const int frame = film.truth.first_frame + static_cast<int>(i);
      const int64_t stamp_ns = static_cast<int64_t>(1e9 * (1.0 + frame / film.frame_rate));
      const auto found = detections.find(frame);
      const Detections rows = found == detections.end() ? Detections() : found->second;
      const auto start = std::chrono::steady_clock::now();
      const std::vector<ObjectTrack> tracks = update(i, stamp_ns, rows);
      seconds += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
      std::vector<IdentifiedBox> boxes;
      for (const ObjectTrack& track : tracks)
      {
        if (arguments.predicted || track.last_seen_ns == stamp_ns)
        {
          boxes.push_back({track.id, track.box});
        }
      }
      evaluation.add(film.truth.pictures[i].boxes, boxes, film.truth.pictures[i].ignored);
      if (overlay && !arguments.overlay.empty())
      {
        draw(arguments.overlay + "/" + std::to_string(frame) + ".png", film.pictures[i], film.truth.pictures[i], tracks,
             stamp_ns);
      }
    }
    const MotMetrics metrics = evaluation.metrics();
    std::printf("%-18s %6.3f %6.3f %6.3f %6.3f %6.3f %8d %7.1f %9d %6d %6d %9.1f\n", name.c_str(), metrics.precision,
                metrics.recall, metrics.mota, metrics.motp, metrics.idf1, metrics.switches, perMinute(metrics),
                metrics.fragments, metrics.misses, metrics.false_positives, 1e6 * seconds / metrics.pictures);
    return metrics;
  }

  double perMinute(const MotMetrics& metrics) const
  {
    return 60.0 * metrics.switches * film.frame_rate / static_cast<double>(film.pictures.size());
  }
};

/// The tracker as the ssd node runs it.
class Product
{
public:
  Product(const Film& film, const TrackerScores& scores, const std::string& motion, bool looks)
    : film_(film), motion_(motion), looks_(looks), tracker_(optionsOf(scores))
  {
  }

  std::vector<ObjectTrack> update(size_t picture, int64_t stamp_ns, const Detections& detections)
  {
    const PictureView pixels = viewOf(film_.pictures[picture]);
    TrackerView view;
    view.picture = looks_ ? &pixels : nullptr;
    if (motion_ == "flow")
    {
      view.motion = estimator_.update(pixels, boxes_);
      boxes_.clear();
      for (const Detection& detection : detections)
      {
        boxes_.push_back(detection.box);
      }
    }
    else if (motion_ == "known")
    {
      view.motion = film_.motion(last_, picture);
    }
    last_ = picture;
    return tracker_.update(stamp_ns, detections, view);
  }

private:
  static ObjectTrackerOptions optionsOf(const TrackerScores& scores)
  {
    ObjectTrackerOptions options;
    options.scores = scores;
    return options;
  }

  const Film& film_;
  const std::string motion_;
  const bool looks_;
  ObjectTracker tracker_;
  PictureMotionEstimator estimator_;
  std::vector<Box> boxes_;
  size_t last_ = 0;
};

void writeFigures(const std::string& path, const MotMetrics& metrics, double switches_per_minute)
{
  std::ofstream file(path);
  file << "{\"precision\": " << metrics.precision << ", \"recall\": " << metrics.recall
       << ", \"mota\": " << metrics.mota << ", \"idf1\": " << metrics.idf1
       << ", \"switches_per_minute\": " << switches_per_minute << "}\n";
  if (!file.flush())
  {
    throw std::runtime_error(path + ": cannot be written");
  }
}

int run(const Arguments& arguments)
{
  const Film film = Film::load(arguments.video, arguments.truth, arguments.frame_rate, arguments.window);
  const ModelDescription model = ModelDescription::load(arguments.model);
  const bool known = !arguments.detections.empty() && std::filesystem::exists(arguments.detections);
  const std::map<int, Detections> detections =
      known ? readDetections(arguments.detections) : detect(arguments, model, film);
  if (!known && !arguments.detections.empty())
  {
    writeDetections(arguments.detections, detections);
  }
  if (!arguments.overlay.empty())
  {
    std::filesystem::create_directories(arguments.overlay);
  }
  std::printf("%s: frames %d to %zu, every %d at %.1f Hz, class %s; network %s, scores %.2f and %.2f\n",
              arguments.video.c_str(), film.truth.first_frame,
              static_cast<size_t>(film.truth.first_frame) + film.pictures.size() - 1, arguments.every, film.frame_rate,
              arguments.label.c_str(), model.name.c_str(), model.tracker.high, model.tracker.low);
  std::printf("%-18s %6s %6s %6s %6s %6s %8s %7s %9s %6s %6s %9s\n", "tracks", "prec.", "recall", "MOTA", "MOTP",
              "IDF1", "switches", "per min", "fragments", "misses", "false", "us/update");
  const Run bench{arguments, film, detections};
  Product product(film, model.tracker, arguments.motion, !arguments.no_looks);
  const MotMetrics metrics = bench.measure(
      "ObjectTracker",
      [&product](size_t picture, int64_t stamp_ns, const Detections& rows)
      { return product.update(picture, stamp_ns, rows); },
      true);
  if (!arguments.json.empty())
  {
    writeFigures(arguments.json, metrics, bench.perMinute(metrics));
  }
  for (const double score : {model.tracker.low, model.tracker.high})
  {
    for (const int misses : {1, 3})
    {
      Sort sort(score, misses);
      bench.measure(
          pi_node::format("SORT, %.2f", score) + pi_node::format(", %.0f missed", misses),
          [&sort](size_t, int64_t stamp_ns, const Detections& rows) { return sort.update(stamp_ns, rows); }, false);
    }
  }
  return EXIT_SUCCESS;
}

}  // namespace

int main(int argc, char** argv)
{
  Arguments arguments;
  return pi_node::runTool(
      "bench_tracking", [&] { return parse(argc, argv, &arguments); }, [&] { return run(arguments); });
}
