#pragma once

#include <cstdint>

#include <pi_runtime/runtime.h>

/// The mean of each sample and its two neighbours, natively and by OpenCL. Arguments: samples (in), means (out). The
/// range is the number of samples; the first and the last have one neighbour.
pi_runtime::CodeletPtr meanFilter();

/// A run of the filter. @param samples  `count` floats, a multiple of 64: OpenCL works on 64 together. @param means the
/// same size.
pi_runtime::TaskRequest meanFilterTask(const pi_runtime::BufferPtr& samples, const pi_runtime::BufferPtr& means,
                                       uint64_t count);
