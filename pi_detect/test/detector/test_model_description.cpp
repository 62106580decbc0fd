#include <gtest/gtest.h>
#include <pi_detect/model_description.h>
#include <pi_node/test_support/temporary_folder.h>

#include <cstdlib>
#include <fstream>
#include <string>

#include "contains.h"

namespace pi_detect
{

using namespace pi_node::test_support;
namespace
{

constexpr char MINIMAL[] = R"(name: net-1
weights: {file: net.onnx}
input: {width: 300, height: 200}
output: {kind: detections}
labels: {1: person, 3: car}
)";

constexpr char FULL[] = R"(name: full
weights: {file: net.onnx, sha256: 0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef}
input: {width: 64, height: 64, mean: [1, 2, 3], scale: 0.5, channels: bgr, resize: letterbox, bar_level: 7}
output: {kind: detections}
labels: {1: person, 2: car}
score_threshold: 0.25
tracker: {high_score: 0.35, low_score: 0.2}
class_agnostic_overlap: 0.5
origin: a test
licence: none
)";

constexpr char GRID[] = R"(name: cells
weights: {file: net.onnx}
input: {width: 64, height: 64, std: [2, 4, 5], resize: letterbox_top_left}
output:
  {kind: grid, strides: [4, 8], offset: 0.5, activation: sigmoid, overlap_threshold: 0.6, top_k: 50, keep_top_k: 20}
labels: {0: person, 2: car}
)";

class ModelDescriptionFile : public testing::Test
{
protected:
  std::string write(const std::string& content) const
  {
    const std::string path = folder_.path() + "/model.yaml";
    std::ofstream(path) << content;
    return path;
  }

  /// The text of the error that loading ends with; empty: it loads.
  std::string errorOf(const std::string& content) const
  {
    try
    {
      ModelDescription::load(write(content));
      return "";
    }
    catch (const ModelError& error)
    {
      return error.what();
    }
  }

  /// errorOf() of a text with one part replaced.
  std::string errorWith(std::string content, const std::string& part, const std::string& replacement) const
  {
    const size_t at = content.find(part);
    EXPECT_NE(std::string::npos, at) << part;
    return errorOf(content.replace(at, part.size(), replacement));
  }

  TemporaryFolder folder_;
};

TEST_F(ModelDescriptionFile, WhatIsNotWrittenHasDefaults)
{
  const ModelDescription model = ModelDescription::load(write(MINIMAL));
  EXPECT_EQ("net-1", model.name);
  EXPECT_EQ(folder_.path() + "/net.onnx", model.weights.path);
  EXPECT_TRUE(model.config.path.empty());
  EXPECT_EQ(200, model.input.height);
  EXPECT_TRUE(model.input.rgb);
  EXPECT_EQ(InputFit::STRETCH, model.input.fit);
  EXPECT_EQ(OutputKind::DETECTIONS, model.output_kind);
  EXPECT_EQ(3, model.idOf("car"));
  EXPECT_EQ(-1, model.idOf("tree"));
  EXPECT_FLOAT_EQ(0.5F, model.score_threshold);
  EXPECT_EQ(TrackerScores().high, model.tracker.high);
}

TEST_F(ModelDescriptionFile, AllFieldsAreRead)
{
  const ModelDescription model = ModelDescription::load(write(FULL));
  EXPECT_EQ("0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef", model.weights.sha256);
  EXPECT_EQ((std::array<float, 3>{{1.0F, 2.0F, 3.0F}}), model.input.mean);
  EXPECT_EQ((std::array<float, 3>{{0.5F, 0.5F, 0.5F}}), model.input.scale);
  EXPECT_FALSE(model.input.rgb);
  EXPECT_EQ(InputFit::LETTERBOX, model.input.fit);
  EXPECT_EQ(7, model.input.bar_level);
  EXPECT_FLOAT_EQ(0.25F, model.score_threshold);
  EXPECT_EQ(0.35, model.tracker.high);
  EXPECT_EQ(0.2, model.tracker.low);
  EXPECT_FLOAT_EQ(0.5F, model.class_agnostic_overlap);
  EXPECT_EQ("a test", model.origin);
}

TEST_F(ModelDescriptionFile, OutputsPerCellAreRead)
{
  ModelDescription model = ModelDescription::load(write(GRID));
  EXPECT_EQ(OutputKind::GRID, model.output_kind);
  EXPECT_EQ((std::array<float, 3>{{0.5F, 0.25F, 0.2F}}), model.input.scale);
  EXPECT_EQ(InputFit::LETTERBOX_TOP_LEFT, model.input.fit);
  EXPECT_EQ((std::vector<int>{4, 8}), model.cells.strides);
  EXPECT_FLOAT_EQ(0.5F, model.cells.offset);
  EXPECT_TRUE(model.cells.sigmoid);
  EXPECT_EQ(3, model.cells.classes);
  EXPECT_FLOAT_EQ(0.6F, model.cells.overlap_threshold);
  EXPECT_EQ(50, model.cells.top_k);
  EXPECT_EQ(20, model.cells.keep_top_k);
  model =
      ModelDescription::load(write("name: n\nweights: {file: net.onnx}\ninput: {width: 64, height: 64}\n"
                                   "output: {kind: distribution, bins: 16}\nlabels: {0: person}\n"));
  EXPECT_EQ(OutputKind::DISTRIBUTION, model.output_kind);
  EXPECT_EQ(16, model.cells.bins);
  EXPECT_FLOAT_EQ(0.5F, model.cells.offset);
  EXPECT_EQ((std::vector<int>{8, 16, 32}), model.cells.strides);
}

TEST_F(ModelDescriptionFile, PathsTakeVariablesOfTheEnvironment)
{
  setenv("PI_DETECT_TEST_FOLDER", "/somewhere", 1);
  std::string text = MINIMAL;
  text.replace(text.find("net.onnx"), 8, "\"${PI_DETECT_TEST_FOLDER}/x/net.onnx\"");
  EXPECT_EQ("/somewhere/x/net.onnx", ModelDescription::load(write(text)).weights.path);
  unsetenv("PI_DETECT_TEST_FOLDER");
  EXPECT_TRUE(contains(errorOf(text), "PI_DETECT_TEST_FOLDER is not set: set it in the environment"));
}

TEST_F(ModelDescriptionFile, AMissingFileIsNamed)
{
  try
  {
    ModelDescription::load("/nowhere/model.yaml");
    FAIL() << "was loaded";
  }
  catch (const ModelError& error)
  {
    EXPECT_TRUE(contains(error.what(), "/nowhere/model.yaml: there is no such file")) << error.what();
  }
}

TEST_F(ModelDescriptionFile, ErrorsNameFileFieldValueAndBound)
{
  EXPECT_TRUE(contains(errorOf("[1, 2]"), folder_.path() + "/model.yaml: the file must be a map of fields"));
  EXPECT_TRUE(contains(errorOf("name: [unclosed"), "model.yaml: yaml-cpp: error"));
  EXPECT_TRUE(contains(errorOf("name: x\n"), "weights is missing"));
  EXPECT_TRUE(contains(errorWith(MINIMAL, "net-1", "\"a b\""), "name = \"a b\", must be letters, digits, _ and -"));
  EXPECT_TRUE(contains(errorWith(MINIMAL, "width: 300", "width: 4"), "input/width = 4, must be in [8, 4096]"));
  EXPECT_TRUE(
      contains(errorWith(MINIMAL, "width: 300", "width: wide"), "input/width = \"wide\", must be a whole number"));
  EXPECT_TRUE(contains(errorWith(MINIMAL, "width: 300", "wdth: 300"), "input/width is missing"));
  EXPECT_TRUE(contains(errorWith(MINIMAL, "height: 200", "height: 200, heigth: 1"), "input/heigth means nothing here"));
  EXPECT_TRUE(contains(errorWith(MINIMAL, "kind: detections", "kind: raw"),
                       "output/kind = \"raw\", must be detections or distribution or grid"));
  EXPECT_TRUE(contains(errorWith(MINIMAL, "{1: person, 3: car}", "{}"), "labels = (empty)"));
  EXPECT_TRUE(contains(errorWith(MINIMAL, "{1: person", "{-1: person"), "labels: id = -1, must be at least 0"));
  EXPECT_TRUE(contains(errorWith(MINIMAL, "3: car}", "2000000000: car}"), "labels: id = 2000000000, must be at most"));
  EXPECT_TRUE(contains(errorWith(FULL, "0123456789abcdef0", "x"), "weights/sha256 = "));
  EXPECT_TRUE(contains(errorWith(MINIMAL, "{file: net.onnx}", "[]"), "weights = (empty), must be a file or a list"));
  EXPECT_TRUE(contains(errorWith(MINIMAL, "{file: net.onnx}", "[{file: a}, {file: b, sha256: x}]"), "sha256 = \"x\""));
  EXPECT_TRUE(contains(errorWith(MINIMAL, "name: net-1", "name: net-1\nfallback: a b"), "fallback = \"a b\""));
  EXPECT_TRUE(contains(errorWith(FULL, "[1, 2, 3]", "[1, 2]"), "input/mean = 2 numbers, must be a list of 3 numbers"));
  EXPECT_TRUE(contains(errorWith(GRID, "std: [2, 4, 5]", "std: [2, 0, 5]"), "input/std = 0, must be above 0"));
  EXPECT_TRUE(contains(errorWith(GRID, "std: [2, 4, 5]", "std: [2, 4, 5], scale: 1"), "input/std = (given)"));
  EXPECT_TRUE(contains(errorWith(GRID, "strides: [4, 8]", "strides: [4, 0]"), "output/strides = 0"));
  EXPECT_TRUE(contains(errorWith(GRID, "strides: [4, 8]", "strides: []"), "output/strides = (empty)"));
  EXPECT_TRUE(contains(errorWith(GRID, "offset: 0.5", "offset: 2"), "output/offset = 2, must be in [0, 1]"));
  EXPECT_TRUE(contains(errorWith(GRID, "kind: grid", "kind: distribution, bins: 1"), "output/bins = 1"));
  EXPECT_TRUE(contains(errorWith(GRID, "kind: grid", "kind: grid, bins: 8"), "output/bins means nothing here"));
  EXPECT_TRUE(contains(errorWith(GRID, "kind: grid", "kind: grid, classes: 2"), "labels: id = 2"));
  EXPECT_TRUE(contains(errorWith(FULL, "score_threshold: 0.25", "score_threshold: .nan"), "score_threshold = nan"));
  EXPECT_TRUE(contains(errorWith(FULL, "low_score: 0.2", "low_score: 0.4"), "tracker/low_score = 0.4"));
  EXPECT_TRUE(contains(errorWith(FULL, "high_score: 0.35", "high_score: 1.1"), "tracker/high_score = 1.1"));
}

TEST(Sha256, IsThatOfTheStandardsExample)
{
  const TemporaryFolder folder;
  const std::string path = folder.path() + "/abc";
  std::ofstream(path) << "abc";
  EXPECT_EQ("ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad", sha256OfFile(path));
  std::ofstream(path).close();
  EXPECT_EQ("e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855", sha256OfFile(path));
  EXPECT_THROW(sha256OfFile(folder.path() + "/none"), ModelError);
}

}  // namespace
}  // namespace pi_detect
