#pragma once

#include <string>

namespace pi_detect
{

/// An ONNX model with 32 bit floats in place of all 16 bit ones, which OpenCV 4.6 refuses: weights, constants, and the
/// types that inputs, outputs and casts name. Subgraphs included. A model without halves
/// comes back as it is.
/// @param model  content of the file. @throws std::runtime_error if it is no ONNX model or keeps weights in other
/// files.
std::string withFloats(const std::string& model);

}  // namespace pi_detect
