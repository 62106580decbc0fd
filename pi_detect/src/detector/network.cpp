#include "detector/network.h"

#include <algorithm>
#include <boost/algorithm/string.hpp>
#include <cmath>
#include <filesystem>
#include <utility>

namespace pi_detect
{
namespace
{

constexpr int OUTPUT_COLUMNS = 7;

/// The informative line of OpenCV's message.
std::string reasonOf(const cv::Exception& error)
{
  const std::string text = error.err.empty() ? error.what() : error.err;
  return text.substr(0, text.find('\n'));
}

std::string extensionOf(const std::string& path)
{
  return boost::to_lower_copy(std::filesystem::path(path).extension().string());
}

std::string shapeOf(const cv::Mat& matrix)
{
  std::string text;
  for (int i = 0; i < matrix.dims; ++i)
  {
    text += (i == 0 ? "" : " x ") + std::to_string(matrix.size[i]);
  }
  return text;
}

void checkFile(const ModelFile& file)
{
  namespace fs = std::filesystem;
  std::error_code error;
  if (!fs::is_regular_file(file.path, error))
  {
    throw ModelError(file.path +
                     ": there is no such file; \"rosrun pi_detect fetch_models --list\" shows what can be had");
  }
  if (fs::file_size(file.path, error) == 0)
  {
    throw ModelError(file.path + ": the file is empty; fetch it again");
  }
  if (file.sha256.empty())
  {
    return;
  }
  const std::string sum = sha256OfFile(file.path);
  const std::string wanted = boost::to_lower_copy(file.sha256);
  if (sum != wanted)
  {
    throw ModelError(file.path + ": SHA-256 is " + sum + ", but the description says " + wanted +
                     ": the file is damaged or another one; fetch it again");
  }
}

}  // namespace

void checkFiles(const ModelDescription& model)
{
  checkFile(model.weights);
  if (!model.config.path.empty())
  {
    checkFile(model.config);
  }
}

std::vector<pi_runtime::kernels::SsdPrior> priorsOf(const ModelDescription& model)
{
  return pi_runtime::kernels::makeSsdPriors(model.raw.feature_maps, model.raw.clip_priors);
}

Network::Network(const ModelDescription& model, const TargetInUse& target) : model_(model)
{
  try
  {
    read();
    net_.setPreferableBackend(cv::dnn::DNN_BACKEND_OPENCV);
    net_.setPreferableTarget(target.used == Target::CPU      ? cv::dnn::DNN_TARGET_CPU
                             : target.used == Target::OPENCL ? cv::dnn::DNN_TARGET_OPENCL
                                                             : cv::dnn::DNN_TARGET_OPENCL_FP16);
    output_names_ = model_.output_kind == OutputKind::RAW
                        ? std::vector<std::string>{model_.raw.boxes, model_.raw.scores}
                        : net_.getUnconnectedOutLayersNames();
    const std::vector<std::string> layers = net_.getLayerNames();
    for (const std::string& name : output_names_)
    {
      if (std::find(layers.begin(), layers.end(), name) == layers.end())
      {
        throw ModelError(model_.weights.path + ": the network has no layer \"" + name + "\"; its outputs are " +
                         boost::join(net_.getUnconnectedOutLayersNames(), ", "));
      }
    }
    const std::vector<float> blank(static_cast<size_t>(3) * static_cast<size_t>(model_.input.width) *
                                   static_cast<size_t>(model_.input.height));
    forward(blank.data());
  }
  catch (const cv::Exception& error)
  {
    throw ModelError(model_.weights.path + ": OpenCV cannot use it: " + reasonOf(error));
  }
  catch (const std::runtime_error& error)
  {
    if (dynamic_cast<const ModelError*>(&error) != nullptr)
    {
      throw;
    }
    throw ModelError(model_.weights.path + ": OpenCV cannot run it: " + error.what());
  }
  checkOutputs();
}

void Network::read()
{
  const std::string& weights = model_.weights.path;
  const std::string& config = model_.config.path;
  const std::string extension = extensionOf(weights);
  if (extension == ".onnx")
  {
    net_ = cv::dnn::readNetFromONNX(weights);
  }
  else if (extension == ".pb")
  {
    net_ = cv::dnn::readNetFromTensorflow(weights, config);
  }
  else if (extension == ".caffemodel")
  {
    if (config.empty())
    {
      throw ModelError(weights + ": a .caffemodel needs its .prototxt: give it as config/file in the description");
    }
    net_ = cv::dnn::readNetFromCaffe(config, weights);
  }
  else if (extension == ".prototxt")  // without learned weights
  {
    net_ = cv::dnn::readNetFromCaffe(weights);
  }
  else
  {
    throw ModelError(weights + ": unknown kind of network \"" + extension +
                     "\": known are .onnx, .pb, .caffemodel and .prototxt");
  }
  if (net_.empty())
  {
    throw ModelError(weights + ": OpenCV found no layers in it");
  }
}

const std::vector<cv::Mat>& Network::forward(const float* blob)
{
  const int shape[] = {1, 3, model_.input.height, model_.input.width};
  // OpenCV copies the input; the cast is for Mat, which knows no const memory.
  net_.setInput(cv::Mat(4, shape, CV_32F, const_cast<float*>(blob)));
  try
  {
    net_.forward(outputs_, output_names_);
  }
  catch (const cv::Exception& error)
  {
    throw std::runtime_error(reasonOf(error));
  }
  for (cv::Mat& output : outputs_)
  {
    if (!output.isContinuous() || output.type() != CV_32F)
    {
      cv::Mat copy;
      output.convertTo(copy, CV_32F);
      output = copy;
    }
  }
  if (model_.output_kind == OutputKind::RAW && model_.raw.yxhw)
  {
    auto* code = outputs_[0].ptr<float>();
    for (size_t i = 0; i + 4 <= outputs_[0].total(); i += 4)
    {
      std::swap(code[i], code[i + 1]);
      std::swap(code[i + 2], code[i + 3]);
    }
  }
  return outputs_;
}

void Network::checkOutputs()
{
  if (model_.output_kind == OutputKind::DETECTIONS)
  {
    const bool is_rows =
        outputs_.size() == 1 && outputs_[0].dims >= 2 && outputs_[0].size[outputs_[0].dims - 1] == OUTPUT_COLUMNS;
    if (!is_rows)
    {
      throw ModelError(
          model_.weights.path + ": has " + std::to_string(outputs_.size()) + " outputs, the first of " +
          (outputs_.empty() ? "nothing" : shapeOf(outputs_[0])) +
          "; output/kind detections needs one of N x 7, as the DetectionOutput layer gives: describe other "
          "networks with output/kind raw");
    }
    return;
  }
  priors_ = priorsOf(model_).size();
  const std::pair<size_t, const std::string*> expected[] = {
      {priors_ * 4, &model_.raw.boxes}, {priors_ * static_cast<size_t>(model_.raw.classes), &model_.raw.scores}};
  for (size_t i = 0; i < 2; ++i)
  {
    if (outputs_[i].total() != expected[i].first)
    {
      throw ModelError(model_.weights.path + ": output \"" + *expected[i].second + "\" has " + shapeOf(outputs_[i]) +
                       " numbers, but the description's feature maps and classes make " +
                       std::to_string(expected[i].first) + ": description and network do not belong together");
    }
  }
}

}  // namespace pi_detect
