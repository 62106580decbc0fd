// config/ssd.yaml and the defaults in the code must be the same, and impossible values must be named.

#include <gtest/gtest.h>
#include <pi_node/test_support/options_reader.h>
#include "ros/ssd_ros_options.h"

#include <algorithm>
#include <string>

namespace pi_detect
{

using namespace pi_node::test_support;
namespace
{

ModelDescription makeModel()
{
  ModelDescription model;
  model.name = "made";
  model.labels = {{1, "person"}, {3, "traffic light"}};
  model.score_threshold = 0.45F;
  return model;
}

const OptionsReader<SsdRosOptions> ssd_reader("/ssd/");

TEST(SsdRosOptions, DefaultsAreThoseOfTheYamlFile)
{
  ssd_reader.expectDefaultsOf(SSD_YAML);
}

TEST(SsdRosOptions, ParametersComeBackAsTheyWere)
{
  SsdRosOptions options;
  options.model = "/models/a.yaml";
  options.detector.target = Target::OPENCL_FP16;
  options.detector.filter.score_threshold = 0.3F;
  options.detector.filter.class_thresholds = {{"person", 0.25F}, {"traffic light", 0.6F}};
  options.detector.filter.classes = {"person", "traffic light"};
  options.tracker.confirm_hits = 5;
  options.use_runtime = !options.use_runtime;
  Names unknown;
  const SsdRosOptions again = SsdRosOptions::fromParameters(options.toParameters(), "", &unknown);
  EXPECT_EQ(Names(), unknown);
  EXPECT_EQ(options.toText(), again.toText());
  EXPECT_NE(SsdRosOptions().toText(), again.toText());
  EXPECT_EQ(options.detector.filter.class_thresholds, again.detector.filter.class_thresholds);
}

TEST(SsdRosOptions, NamesUnknownParameters)
{
  Names unknown;
  ssd_reader.load("{tracker: {high: 0.5}, treshold: 0.3, class_thresholds: {person: 0.4}}", &unknown);
  EXPECT_EQ((Names{"/ssd/tracker/high", "/ssd/treshold"}), unknown);
}

TEST(SsdRosOptions, NamesParameterValueAndBound)
{
  EXPECT_EQ(0u, ssd_reader.refusal("model: models/a.yaml")
                    .find("parameter /ssd/model = \"models/a.yaml\", must be the name of a network or an absolute"));
  EXPECT_EQ("parameter /ssd/target = \"cuda\", must be cpu, opencl or opencl_fp16", ssd_reader.refusal("target: cuda"));
  EXPECT_EQ("parameter /ssd/max_rate_hz = -1, must be in [0, 1000]", ssd_reader.refusal("max_rate_hz: -1"));
  EXPECT_EQ("parameter /ssd/always_on = 1, must be true or false", ssd_reader.refusal("always_on: 1"));
  EXPECT_EQ("parameter /ssd/input_timeout_s = 0, must be in (0, 3600]", ssd_reader.refusal("input_timeout_s: 0"));
  EXPECT_EQ(0u, ssd_reader.refusal("class_thresholds: [0.5]").find("parameter /ssd/class_thresholds = "));
  EXPECT_EQ("parameter /ssd/class_thresholds/person = high, must be a number",
            ssd_reader.refusal("class_thresholds: {person: high}"));
  EXPECT_EQ("parameter /ssd/classes = person, must be a list of texts", ssd_reader.refusal("classes: person"));
  // Bounds of the core come under their names as well.
  EXPECT_EQ(0u, ssd_reader.refusal("score_threshold: 1.5").find("parameter /ssd/score_threshold = 1.5"))
      << ssd_reader.refusal("score_threshold: 1.5");
  EXPECT_EQ(0u, ssd_reader.refusal("tracker: {low_score: -1}").find("parameter /ssd/tracker/low_score = -1"))
      << ssd_reader.refusal("tracker: {low_score: -1}");
}

TEST(SsdRosOptions, ThresholdsAreTheUsersThenTheModels)
{
  const ModelDescription model = makeModel();
  EXPECT_FLOAT_EQ(0.45F, ssd_reader.load("{}").detector.filter.thresholds(model).at(1));
  const SsdRosOptions options = ssd_reader.load("{score_threshold: 0.6, class_thresholds: {traffic light: 0.7}}");
  const std::map<int, float> thresholds = options.detector.filter.thresholds(model);
  EXPECT_FLOAT_EQ(0.6F, thresholds.at(1));
  EXPECT_FLOAT_EQ(0.7F, thresholds.at(3));
  EXPECT_EQ(0u, thresholds.count(99));
}

TEST(SsdRosOptions, DetectorRunsWithTheTrackersThresholdIfThatIsLower)
{
  const SsdRosOptions options = ssd_reader.load(
      "{score_threshold: 0.6, class_thresholds: {person: 0.1, traffic light: 0.7}, tracker: {low_score: 0.2}}");
  const DetectionFilter filter = options.detectorOptions(makeModel()).filter;
  EXPECT_FLOAT_EQ(0.2F, filter.score_threshold);
  EXPECT_FLOAT_EQ(0.1F, filter.class_thresholds.at("person"));
  EXPECT_FLOAT_EQ(0.2F, filter.class_thresholds.at("traffic light"));
}

TEST(SsdRosOptions, ScoresOfTheTrackerAreTheUsersThenTheModels)
{
  ModelDescription model = makeModel();
  model.tracker = {0.5, 0.3};
  EXPECT_FLOAT_EQ(0.3F, ssd_reader.load("{}").detectorOptions(model).filter.score_threshold);
  const auto scores = [&model](const char* parameters)
  { return ssd_reader.load(parameters).tracker.forNetwork(model.tracker).scores; };
  EXPECT_EQ(0.5, scores("{}").high);
  EXPECT_EQ(0.3, scores("{}").low);
  EXPECT_EQ(0.7, scores("tracker: {high_score: 0.7}").high);
  // The two stay in their order.
  EXPECT_EQ(0.2, scores("tracker: {high_score: 0.2}").low);
  EXPECT_EQ(0.6, scores("tracker: {low_score: 0.6}").high);
}

}  // namespace
}  // namespace pi_detect
