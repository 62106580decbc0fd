#pragma once

#include <pi_detect/model_description.h>

#include <string>

namespace pi_detect
{

struct ModelCheckOptions
{
  double timeout_s = 60.0;     ///< for loading and one forward pass
  int memory_limit_mb = 2048;  ///< address space of the child
  std::string program;         ///< check_model; empty: the one installed beside this library
};

/// Loads a model and runs it once on an empty picture in a child process, since OpenCV can crash on a file that is
/// damaged or malicious, and a crash cannot be caught. Also compares sizes and SHA-256 sums first. Blocks.
/// @throws ModelError with the reason: what is missing, differs or is refused, or the signal that ended the child.
void checkModel(const ModelDescription& model, const ModelCheckOptions& options = ModelCheckOptions());

/// What check_model does: files there, not empty, sums right, network loads, outputs have the shape that the
/// description promises, on an empty picture. In this process. @throws ModelError. May crash.
void checkModelHere(const ModelDescription& model);

}  // namespace pi_detect
