#include <gtest/gtest.h>
#include <pi_detect/model_catalogue.h>
#include <pi_node/test_support/temporary_folder.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

#include "contains.h"

namespace pi_detect
{

using namespace pi_node::test_support;
namespace
{

namespace fs = std::filesystem;

void write(const std::string& path, const std::string& content)
{
  fs::create_directories(fs::path(path).parent_path());
  std::ofstream(path) << content;
}

std::string descriptionOf(const std::string& name, const std::string& rest)
{
  return "name: " + name + "\ninput: {width: 300, height: 200}\noutput: {kind: detections}\nlabels: {1: person}\n" +
         rest;
}

/// A catalogue of two networks: "large", whose weights may be missing, and "small", which has them.
class ModelCatalogue : public testing::Test
{
protected:
  void SetUp() override
  {
    setenv("PI_EDGE_DATA", (folder_.path() + "/data").c_str(), 1);
    setenv("XDG_DATA_HOME", (folder_.path() + "/share").c_str(), 1);
    write(models_ + "/large.yaml",
          descriptionOf("net_large", "weights: [{file: first.onnx}, {file: second.onnx}]\nfallback: small\n"));
    write(models_ + "/small.yaml", descriptionOf("net_small", "weights: {file: small.onnx}\n"));
    write(models_ + "/small.onnx", "weights");
    write(models_ + "/catalogue.yaml", "models: {}\n");
  }

  void TearDown() override
  {
    data_ == nullptr ? unsetenv("PI_EDGE_DATA") : setenv("PI_EDGE_DATA", kept_data_.c_str(), 1);
    share_ == nullptr ? unsetenv("XDG_DATA_HOME") : setenv("XDG_DATA_HOME", kept_share_.c_str(), 1);
  }

  std::string errorOf(const std::string& model) const
  {
    try
    {
      chooseModel(model, models_);
      return "";
    }
    catch (const ModelError& error)
    {
      return error.what();
    }
  }

  const char* const data_ = std::getenv("PI_EDGE_DATA");
  const char* const share_ = std::getenv("XDG_DATA_HOME");
  const std::string kept_data_ = data_ == nullptr ? "" : data_;
  const std::string kept_share_ = share_ == nullptr ? "" : share_;
  TemporaryFolder folder_;
  const std::string models_ = folder_.path() + "/models";
};

TEST_F(ModelCatalogue, FindsANetworkByItsName)
{
  const ChosenModel small = chooseModel("small", models_);
  EXPECT_EQ("net_small", small.description.name);
  EXPECT_EQ(models_ + "/small.onnx", small.description.weights.path);
  EXPECT_EQ("", small.notice);
}

TEST_F(ModelCatalogue, TakesThePathOfADescription)
{
  EXPECT_EQ("net_small", chooseModel(models_ + "/small.yaml", "").description.name);
  EXPECT_TRUE(isModelPath("small.yaml"));
  EXPECT_TRUE(isModelPath("./small"));
  EXPECT_FALSE(isModelPath("small"));
}

TEST_F(ModelCatalogue, NamesTheNetworksThatThereAre)
{
  EXPECT_TRUE(contains(errorOf("medium"), "model \"medium\" is no network of " + models_ + ", which has large, small"));
  EXPECT_TRUE(contains(errorOf("catalogue"), "is no network"));
  EXPECT_TRUE(contains(errorOf("../models/medium.yaml"), "there is no such file"));
}

TEST_F(ModelCatalogue, FindsWeightsInTheFoldersForThem)
{
  ASSERT_EQ(
      (std::vector<std::string>{folder_.path() + "/data/detect/models", folder_.path() + "/share/pi_detect/models"}),
      weightsFolders());
  const std::string fetched = folder_.path() + "/share/pi_detect/models/second.onnx";
  write(fetched, "weights");
  EXPECT_EQ(fetched, chooseModel("large", models_).description.weights.path);
  const std::string shared = folder_.path() + "/data/detect/models/second.onnx";
  write(shared, "weights");
  EXPECT_EQ(shared, chooseModel("large", models_).description.weights.path);
  const std::string beside = models_ + "/first.onnx";
  write(beside, "weights");
  EXPECT_EQ(beside, chooseModel("large", models_).description.weights.path);
}

TEST_F(ModelCatalogue, AnotherNetworkStandsInWhileTheWeightsAreMissing)
{
  const ChosenModel chosen = chooseModel("large", models_);
  EXPECT_EQ("net_small", chosen.description.name);
  EXPECT_TRUE(contains(chosen.notice, "net_small stands in for net_large")) << chosen.notice;
  EXPECT_TRUE(contains(chosen.notice, "fetch_models large")) << chosen.notice;
  EXPECT_EQ(std::string::npos, chosen.notice.find('\n'));
}

TEST_F(ModelCatalogue, WithoutFallbackMissingWeightsStayMissing)
{
  fs::remove(models_ + "/small.onnx");
  const ChosenModel small = chooseModel("small", models_);
  EXPECT_EQ(models_ + "/small.onnx", small.description.weights.path);
  EXPECT_EQ("", small.notice);
}

TEST_F(ModelCatalogue, TheShippedNamesHaveDescriptions)
{
  for (const char* name : {"fast", "accurate", "ssd_mobilenet", "street", DEFAULT_MODEL})
  {
    EXPECT_NO_THROW(ModelDescription::load(std::string(MODELS) + "/" + name + ".yaml")) << name;
  }
  EXPECT_EQ("", chooseModel("street", MODELS).notice);
  EXPECT_TRUE(contains(chooseModel("accurate", MODELS).notice, "street stands in for yolox_nano_416"));
}

}  // namespace
}  // namespace pi_detect
