#include <gtest/gtest.h>
#include <pi_detect/detector.h>
#include <pi_node/test_support/temporary_folder.h>
#include <pi_runtime/runtime.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <memory>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "contains.h"
#include "detector/coco_reference.h"
#include "detector/tiny_network.h"

namespace pi_detect
{

using namespace pi_node::test_support;
namespace
{

PictureView viewOf(const cv::Mat& picture, PictureView::Format format)
{
  return PictureView{picture.data, picture.cols, picture.rows, picture.step, format};
}

/// A dark picture of 64 x 48 with cell (column, row) of 4 x 4 white.
cv::Mat cellPicture(int column, int row, int type = CV_8UC1)
{
  cv::Mat picture(48, 64, type, cv::Scalar::all(0));
  picture(cv::Rect(16 * column, 12 * row, 16, 12)) = cv::Scalar::all(255);
  return picture;
}

class TinyDetector : public testing::TestWithParam<TinyOutput>
{
protected:
  static DetectorOptions with(const std::function<void(DetectionFilter*)>& change)
  {
    DetectorOptions options;
    change(&options.filter);
    return options;
  }

  Detections detect(const cv::Mat& picture, const DetectorOptions& options = DetectorOptions())
  {
    Detector detector(model_, options, nullptr);
    return detector
        .detect(viewOf(picture, picture.channels() == 1 ? PictureView::Format::MONO8 : PictureView::Format::BGR8))
        .detections;
  }

  TemporaryFolder folder_;
  ModelDescription model_ = ModelDescription::load(writeTinyNetwork(folder_.path(), GetParam()));
};

INSTANTIATE_TEST_SUITE_P(OfEachKind, TinyDetector,
                         testing::Values(TinyOutput::DETECTIONS, TinyOutput::GRID, TinyOutput::DISTRIBUTION),
                         [](const auto& parameter)
                         {
                           return parameter.param == TinyOutput::DETECTIONS ? "Detections"
                                  : parameter.param == TinyOutput::GRID     ? "Grid"
                                                                            : "Distribution";
                         });

TEST_P(TinyDetector, FindsWhatIsBrightInPixelsOfThePicture)
{
  const Detections detections = detect(cellPicture(1, 2));
  ASSERT_EQ(1u, detections.size());
  EXPECT_EQ(1, detections[0].class_id);
  EXPECT_NEAR(1.0 / (1.0 + std::exp(-8.0)), detections[0].score, 1e-4);
  EXPECT_NEAR(16.0, detections[0].box.x1, 0.01);
  EXPECT_NEAR(24.0, detections[0].box.y1, 0.01);
  EXPECT_NEAR(32.0, detections[0].box.x2, 0.01);
  EXPECT_NEAR(36.0, detections[0].box.y2, 0.01);
}

TEST_P(TinyDetector, FindsNothingInTheDark)
{
  EXPECT_TRUE(detect(cv::Mat::zeros(48, 64, CV_8UC1)).empty());
}

TEST_P(TinyDetector, FollowsThePictureSize)
{
  Detector detector(model_, DetectorOptions(), nullptr);
  for (const int scale : {1, 3, 2, 1})
  {
    cv::Mat picture;
    cv::resize(cellPicture(3, 0), picture, cv::Size(), scale, scale, cv::INTER_NEAREST);
    const Detections detections = detector.detect(viewOf(picture, PictureView::Format::MONO8)).detections;
    ASSERT_EQ(1u, detections.size()) << scale;
    EXPECT_NEAR(48.0 * scale, detections[0].box.x1, 0.01);
    EXPECT_NEAR(12.0 * scale, detections[0].box.y2, 0.01);
  }
}

TEST_P(TinyDetector, TakesPartsOfALargerPicture)
{
  cv::Mat large(100, 200, CV_8UC3, cv::Scalar::all(255));
  const cv::Mat part = large(cv::Rect(20, 10, 64, 48));
  cellPicture(2, 1, CV_8UC3).copyTo(part);
  const Detections detections = detect(part);
  ASSERT_EQ(1u, detections.size());
  EXPECT_NEAR(32.0, detections[0].box.x1, 0.01);
}

TEST_P(TinyDetector, PutsTheChannelsInTheNetworksOrder)
{
  // The network looks at its first plane: red for rgb.
  cv::Mat blue(48, 64, CV_8UC3, cv::Scalar(255, 0, 0));
  Detector rgb(model_, DetectorOptions(), nullptr);
  EXPECT_TRUE(rgb.detect(viewOf(blue, PictureView::Format::BGR8)).detections.empty());
  EXPECT_FALSE(rgb.detect(viewOf(blue, PictureView::Format::RGB8)).detections.empty());
  model_.input.rgb = false;
  Detector bgr(model_, with([](DetectionFilter*) {}), nullptr);
  EXPECT_FALSE(bgr.detect(viewOf(blue, PictureView::Format::BGR8)).detections.empty());
}

TEST_P(TinyDetector, MapsBoxesBackFromALetterbox)
{
  model_.input.fit = InputFit::LETTERBOX;
  model_.input.bar_level = 0;
  // 64 x 32 in the square input: half a cell row of bars above and below two rows of cells, 16 pixels each.
  cv::Mat picture(32, 64, CV_8UC1, cv::Scalar(0));
  picture(cv::Rect(32, 16, 16, 16)) = 255;
  const Detections detections = detect(picture);
  ASSERT_EQ(1u, detections.size());
  EXPECT_NEAR(32.0, detections[0].box.x1, 0.01);
  EXPECT_NEAR(16.0, detections[0].box.y1, 0.01);
  EXPECT_NEAR(48.0, detections[0].box.x2, 0.01);
  EXPECT_NEAR(32.0, detections[0].box.y2, 0.01);
}

TEST_P(TinyDetector, CutsBoxesAtThePicturesEdge)
{
  model_.input.fit = InputFit::LETTERBOX;
  model_.input.bar_level = 255;  // the bars are bright: their boxes lie outside the picture
  for (const Detection& detection :
       detect(cv::Mat::zeros(24, 64, CV_8UC1), with([](DetectionFilter* filter) { filter->score_threshold = 0.01F; })))
  {
    EXPECT_GE(detection.box.y1, 0.0F);
    EXPECT_LE(detection.box.y2, 24.0F);
    EXPECT_GT(detection.box.area(), 0.0F);
  }
}

TEST_P(TinyDetector, FiltersClassesAndScores)
{
  const cv::Mat picture = cellPicture(0, 0) * 0.6;  // b = 0.2: score 0.83
  EXPECT_EQ(1u, detect(picture, with([](DetectionFilter* filter) { filter->score_threshold = 0.8F; })).size());
  EXPECT_EQ(0u, detect(picture, with([](DetectionFilter* filter) { filter->score_threshold = 0.9F; })).size());
  const auto own = [](DetectionFilter* filter)
  {
    filter->score_threshold = 0.9F;
    filter->class_thresholds["bright"] = 0.8F;
  };
  EXPECT_EQ(1u, detect(picture, with(own)).size());
  EXPECT_EQ(0u, detect(picture, with([](DetectionFilter* filter) { filter->classes = {"dark"}; })).size());
  EXPECT_EQ(1u, detect(picture, with([](DetectionFilter* filter) { filter->classes = {"bright"}; })).size());
}

TEST_P(TinyDetector, KeepsTheBestDetections)
{
  cv::Mat picture = cellPicture(0, 0);
  picture(cv::Rect(32, 24, 16, 12)) = 200;
  EXPECT_EQ(2u, detect(picture).size());
  const Detections best = detect(picture, with([](DetectionFilter* filter) { filter->max_detections = 1; }));
  ASSERT_EQ(1u, best.size());
  EXPECT_NEAR(0.0, best[0].box.x1, 0.01);
}

TEST_P(TinyDetector, GivesTheSameThroughTheRuntime)
{
  const auto runtime = std::make_shared<pi_runtime::Runtime>(pi_runtime::RuntimeOptions::forService());
  Detector plain(model_, DetectorOptions(), nullptr);
  Detector stage(model_, DetectorOptions(), runtime);
  for (int i = 0; i < 16; ++i)  // the first ones are measured, as plain calls
  {
    const cv::Mat picture = cellPicture(i % 4, 3 - i % 4);
    const DetectionResult expected = plain.detect(viewOf(picture, PictureView::Format::MONO8));
    const DetectionResult result = stage.detect(viewOf(picture, PictureView::Format::MONO8));
    ASSERT_EQ(expected.detections.size(), result.detections.size());
    EXPECT_EQ(expected.detections[0].score, result.detections[0].score);
    EXPECT_EQ(expected.detections[0].box.x1, result.detections[0].box.x1);
    EXPECT_GT(result.forward_s, 0.0);
  }
  const std::vector<pi_runtime::StreamStatus> streams = runtime->streams();  // those of other processes come behind
  ASSERT_FALSE(streams.empty());
  EXPECT_EQ("detection", streams[0].name);
  EXPECT_GT(streams[0].jobs, 0u);
  EXPECT_NE("nothing reserved: its times are measured first", stage.stage().text());
  EXPECT_EQ("not used: plain calls", plain.stage().text());
}

TEST_P(TinyDetector, RefusesPicturesThatAreNone)
{
  Detector detector(model_, DetectorOptions(), nullptr);
  const cv::Mat picture = cellPicture(0, 0);
  PictureView view = viewOf(picture, PictureView::Format::MONO8);
  view.data = nullptr;
  EXPECT_THROW(detector.detect(view), std::invalid_argument);
  view = viewOf(picture, PictureView::Format::MONO8);
  view.width = 1;
  EXPECT_THROW(detector.detect(view), std::invalid_argument);
  view = viewOf(picture, PictureView::Format::BGR8);  // 64 bytes per row are no 64 pixels of 3
  EXPECT_THROW(detector.detect(view), std::invalid_argument);
  EXPECT_EQ(1u, detector.detect(viewOf(picture, PictureView::Format::MONO8)).detections.size());
}

TEST_P(TinyDetector, RefusesImpossibleOptions)
{
  const auto refused = [&](const std::function<void(DetectorOptions*)>& change, const std::string& text)
  {
    DetectorOptions options;
    change(&options);
    try
    {
      Detector detector(model_, options, nullptr);
      ADD_FAILURE() << text << " was taken";
    }
    catch (const std::invalid_argument& error)
    {
      EXPECT_NE(std::string::npos, std::string(error.what()).find(text)) << error.what();
    }
  };
  refused([](DetectorOptions* options) { options->threads = -1; }, "threads = -1");
  refused([](DetectorOptions* options) { options->filter.score_threshold = 1.5F; }, "score_threshold = 1.5");
  refused([](DetectorOptions* options) { options->filter.max_detections = 0; }, "max_detections = 0");
  refused([](DetectorOptions* options) { options->filter.classes = {"cow"}; }, "no class \"cow\"");
  refused([](DetectorOptions* options) { options->filter.class_thresholds["cow"] = 0.5F; }, "no class \"cow\"");
  refused([](DetectorOptions* options) { options->filter.class_agnostic_overlap = -0.5F; }, "class_agnostic_overlap");
}

TEST_P(TinyDetector, ADamagedFileIsAnErrorAtTheStart)
{
  std::filesystem::resize_file(model_.weights.path, 300);
  EXPECT_THROW(Detector(model_, DetectorOptions(), nullptr), ModelError);
}

/// The shared network and pictures.
class CocoDetector : public testing::Test
{
protected:
  void SetUp() override
  {
    const char* data = std::getenv("PI_EDGE_DATA");
    folder_ = std::string(data == nullptr ? "" : data) + "/detect";
    if (!std::filesystem::is_directory(folder_ + "/images_dev"))
    {
      GTEST_SKIP() << "no " << folder_ << "/images_dev; set PI_EDGE_DATA";
    }
  }

  std::vector<std::string> pictures(size_t count) const
  {
    std::vector<std::string> paths;
    for (const auto& entry : std::filesystem::directory_iterator(folder_ + "/images_dev"))
    {
      paths.push_back(entry.path().string());
    }
    std::sort(paths.begin(), paths.end());
    paths.resize(std::min(count, paths.size()));
    return paths;
  }

  std::string folder_;
};

/// A network of the shared data, and how OpenCV's or its authors' examples run it.
struct CocoNetwork
{
  const char* name;
  std::unique_ptr<Reference> (*reference)(const std::string& weights);
};

template <typename Kind>
std::unique_ptr<Reference> make(const std::string& weights)
{
  return std::make_unique<Kind>(weights);
}

class CocoDetectors : public CocoDetector, public testing::WithParamInterface<CocoNetwork>
{
};

INSTANTIATE_TEST_SUITE_P(OfEachKind, CocoDetectors,
                         testing::Values(CocoNetwork{"ssd_mobilenet", make<SsdReference>},
                                         CocoNetwork{"accurate", make<YoloxReference>},
                                         CocoNetwork{"fast", make<NanoDetReference>}),
                         [](const auto& parameter) { return std::string(parameter.param.name); });

TEST_P(CocoDetectors, FindWhatPlainOpenCvFinds)
{
  ModelDescription model = ModelDescription::load(std::string(MODELS) + "/" + GetParam().name + ".yaml");
  model.cells.top_k = 100000;  // the examples keep all
  model.cells.keep_top_k = 1000;
  DetectorOptions options;
  options.filter.score_threshold = 0.05F;
  options.filter.max_detections = 1000;
  Detector detector(model, options, nullptr);
  const auto reference = GetParam().reference(model.weights.path);
  size_t compared = 0;
  for (const std::string& path : pictures(40))
  {
    const cv::Mat picture = cv::imread(path);
    const Detections expected = reference->detect(picture, 0.05F);
    const Detections detections = detector.detect(viewOf(picture, PictureView::Format::BGR8)).detections;
    compared += compareDetections(expected, detections, path);
  }
  EXPECT_GT(compared, 400u);
}

TEST_F(CocoDetector, NamesTheKindThatTheOutputsLookLike)
{
  const auto errorAs = [](const char* name, OutputKind kind)
  {
    ModelDescription model = ModelDescription::load(std::string(MODELS) + "/" + name + ".yaml");
    model.output_kind = kind;
    model.cells = CellOutputs();
    model.cells.classes = 80;
    try
    {
      checkModelHere(model);
      return std::string();
    }
    catch (const ModelError& error)
    {
      return std::string(error.what());
    }
  };
  EXPECT_TRUE(contains(errorAs("accurate", OutputKind::DETECTIONS), "look like output/kind grid"));
  EXPECT_TRUE(contains(errorAs("accurate", OutputKind::DISTRIBUTION), "look like output/kind grid"));
  EXPECT_TRUE(contains(errorAs("fast", OutputKind::GRID), "look like output/kind distribution"));
  EXPECT_EQ("", errorAs("fast", OutputKind::DISTRIBUTION));
}

}  // namespace
}  // namespace pi_detect
