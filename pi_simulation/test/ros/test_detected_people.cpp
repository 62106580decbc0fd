// A network that was trained on photographs finds the simulated people in the pictures that the live cameras give, and
// nothing else that it takes for people.

#include "drives/vehicle_path.h"
#include "drives/visible_obstacles.h"
#include "ros/vehicle_simulator_ros_options.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <opencv2/dnn.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

using namespace pi_simulation;

namespace
{

constexpr float LEAST_SCORE = 0.4f;
constexpr double NEAR_M = 12.0;
constexpr double MOSTLY_VISIBLE = 0.5;
/// Bounds for few pictures. Of 728 pictures 0.79 were reached, and 0.7 per 100 (docs/benchmarks/vehicle.md).
constexpr double LEAST_RECALL = 0.72;
constexpr double MOST_ELSEWHERE = 0.02;

/// YOLOX-nano, trained on COCO: boxes of people.
class PersonDetector
{
public:
  explicit PersonDetector(const std::string& file) : network_(cv::dnn::readNet(file)) {}

  std::vector<cv::Rect2f> find(const cv::Mat& bgr)
  {
    const float scale = SIDE / static_cast<float>(std::max(bgr.cols, bgr.rows));
    cv::Mat small;
    cv::resize(bgr, small, {}, scale, scale);
    cv::Mat padded(SIDE, SIDE, CV_8UC3, cv::Scalar::all(114));
    small.copyTo(padded(cv::Rect({0, 0}, small.size())));
    network_.setInput(cv::dnn::blobFromImage(padded));
    const cv::Mat output = network_.forward();
    const cv::Mat rows(output.size[1], output.size[2], CV_32F, output.data);
    std::vector<cv::Rect2d> boxes;
    std::vector<float> scores;
    int row = 0;
    for (const int stride : {8, 16, 32})
    {
      const int cells = SIDE / stride;
      for (int i = 0; i < cells * cells; ++i, ++row)
      {
        const float* values = rows.ptr<float>(row);
        const float score = values[4] * values[5];  // an object, and a person
        if (score < LEAST_SCORE)
        {
          continue;
        }
        const float factor = static_cast<float>(stride) / scale;
        const cv::Size2f size(std::exp(values[2]) * factor, std::exp(values[3]) * factor);
        const cv::Point2f center((values[0] + static_cast<float>(i % cells)) * factor,
                                 (values[1] + static_cast<float>(i / cells)) * factor);
        boxes.emplace_back(center.x - 0.5f * size.width, center.y - 0.5f * size.height, size.width, size.height);
        scores.push_back(score);
      }
    }
    std::vector<int> kept;
    cv::dnn::NMSBoxes(boxes, scores, LEAST_SCORE, 0.5f, kept);
    std::vector<cv::Rect2f> people;
    for (const int index : kept)
    {
      people.emplace_back(boxes[static_cast<size_t>(index)]);
    }
    return people;
  }

private:
  static constexpr int SIDE = 416;
  cv::dnn::Net network_;
};

float overlap(const cv::Rect2f& a, const cv::Rect2f& b)
{
  const float both = (a & b).area();
  return both / (a.area() + b.area() - both);
}

bool isPerson(const VisibleObstacle& obstacle)
{
  return obstacle.class_name == "person" || obstacle.class_name == "cyclist";
}

struct Figures
{
  int pictures = 0;
  int people = 0;  ///< near, mostly visible and not cut by the picture's left or right border
  int found = 0;
  int elsewhere = 0;  ///< found where nobody is
};

void judge(const std::vector<VisibleObstacle>& obstacles, const std::vector<cv::Rect2f>& people, int width,
           Figures* figures)
{
  ++figures->pictures;
  for (const VisibleObstacle& obstacle : obstacles)
  {
    const bool whole = obstacle.box.x > 0 && obstacle.box.br().x < width;
    if (!isPerson(obstacle) || !whole || obstacle.nearest_depth_m > NEAR_M || obstacle.visible <= MOSTLY_VISIBLE)
    {
      continue;
    }
    ++figures->people;
    figures->found += std::any_of(people.begin(), people.end(),
                                  [&](const cv::Rect2f& box) { return overlap(box, obstacle.box) > 0.3f; });
  }
  for (const cv::Rect2f& box : people)
  {
    figures->elsewhere += std::none_of(obstacles.begin(), obstacles.end(),
                                       [&](const VisibleObstacle& obstacle)
                                       { return isPerson(obstacle) && (box & cv::Rect2f(obstacle.box)).area() > 0; });
  }
}

/// Where tests leave pictures to look at: PI_EDGE_PICTURES, else nowhere.
void save(const cv::Mat& picture, const std::vector<cv::Rect2f>& people, const std::string& name)
{
  const char* folder = std::getenv("PI_EDGE_PICTURES");
  if (folder == nullptr)
  {
    return;
  }
  cv::Mat drawn = picture.clone();
  for (const cv::Rect2f& box : people)
  {
    cv::rectangle(drawn, box, {0, 255, 0});
  }
  cv::imwrite((std::filesystem::path(folder) / (name + ".png")).string(), drawn);
}

}  // namespace

TEST(LivePictures, ADetectorFindsThePeopleAndNobodyElse)
{
  const char* data = std::getenv("PI_EDGE_DATA");
  const std::string model = std::string(data == nullptr ? "." : data) + "/detect/models/yolox_nano_416.onnx";
  if (!std::filesystem::exists(model))
  {
    GTEST_SKIP() << "no " << model << "; set PI_EDGE_DATA";
  }
  PersonDetector detector(model);
  const VehicleSimulatorRosOptions options;
  StereoRendererOptions pictures = options.rendererOptions();
  pictures.truth = true;
  Figures figures;
  for (const uint64_t seed : {1, 2, 3})
  {
    VehiclePathOptions path;
    path.duration_s = 72.0;
    const std::vector<pi_slam::StampedPose> drive = makeVehiclePath(path);
    SyntheticWorldOptions world_options;
    world_options.seed = seed;
    world_options.road = pathLine(path.shape, 0.0);
    const auto world = SyntheticWorld::build(world_options, drive);
    StereoRenderer renderer(world, options.calibration(), pictures);
    for (size_t i = 0; i < drive.size(); i += 100)  // every 2 s
    {
      const StereoFrame frame = renderer.render(drive[i].T_world_body, drive[i].stamp_ns);
      const std::vector<cv::Rect2f> people = detector.find(frame.left);
      judge(visibleObstacles(*world, frame, drive[i].T_world_body), people, frame.left.cols, &figures);
      save(frame.left, people, "live_" + std::to_string(seed) + "_" + std::to_string(i));
    }
  }
  std::printf("%d pictures, %d people within 12 m, %d of them found, %d found where nobody is\n", figures.pictures,
              figures.people, figures.found, figures.elsewhere);
  ASSERT_GE(figures.people, 50);
  EXPECT_GE(figures.found, LEAST_RECALL * figures.people);
  EXPECT_LE(figures.elsewhere, MOST_ELSEWHERE * figures.pictures);
}
