#include <pi_speech/confidence.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>

namespace pi_speech
{

namespace
{

constexpr double MOST_MARGIN = 12.0;  ///< of log posteriors that still makes a difference
constexpr double MOST_RATIO = 2.0;    ///< of log-likelihoods per frame
constexpr double MOST_SCORE = 20.0;   ///< per frame
constexpr double LEAST_SPEECH_S = 0.05;
constexpr double MOST_SPEECH_S = 5.0;

}  // namespace

const std::vector<std::string>& ConfidenceModel::featureNames()
{
  static const std::vector<std::string> NAMES{"word_margin", "garbage_ratio", "talk_ratio",           "phone_ratio",
                                              "word_score",  "log_speech_s",  "log_speech_s_squared", "more_words"};
  return NAMES;
}

std::vector<double> ConfidenceModel::features(const Evidence& evidence)
{
  const double log_speech = std::log(std::clamp(evidence.speech_s, LEAST_SPEECH_S, MOST_SPEECH_S) / evidence.words);
  return {std::clamp(evidence.word_margin, -MOST_MARGIN, MOST_MARGIN),
          std::clamp(evidence.garbage_ratio, -MOST_RATIO, MOST_RATIO),
          std::clamp(evidence.talk_ratio, -MOST_RATIO, MOST_RATIO),
          std::clamp(evidence.phone_ratio, -MOST_RATIO, MOST_RATIO),
          std::clamp(evidence.word_score, -MOST_SCORE, 0.0),
          log_speech,
          log_speech * log_speech,
          static_cast<double>(evidence.words - 1)};
}

ConfidenceModel ConfidenceModel::load(const std::string& path)
{
  try
  {
    const YAML::Node node = YAML::LoadFile(path);
    if (!node.IsMap())
    {
      throw std::runtime_error("is no map of weights: write the file by calibrate_confidence");
    }
    const std::vector<std::string>& names = featureNames();
    std::map<std::string, double> values;
    for (const auto& entry : node)
    {
      const auto key = entry.first.as<std::string>();
      if (key != "bias" && std::find(names.begin(), names.end(), key) == names.end())
      {
        throw std::runtime_error(key + " is no evidence that this program knows");
      }
      values[key] = entry.second.as<double>();
    }
    const auto take = [&](const std::string& key)
    {
      const auto value = values.find(key);
      if (value == values.end() || !std::isfinite(value->second))
      {
        throw std::runtime_error(key + " is missing, or no number");
      }
      return value->second;
    };
    ConfidenceModel model;
    model.bias_ = take("bias");
    for (const std::string& key : names)
    {
      model.weights_.push_back(take(key));
    }
    return model;
  }
  catch (const YAML::BadFile&)
  {
    throw std::runtime_error(path + ": the confidence model cannot be read: does the file exist?");
  }
  catch (const std::exception& error)
  {
    throw std::runtime_error(path + ": " + error.what());
  }
}

double ConfidenceModel::confidence(const Evidence& evidence) const
{
  const std::vector<double> values = features(evidence);
  double logit = bias_;
  for (size_t i = 0; i < values.size(); ++i)
  {
    logit += weights_[i] * values[i];
  }
  return 1.0 / (1.0 + std::exp(-logit));
}

}  // namespace pi_speech
