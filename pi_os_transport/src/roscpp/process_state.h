#pragma once

#include <string>

#include "shm/latency_histogram.h"

namespace pi_os_transport
{

/// Everything that the library of this process knows of its links, as JSON: what `pi_os links` and `pi_os doctor` read.
/// Takes roscpp's locks of topics, services and links, one after another. Any thread that holds none of them.
std::string describeProcess();

/// The counts of a histogram as a JSON array.
std::string toJson(const LatencyHistogram::Counts& counts);

}  // namespace pi_os_transport
