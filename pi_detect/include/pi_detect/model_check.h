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

/// Compares the SHA-256 sums of a model's files, then loads the model and runs it once on an empty picture in a child
/// process: OpenCV can crash on a damaged or malicious file, and a crash cannot be caught. Blocks.
/// @throws ModelError with the reason: what is missing, differs or is refused, or the signal that ended the child.
void checkModel(const ModelDescription& model, const ModelCheckOptions& options = ModelCheckOptions());

/// The same check in this process, as the program check_model does it: files, sums, and the shape of the outputs on an
/// empty picture. May crash. @throws ModelError
void checkModelHere(const ModelDescription& model);

}  // namespace pi_detect
