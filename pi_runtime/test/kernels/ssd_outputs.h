#pragma once

#include <cmath>
#include <opencv2/dnn.hpp>
#include <vector>

#include <pi_runtime/kernels/ssd_postprocess.h>

namespace pi_runtime
{

/// What an SSD network might give out for a picture with a dozen objects: logits, most of them for the background.
struct SsdOutputs
{
  std::vector<kernels::SsdPrior> priors;
  std::vector<float> locations;
  std::vector<float> confidences;
  int classes;
};

/// The sizes that Liu et al. give a feature map (eq. 4 and the text below it): for each aspect ratio a, scale * sqrt(a)
/// by scale / sqrt(a); after the one for a = 1, a square of sqrt(scale * next_scale) if next_scale is positive.
inline std::vector<kernels::SsdBoxSize> ssdBoxSizes(float scale, float next_scale,
                                                    const std::vector<float>& aspect_ratios)
{
  std::vector<kernels::SsdBoxSize> sizes;
  for (const float ratio : aspect_ratios)
  {
    const float root = std::sqrt(ratio);
    sizes.push_back({scale * root, scale / root});
    if (ratio == 1.0F && next_scale > 0.0F)
    {
      const float between = std::sqrt(scale * next_scale);
      sizes.push_back({between, between});
    }
  }
  return sizes;
}

/// Default boxes of SSD300 (Liu et al. 2016): 8732.
inline std::vector<kernels::SsdPrior> ssd300Priors()
{
  const std::vector<int> cells{38, 19, 10, 5, 3, 1};
  const std::vector<float> scales{0.1F, 0.2F, 0.375F, 0.55F, 0.725F, 0.9F, 1.075F};
  std::vector<kernels::SsdFeatureMap> maps;
  for (size_t i = 0; i < cells.size(); ++i)
  {
    const bool few = i == 0 || i >= 4;
    const std::vector<float> ratios =
        few ? std::vector<float>{1.0F, 2.0F, 0.5F} : std::vector<float>{1.0F, 2.0F, 0.5F, 3.0F, 1.0F / 3.0F};
    maps.push_back({cells[i], cells[i], ssdBoxSizes(scales[i], scales[i + 1], ratios)});
  }
  return kernels::makeSsdPriors(maps, true);
}

/// Default boxes of TensorFlow's ssd_mobilenet for 300 x 300: 1917.
inline std::vector<kernels::SsdPrior> mobilenetSsdPriors()
{
  const std::vector<int> cells{19, 10, 5, 3, 2, 1};
  std::vector<kernels::SsdFeatureMap> maps;
  for (size_t i = 0; i < cells.size(); ++i)
  {
    const float scale = 0.2F + 0.15F * static_cast<float>(i);
    const float next = i + 1 < cells.size() ? scale + 0.15F : 1.0F;
    std::vector<kernels::SsdBoxSize> boxes = ssdBoxSizes(scale, next, {1.0F, 2.0F, 0.5F, 3.0F, 1.0F / 3.0F});
    if (i == 0)
    {
      boxes = {{0.1F, 0.1F},
               {0.2F * std::sqrt(2.0F), 0.2F / std::sqrt(2.0F)},
               {0.2F / std::sqrt(2.0F), 0.2F * std::sqrt(2.0F)}};
    }
    maps.push_back({cells[i], cells[i], boxes});
  }
  return kernels::makeSsdPriors(maps, false);
}

inline SsdOutputs makeSsdOutputs(const std::vector<kernels::SsdPrior>& priors, int classes, uint64_t seed)
{
  cv::RNG random(seed);
  SsdOutputs outputs{priors, {}, {}, classes};
  struct Object
  {
    cv::Rect2f box;
    int class_id;
  };
  std::vector<Object> objects;
  for (int i = 0; i < 12; ++i)
  {
    const cv::Size2f size(random.uniform(0.1F, 0.4F), random.uniform(0.1F, 0.4F));
    const cv::Point2f corner(random.uniform(0.0F, 1.0F - size.width), random.uniform(0.0F, 1.0F - size.height));
    objects.push_back({{corner, size}, random.uniform(1, classes)});
  }
  for (const kernels::SsdPrior& prior : priors)
  {
    for (int k = 0; k < 4; ++k)
    {
      outputs.locations.push_back(static_cast<float>(random.gaussian(0.7)));
    }
    const size_t row = outputs.confidences.size();
    for (int c = 0; c < classes; ++c)
    {
      outputs.confidences.push_back(static_cast<float>(c == 0 ? 7.0 + random.gaussian(1.5) : random.gaussian(1.2)));
    }
    const cv::Rect2f box(prior.cx - prior.width / 2, prior.cy - prior.height / 2, prior.width, prior.height);
    for (const Object& object : objects)
    {
      const float both = (box & object.box).area();
      const float overlap = both / (box.area() + object.box.area() - both);
      outputs.confidences[row + object.class_id] += 14.0F * overlap;
    }
  }
  return outputs;
}

inline void softmaxRows(SsdOutputs* outputs)
{
  for (size_t row = 0; row < outputs->confidences.size(); row += outputs->classes)
  {
    float* const values = outputs->confidences.data() + row;
    double sum = 0.0;
    for (int c = 0; c < outputs->classes; ++c)
    {
      sum += std::exp(static_cast<double>(values[c]));
    }
    for (int c = 0; c < outputs->classes; ++c)
    {
      values[c] = static_cast<float>(std::exp(static_cast<double>(values[c])) / sum);
    }
  }
}

/// OpenCV's layer for the same job, on scores.
class OpenCvDetectionOutput
{
public:
  OpenCvDetectionOutput(const SsdOutputs& outputs, const kernels::SsdShape& shape,
                        const kernels::SsdVariances& variances)
    : locations_(1, shape.priors * 4, CV_32F)
    , confidences_(1, shape.priors * shape.classes, CV_32F)
    , priors_(std::vector<int>{1, 2, shape.priors * 4}, CV_32F)
  {
    std::copy(outputs.locations.begin(), outputs.locations.end(), locations_.ptr<float>());
    std::copy(outputs.confidences.begin(), outputs.confidences.end(), confidences_.ptr<float>());
    float* corner = priors_.ptr<float>();
    float* variance = corner + 4 * static_cast<size_t>(shape.priors);
    for (const kernels::SsdPrior& p : outputs.priors)
    {
      for (const float value : {p.cx - p.width / 2, p.cy - p.height / 2, p.cx + p.width / 2, p.cy + p.height / 2})
      {
        *corner++ = value;
      }
      for (const float value : {variances.x, variances.y, variances.width, variances.height})
      {
        *variance++ = value;
      }
    }
    cv::dnn::LayerParams params;
    params.set("num_classes", shape.classes);
    params.set("share_location", true);
    params.set("background_label_id", shape.background);
    params.set("nms_threshold", shape.overlap_threshold);
    params.set("top_k", shape.top_k);
    params.set("keep_top_k", shape.keep_top_k);
    params.set("confidence_threshold", shape.score_threshold);
    params.set("code_type", cv::String("CENTER_SIZE"));
    net_.setInputsNames({"locations", "confidences", "priors"});
    const int id = net_.addLayer("detections", "DetectionOutput", params);
    for (int input = 0; input < 3; ++input)
    {
      net_.connect(0, input, id, input);
    }
    net_.setPreferableBackend(cv::dnn::DNN_BACKEND_OPENCV);
  }

  /// Rows of seven floats, by class, then score.
  cv::Mat run()
  {
    net_.setInput(locations_, "locations");
    net_.setInput(confidences_, "confidences");
    net_.setInput(priors_, "priors");
    const cv::Mat output = net_.forward();
    return output.reshape(1, static_cast<int>(output.total() / 7));
  }

private:
  cv::Mat locations_;
  cv::Mat confidences_;
  cv::Mat priors_;
  cv::dnn::Net net_;
};

}  // namespace pi_runtime
