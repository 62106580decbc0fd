#pragma once

#include <cstddef>
#include <map>
#include <string>
#include <vector>

#include "topic_monitor/topic_statistics.h"

namespace pi_os_transport
{

/// The report of one topic.
struct TopicReport
{
  std::string topic;
  std::string type;                          ///< empty before the first message
  std::map<std::string, size_t> transports;  ///< links by transport, e.g. {"SHMROS", 1}
  TopicFigures figures;
};

/// Fixed-width table for a terminal, one line per topic.
std::string formatTable(const std::vector<TopicReport>& reports);

/// The reports as JSON (RFC 8259), an object with the keys `node`, `span_s` and `topics` (by name).
std::string formatJson(const std::string& node, double span_s, const std::vector<TopicReport>& reports);

/// Writes a temporary file and renames it, so that readers see the old or the new content.
/// @return empty, or the reason of the failure, naming the file
std::string writeFileAtomically(const std::string& path, const std::string& content);

}  // namespace pi_os_transport
