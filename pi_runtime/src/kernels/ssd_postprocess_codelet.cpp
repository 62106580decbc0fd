#include <stdexcept>
#include <string>

#include <pi_runtime/kernels/ssd_postprocess.h>
#include "kernels/codelet_arguments.h"
#include "kernels/ssd_work.h"

namespace pi_runtime::kernels
{
namespace
{

constexpr char NAME[] = "ssd_postprocess";
constexpr size_t LOCAL = 16;  ///< priors per group

struct Arguments
{
  SsdShape shape;
  SsdVariances variances;
};

Arguments checkedArguments(const TaskArguments& call)
{
  const auto shape = call.value<SsdShape>(6);
  requireBetween(NAME, "priors", shape.priors, 1, 65536);
  requireBetween(NAME, "classes", shape.classes, 1, 1024);
  requireBetween(NAME, "background", shape.background, -1, shape.classes - 1);
  requireBetween(NAME, "top_k", shape.top_k, 1, INT32_MAX);
  requireBetween(NAME, "keep_top_k", shape.keep_top_k, 1, 1024);
  requireBetween(NAME, "flags", shape.flags, 0, 15);
  if ((shape.flags & SSD_SOFTMAX) != 0 && (shape.flags & SSD_SIGMOID) != 0)
  {
    throw std::invalid_argument(std::string(NAME) + ": flags ask for softmax and sigmoid; choose one");
  }
  if (!(shape.score_threshold > 0.0F && shape.score_threshold <= 1.0F))
  {
    throw std::invalid_argument(std::string(NAME) + ": score_threshold = " + std::to_string(shape.score_threshold) +
                                ", must be above 0 and at most 1");
  }
  const auto priors = static_cast<size_t>(shape.priors);
  requireBytes(call, NAME, 0, "locations", priors * 4 * sizeof(float));
  requireBytes(call, NAME, 1, "confidences", priors * static_cast<size_t>(shape.classes) * sizeof(float));
  requireBytes(call, NAME, 2, "priors", priors * sizeof(SsdPrior));
  requireBytes(call, NAME, 3, "work", ssdWorkBytes(shape));
  requireBytes(call, NAME, 4, "detections", static_cast<size_t>(shape.keep_top_k) * sizeof(SsdDetection));
  requireBytes(call, NAME, 5, "number of detections", sizeof(int32_t));
  requireRange(call, NAME, "one image", 1);
  return {shape, call.value<SsdVariances>(7)};
}

void runNative(const NativeCall& call)
{
  const Arguments arguments = checkedArguments(call);
  *call.buffer<int32_t>(5) =
      postprocessSsd(call.buffer<const float>(0), call.buffer<const float>(1), call.buffer<const SsdPrior>(2),
                     arguments.shape, arguments.variances, call.buffer<void>(3), call.buffer<SsdDetection>(4));
}

void runOpenCl(OpenClCommand& command)
{
  const auto [shape, variances] = checkedArguments(command);
  const cl_mem locations = command.buffer(0);
  const cl_mem confidences = command.buffer(1);
  const cl_mem priors = command.buffer(2);
  const cl_mem work = command.buffer(3);
  const size_t lists = (shape.flags & SSD_CLASS_AGNOSTIC) != 0 ? 1 : static_cast<size_t>(shape.classes);
  command.enqueue("ssd_clear", NdRange(static_cast<size_t>(shape.classes), 1), work, shape);
  command.enqueue("ssd_collect", NdRange(roundUp(static_cast<size_t>(shape.priors), LOCAL), LOCAL), confidences, work,
                  shape, ssdConfidenceBound(shape));
  command.enqueue("ssd_make_heaps", NdRange(lists, 1), work, shape);
  command.enqueue("ssd_suppress", NdRange(1, 1), locations, priors, work, command.buffer(4), command.buffer(5),
                  LocalMemory{lists * sizeof(cl_ulong)}, LocalMemory{lists * sizeof(cl_int)}, shape, variances);
}

}  // namespace

size_t ssdWorkBytes(const SsdShape& shape)
{
  const auto classes = static_cast<size_t>(shape.classes);
  return static_cast<size_t>(shape.keep_top_k) * 4 * sizeof(float) +
         classes * (static_cast<size_t>(shape.priors) * sizeof(uint64_t) + sizeof(int32_t));
}

CodeletPtr ssdPostprocessCodelet()
{
  static const CodeletPtr instance =
      makeKernelCodelet(NAME, runNative, ssd_postprocess_cl,
                        {"ssd_clear", "ssd_collect", "ssd_make_heaps", "ssd_suppress"}, runOpenCl, NOT_SLICEABLE);
  return instance;
}

}  // namespace pi_runtime::kernels
