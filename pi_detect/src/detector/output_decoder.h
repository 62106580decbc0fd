#pragma once

#include <pi_detect/model_description.h>
#include <pi_runtime/task.h>

#include <functional>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

namespace pi_detect
{

/// A detection, as a row of OpenCV's DetectionOutput has it.
struct DecodedRow
{
  float image;  ///< 0
  float class_id;
  float score;
  float x1;  ///< corners in parts of the network's input
  float y1;
  float x2;
  float y2;
};

struct DecodedRows
{
  const DecodedRow* first = nullptr;
  size_t count = 0;
};

/// Makes rows of detections of a network's outputs, per kind of outputs. Not thread safe.
class OutputDecoder
{
public:
  /// Copies outputs in the order of Network::forward() to the buffers of the call, which are those of outputs() after
  /// the blob. Needs no decoder: a runtime may keep it for longer.
  using Store = std::function<void(const std::vector<cv::Mat>& outputs, const pi_runtime::NativeCall& call)>;

  virtual ~OutputDecoder() = default;

  /// What the network's task writes.
  virtual std::vector<pi_runtime::BufferPtr> outputs() const = 0;
  virtual Store store() const = 0;
  /// The task that decodes them; none: they are rows already.
  virtual std::optional<pi_runtime::TaskRequest> task() const = 0;
  /// After the tasks have ended; valid until they run again.
  virtual DecodedRows rows() const = 0;
};

/// @param score_threshold  of rows, at least.
std::unique_ptr<OutputDecoder> makeOutputDecoder(const ModelDescription& model, float score_threshold);

}  // namespace pi_detect
