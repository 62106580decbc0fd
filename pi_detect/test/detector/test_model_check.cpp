#include <gtest/gtest.h>
#include <pi_detect/model_check.h>
#include <pi_node/test_support/temporary_folder.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <string>

#include "contains.h"
#include "detector/tiny_network.h"

namespace pi_detect
{

using namespace pi_node::test_support;
namespace
{

namespace fs = std::filesystem;

class ModelCheck : public testing::Test
{
protected:
  ModelDescription tiny() const { return ModelDescription::load(writeTinyNetwork(folder_.path())); }

  /// A description of a file with this content; OpenCV reads it as what its name says.
  ModelDescription describe(const std::string& name, const std::string& content) const
  {
    std::ofstream(folder_.path() + "/" + name, std::ios::binary) << content;
    const std::string path = folder_.path() + "/model.yaml";
    std::ofstream(path) << "name: damaged\nweights: {file: " << name << "}\ninput: {width: 300, height: 300}\n"
                        << "output: {kind: detections}\nlabels: {1: thing}\n";
    return ModelDescription::load(path);
  }

  static std::string errorOf(const ModelDescription& model, const ModelCheckOptions& options = ModelCheckOptions())
  {
    try
    {
      checkModel(model, options);
      return "";
    }
    catch (const ModelError& error)
    {
      return error.what();
    }
  }

  std::string script(const std::string& command) const
  {
    const std::string path = folder_.path() + "/program";
    std::ofstream(path) << "#!/bin/sh\n" << command << "\n";
    fs::permissions(path, fs::perms::owner_all);
    return path;
  }

  TemporaryFolder folder_;
};

TEST_F(ModelCheck, AGoodModelPasses)
{
  EXPECT_EQ("", errorOf(tiny()));
}

TEST_F(ModelCheck, AMissingFileIsNamedWithAWayOut)
{
  const ModelDescription model = tiny();
  fs::remove(model.weights.path);
  const std::string error = errorOf(model);
  EXPECT_TRUE(contains(error, model.weights.path + ": there is no such file")) << error;
  EXPECT_TRUE(contains(error, "fetch_models")) << error;
}

TEST_F(ModelCheck, AnEmptyFileIsRefused)
{
  EXPECT_TRUE(contains(errorOf(describe("net.onnx", "")), "the file is empty"));
}

TEST_F(ModelCheck, AnotherSumIsRefused)
{
  ModelDescription model = tiny();
  model.weights.sha256 = std::string(64, '0');
  EXPECT_TRUE(
      contains(errorOf(model), "SHA-256 is " + sha256OfFile(model.weights.path) + ", but the description says 0"));
}

TEST_F(ModelCheck, RubbishOfEveryKindIsRefused)
{
  std::mt19937 random(1);
  std::string rubbish(20000, ' ');
  for (char& c : rubbish)
  {
    c = static_cast<char>(random());
  }
  for (const char* name : {"net.onnx", "net.pb", "net.prototxt"})
  {
    EXPECT_NE("", errorOf(describe(name, rubbish))) << name;
  }
  EXPECT_TRUE(contains(errorOf(describe("net.weights", rubbish)), "unknown kind of network \".weights\""));
  EXPECT_TRUE(contains(errorOf(describe("net.caffemodel", rubbish)), "needs its .prototxt"));
}

TEST_F(ModelCheck, ANetworkThatIsNoDetectorIsRefused)
{
  const ModelDescription model = describe("net.prototxt", R"(input: "data"
input_shape { dim: 1 dim: 3 dim: 300 dim: 300 }
layer { name: "mean" type: "Pooling" bottom: "data" top: "mean" pooling_param { pool: AVE kernel_size: 8 stride: 8 } }
)");
  EXPECT_TRUE(contains(errorOf(model), "output/kind detections needs one of N x 7"));
}

TEST_F(ModelCheck, OutputsThatAreNotAsDescribedAreRefused)
{
  const ModelDescription model = ModelDescription::load(writeTinyNetwork(folder_.path(), TinyOutput::GRID));
  const auto errorHere = [](const ModelDescription& wrong)
  {
    try
    {
      checkModelHere(wrong);
      return std::string();
    }
    catch (const ModelError& error)
    {
      return std::string(error.what());
    }
  };
  EXPECT_EQ("", errorHere(model));
  ModelDescription fewer_classes = model;
  fewer_classes.cells.classes = 2;
  EXPECT_TRUE(contains(errorHere(fewer_classes), "do not belong together")) << errorHere(fewer_classes);
}

TEST_F(ModelCheck, ACrashOfTheChildIsAnError)
{
  ModelCheckOptions options;
  options.program = script("kill -SEGV $$");
  EXPECT_TRUE(contains(errorOf(tiny(), options), "OpenCV crashes on it (Segmentation fault)"));
}

TEST_F(ModelCheck, TheFileIsNotBlamedForAnInterruption)
{
  ModelCheckOptions options;
  options.program = script("kill -TERM $$");
  const std::string error = errorOf(tiny(), options);
  EXPECT_TRUE(contains(error, "the check of it was ended from outside (Terminated)")) << error;
  EXPECT_FALSE(contains(error, "damaged")) << error;
}

TEST_F(ModelCheck, AChildThatHangsIsEnded)
{
  ModelCheckOptions options;
  options.program = script("exec tail -f /dev/null");
  options.timeout_s = 0.2;
  EXPECT_TRUE(contains(errorOf(tiny(), options), "loading it took longer than 0.2"));
}

TEST_F(ModelCheck, AProgramThatIsMissingIsNamed)
{
  ModelCheckOptions options;
  options.program = "/nowhere/check_model";
  EXPECT_TRUE(contains(errorOf(tiny(), options), "/nowhere/check_model"));
}

TEST_F(ModelCheck, ATruncatedNetworkIsAnErrorAndNoCrash)
{
  const char* data = std::getenv("PI_EDGE_DATA");
  const std::string path =
      std::string(data == nullptr ? "" : data) + "/detect/models/ssd_mobilenet_v1_075_coco_fp16.pb";
  if (!fs::is_regular_file(path))
  {
    GTEST_SKIP() << "no " << path << "; set PI_EDGE_DATA";
  }
  std::ifstream file(path, std::ios::binary);
  const std::string whole((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
  for (const size_t part : {size_t{1}, whole.size() / 10, whole.size() / 2, whole.size() - 1})
  {
    EXPECT_NE("", errorOf(describe("net.pb", whole.substr(0, part)))) << part << " of " << whole.size() << " bytes";
  }
  EXPECT_EQ("", errorOf(describe("net.pb", whole)));
}

}  // namespace
}  // namespace pi_detect
