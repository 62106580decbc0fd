#include <gtest/gtest.h>
#include <pi_node/test_support/temporary_folder.h>
#include <pi_speech/confidence.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <stdexcept>
#include <string>

#include "recognizer/test_support.h"

namespace pi_speech
{

using namespace pi_node::test_support;
namespace
{

using Weights = std::map<std::string, std::string>;

/// All weights 0, but for those given. An empty one is left out.
std::string textOf(const Weights& given)
{
  Weights weights{{"bias", "0"}};
  for (const std::string& feature : ConfidenceModel::featureNames())
  {
    weights[feature] = "0";
  }
  for (const auto& [key, value] : given)
  {
    weights[key] = value;
  }
  std::string text;
  for (const auto& [key, value] : weights)
  {
    text += value.empty() ? "" : key + ": " + value + "\n";
  }
  return text;
}

ConfidenceModel model(const Weights& weights)
{
  const TemporaryFolder folder;
  return ConfidenceModel::load(folder.file("confidence.yaml", textOf(weights)));
}

/// The message without the path that it has to begin with.
std::string confidenceError(const std::string& content)
{
  const TemporaryFolder folder;
  const std::string path = folder.file("confidence.yaml", content);
  try
  {
    ConfidenceModel::load(path);
    return "";
  }
  catch (const std::runtime_error& error)
  {
    const std::string text = error.what();
    EXPECT_EQ(0U, text.find(path + ": ")) << text;
    return text.substr(std::min(text.size(), path.size() + 2));
  }
}

Evidence evidence(const std::string& command = "stop")
{
  Evidence result;
  result.command = command;
  result.word_margin = 3.0;
  result.garbage_ratio = 0.8;
  result.talk_ratio = 0.7;
  result.phone_ratio = -0.5;
  result.word_score = -3.0;
  result.speech_s = 0.5;
  result.words = static_cast<int>(1 + std::count(command.begin(), command.end(), ' '));
  return result;
}

double logit(double probability)
{
  return std::log(probability / (1.0 - probability));
}

TEST(Confidence, TheFileOfThePackageIsRead)
{
  const ConfidenceModel model = ConfidenceModel::load(std::string(PI_SPEECH_CONFIG) + "/confidence.yaml");
  EXPECT_GT(model.confidence(evidence()), 0.0);
  EXPECT_LT(model.confidence(evidence()), 1.0);
}

TEST(Confidence, ThereIsANameForEachFeature)
{
  EXPECT_EQ(ConfidenceModel::featureNames().size(), ConfidenceModel::features(evidence()).size());
}

TEST(Confidence, RisesWithTheMarginOfTheWords)
{
  const ConfidenceModel with_margin = model({{"bias", "-1"}, {"word_margin", "0.5"}});
  Evidence changing = evidence();
  double before = 0.0;
  for (double margin = -10.0; margin <= 10.0; margin += 0.5)
  {
    changing.word_margin = margin;
    const double confidence = with_margin.confidence(changing);
    EXPECT_GT(confidence, before);
    EXPECT_LT(confidence, 1.0);
    before = confidence;
  }
}

TEST(Confidence, IsTheLogisticFunctionOfTheWeightedSum)
{
  Evidence changing = evidence();
  changing.word_margin = 2.0;
  EXPECT_NEAR(1.0 / (1.0 + std::exp(1.0 - 1.0)), model({{"bias", "-1"}, {"word_margin", "0.5"}}).confidence(changing),
              1e-9);
  EXPECT_NEAR(0.6, logit(model({{"garbage_ratio", "0.75"}}).confidence(changing)), 1e-9);
  changing.garbage_ratio = 5.0;  // more than 2 per frame is as good as 2
  EXPECT_NEAR(1.5, logit(model({{"garbage_ratio", "0.75"}}).confidence(changing)), 1e-9);
}

TEST(Confidence, EachPieceOfEvidenceCounts)
{
  const Evidence base = evidence();
  std::map<std::string, Evidence> changed;
  for (const std::string& name : ConfidenceModel::featureNames())
  {
    changed[name] = base;
  }
  changed["word_margin"].word_margin += 1.0;
  changed["garbage_ratio"].garbage_ratio -= 1.0;
  changed["talk_ratio"].talk_ratio -= 1.0;
  changed["phone_ratio"].phone_ratio -= 1.0;
  changed["word_score"].word_score -= 1.0;
  changed["log_speech_s"].speech_s = 0.7;
  changed["log_speech_s_squared"].speech_s = 0.7;
  changed["more_words"].words = 2;
  for (const auto& [name, other] : changed)
  {
    const ConfidenceModel one = model({{name, "0.5"}});
    EXPECT_GT(std::abs(logit(one.confidence(other)) - logit(one.confidence(base))), 1e-3) << name;
  }
}

TEST(Confidence, ExtremeEvidenceStaysAProbability)
{
  const double infinity = std::numeric_limits<double>::infinity();
  Weights weights;
  for (const std::string& name : ConfidenceModel::featureNames())
  {
    weights[name] = "1";
  }
  const ConfidenceModel extreme = model(weights);
  for (const double sign : {-1.0, 1.0})
  {
    Evidence any = evidence();
    any.word_margin = sign * infinity;
    any.garbage_ratio = any.talk_ratio = any.phone_ratio = any.word_score = sign * infinity;
    any.speech_s = sign > 0.0 ? 1e9 : 0.0;
    const double confidence = extreme.confidence(any);
    EXPECT_GE(confidence, 0.0);
    EXPECT_LE(confidence, 1.0);
    EXPECT_TRUE(sign > 0.0 ? confidence > 0.9 : confidence < 0.1) << confidence;
  }
}

TEST(Confidence, AWeightThatIsMissingIsNamed)
{
  for (const std::string& name : ConfidenceModel::featureNames())
  {
    EXPECT_TRUE(contains(confidenceError(textOf({{name, ""}})), name + " is missing"));
  }
  EXPECT_TRUE(contains(confidenceError(textOf({{"bias", ""}})), "bias is missing"));
}

TEST(Confidence, AWeightThatIsUnknownIsNamed)
{
  EXPECT_TRUE(contains(confidenceError(textOf({{"loudness", "1"}})), "loudness"));
}

TEST(Confidence, WhatIsNoNumberIsAnError)
{
  for (const char* value : {"much", ".nan", ".inf", "[1, 2]"})
  {
    EXPECT_NE("", confidenceError(textOf({{"bias", value}}))) << value;
  }
}

TEST(Confidence, WhatIsNoSuchFileIsAnError)
{
  EXPECT_NE("", confidenceError(""));
  EXPECT_NE("", confidenceError("bias: [1"));
  EXPECT_NE("", confidenceError("just a text"));
  EXPECT_NE("", confidenceError("- a\n- list\n"));
  EXPECT_NE("", confidenceError(std::string("\0\1\2\3", 4)));
  const TemporaryFolder folder;
  for (const std::string& path : {folder.path() + "/missing.yaml", folder.path()})
  {
    try
    {
      ConfidenceModel::load(path);
      ADD_FAILURE() << path;
    }
    catch (const std::runtime_error& error)
    {
      EXPECT_EQ(0U, std::string(error.what()).find(path + ": ")) << error.what();
    }
  }
}

}  // namespace
}  // namespace pi_speech
