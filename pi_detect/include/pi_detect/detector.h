#pragma once

#include <pi_detect/detection_filter.h>
#include <pi_detect/model_check.h>
#include <pi_detect/model_description.h>
#include <pi_detect/picture_view.h>
#include <pi_detect/target.h>
#include <pi_runtime/stage.h>

#include <memory>
#include <string>
#include <vector>

namespace pi_detect
{

struct DetectorOptions
{
  Target target = Target::CPU;
  /// Fail if the target cannot be had. false: another one is used and reported.
  bool require_target = false;
  /// Threads of OpenCV, which has one pool per process; 0: as many as cores, or the stage's where it must be cut.
  int threads = 0;
  /// Load the model in a child process first.
  bool check_model = true;
  ModelCheckOptions check;
  DetectionFilter filter;

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

struct DetectionResult
{
  Detections detections;   ///< best scores first
  double blob_s = 0.0;     ///< picture to network input [s]
  double forward_s = 0.0;  ///< network [s]
  double decode_s = 0.0;   ///< outputs to detections [s]
};

/// Finds objects in pictures with a network.
///
/// With a runtime, a picture is a run of the stage "detection". Where the runtime cannot interrupt it, the network is
/// cut into pieces (cutStages()). With OpenCL, input, network and decoding are tasks instead; if OpenCV uses a GPU, the
/// network's task runs on the unit of the GPU.
///
/// Not thread safe. Buffers are kept, so pictures of one size allocate nothing new.
class Detector
{
public:
  /// Loads, checks and runs the network once. With OpenCL the first time takes seconds, to compile the kernels.
  /// @param runtime  null: everything runs on the calling thread.
  /// @throws ModelError, or std::invalid_argument for options, unknown labels in the filter included.
  Detector(const ModelDescription& model, const DetectorOptions& options, std::shared_ptr<pi_runtime::Runtime> runtime);
  ~Detector();
  Detector(const Detector&) = delete;
  Detector& operator=(const Detector&) = delete;

  /// @throws std::invalid_argument for a picture without pixels or smaller than 2 x 2, std::runtime_error if a task or
  ///         OpenCV fails.
  DetectionResult detect(const PictureView& picture);

  const ModelDescription& model() const;
  const TargetInUse& target() const;
  /// How the runtime has the work. Any thread.
  pi_runtime::StageStatus stage() const;

private:
  class Implementation;
  std::unique_ptr<Implementation> implementation_;
};

}  // namespace pi_detect
