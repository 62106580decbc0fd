#pragma once

#include "core/codelet_registry.h"

namespace pi_runtime::kernels
{

/// Adds all kernels of this package with their descriptions.
/// @throws std::invalid_argument if one of their names is taken.
void registerBuiltinCodelets(CodeletRegistry& registry);

}  // namespace pi_runtime::kernels
