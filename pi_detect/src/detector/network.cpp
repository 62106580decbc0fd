#include "detector/network.h"

#include <pi_detect/model_catalogue.h>

#include <boost/algorithm/string.hpp>
#include <filesystem>
#include <fstream>
#include <optional>
#include <sstream>
#include <utility>

#include "detector/cell_decoder.h"
#include "detector/onnx_floats.h"

namespace pi_detect
{
namespace
{

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

std::string contentOf(const std::string& path)
{
  std::ifstream file(path, std::ios::binary);
  std::ostringstream content;
  content << file.rdbuf();
  if (!file)
  {
    throw ModelError(path + ": cannot be read");
  }
  return content.str();
}

void checkFile(const ModelFile& file)
{
  namespace fs = std::filesystem;
  std::error_code error;
  if (!fs::is_regular_file(file.path, error))
  {
    throw ModelError(file.path + ": there is no such file, nor below " + boost::join(weightsFolders(), " or ") +
                     "; \"rosrun pi_detect fetch_models --list\" shows what can be had");
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

Network::Network(const ModelDescription& model, const TargetInUse& target) : model_(model)
{
  try
  {
    read();
    net_.setPreferableBackend(cv::dnn::DNN_BACKEND_OPENCV);
    net_.setPreferableTarget(target.used == Target::CPU      ? cv::dnn::DNN_TARGET_CPU
                             : target.used == Target::OPENCL ? cv::dnn::DNN_TARGET_OPENCL
                                                             : cv::dnn::DNN_TARGET_OPENCL_FP16);
    output_names_ = net_.getUnconnectedOutLayersNames();
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
    const std::string content = withFloats(contentOf(weights));
    net_ = cv::dnn::readNetFromONNX(content.data(), content.size());
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
  return outputs_;
}

std::vector<OutputShape> Network::shapes() const
{
  std::vector<OutputShape> shapes;
  for (size_t i = 0; i < outputs_.size(); ++i)
  {
    const cv::Mat& output = outputs_[i];
    const auto columns = output.dims == 0 ? size_t{0} : static_cast<size_t>(output.size[output.dims - 1]);
    shapes.push_back({output_names_[i], columns == 0 ? 0 : output.total() / columns, columns});
  }
  return shapes;
}

void Network::refuseOutputs(const std::string& needed) const
{
  const std::optional<OutputKind> kind = kindOf(shapes(), model_);
  throw ModelError(model_.weights.path + ": its outputs are " + toString(shapes()) + "; output/kind " +
                   toString(model_.output_kind) + " needs " + needed +
                   (kind && *kind != model_.output_kind
                        ? std::string(": they look like output/kind ") + toString(*kind)
                        : ": description and network do not belong together, or the kind is none of detections, grid "
                          "and distribution"));
}

void Network::checkOutputs()
{
  const std::string cells = std::to_string(cellsOf(model_.input, model_.cells.strides)) + " x ";
  switch (model_.output_kind)
  {
    case OutputKind::DETECTIONS:
      if (kindOf(shapes(), model_) != OutputKind::DETECTIONS)
      {
        refuseOutputs("one of N x 7, as the DetectionOutput layer gives");
      }
      return;
    case OutputKind::GRID:
      if (kindOf(shapes(), model_) != OutputKind::GRID)
      {
        refuseOutputs("one of " + cells + std::to_string(model_.cells.classes + 5) +
                      " for the input's size, the strides and the classes");
      }
      return;
    case OutputKind::DISTRIBUTION:
      break;
  }
  const std::vector<size_t> order = orderOfDistributions(shapes(), model_);
  if (order.empty())
  {
    const std::string distances = std::to_string(4 * model_.cells.bins);
    refuseOutputs("one of " + cells + std::to_string(model_.cells.classes + 4 * model_.cells.bins) +
                  ", or per stride one with " + std::to_string(model_.cells.classes) + " and one with " + distances +
                  " columns, for the input's size, the strides, the classes and the bins");
  }
  std::vector<std::string> names;
  std::vector<cv::Mat> outputs;
  for (const size_t index : order)
  {
    names.push_back(output_names_[index]);
    outputs.push_back(outputs_[index]);
  }
  output_names_ = std::move(names);
  outputs_ = std::move(outputs);
}

}  // namespace pi_detect
