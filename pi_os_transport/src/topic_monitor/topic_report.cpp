#include "topic_monitor/topic_report.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <iomanip>
#include <sstream>
#include <utility>

#include <nlohmann/json.hpp>

namespace pi_os_transport
{
namespace
{

using Json = nlohmann::ordered_json;

std::string bandwidthText(double bytes_per_second)
{
  static const char* const UNITS[] = {"B/s", "kB/s", "MB/s", "GB/s"};
  size_t unit = 0;
  while (bytes_per_second >= 1000.0 && unit < 3)
  {
    bytes_per_second /= 1000.0;
    ++unit;
  }
  std::ostringstream text;
  text << std::fixed << std::setprecision(bytes_per_second < 10.0 && unit > 0 ? 2 : 1) << bytes_per_second << " "
       << UNITS[unit];
  return text.str();
}

std::string transportText(const std::map<std::string, size_t>& transports)
{
  std::string text;
  for (const auto& [transport, links] : transports)
  {
    text += (text.empty() ? "" : ", ") + transport + (links > 1 ? " x" + std::to_string(links) : "");
  }
  return text.empty() ? "-" : text;
}

}  // namespace

std::string formatTable(const std::vector<TopicReport>& reports)
{
  size_t width = 5;
  for (const TopicReport& report : reports)
  {
    width = std::max(width, report.topic.size());
  }
  std::ostringstream table;
  table << std::left << std::setw(static_cast<int>(width)) << "topic" << std::right << std::setw(9) << "messages"
        << std::setw(9) << "rate/Hz" << std::setw(9) << "p50/ms" << std::setw(9) << "p99/ms" << std::setw(9) << "max/ms"
        << std::setw(6) << "lost" << std::setw(12) << "bandwidth"
        << "  transport\n";
  table << std::fixed;
  for (const TopicReport& report : reports)
  {
    const TopicFigures& figures = report.figures;
    table << std::left << std::setw(static_cast<int>(width)) << report.topic << std::right << std::setw(9)
          << figures.messages << std::setw(9) << std::setprecision(1) << figures.rate_hz << std::setprecision(3);
    for (const double latency_ms : {figures.latency_p50_ms, figures.latency_p99_ms, figures.latency_max_ms})
    {
      if (figures.has_stamps)
      {
        table << std::setw(9) << latency_ms;
      }
      else
      {
        table << std::setw(9) << "-";
      }
    }
    table << std::setw(6) << (figures.has_sequence ? std::to_string(figures.lost) : "-") << std::setw(12)
          << bandwidthText(figures.bytes_per_second) << "  " << transportText(report.transports) << "\n";
  }
  return table.str();
}

std::string formatJson(const std::string& node, double span_s, const std::vector<TopicReport>& reports)
{
  Json topics = Json::object();
  for (const TopicReport& report : reports)
  {
    const TopicFigures& figures = report.figures;
    Json& topic = topics[report.topic];
    topic = {{"type", report.type},        {"messages", figures.messages},
             {"bytes", figures.bytes},     {"span_s", figures.span_s},
             {"rate_hz", figures.rate_hz}, {"bytes_per_second", figures.bytes_per_second},
             {"latency_ms", nullptr},      {"lost", nullptr},
             {"out_of_order", nullptr},    {"transports", report.transports}};
    if (figures.has_stamps)
    {
      topic["latency_ms"] = {{"mean", figures.latency_mean_ms},
                             {"p50", figures.latency_p50_ms},
                             {"p99", figures.latency_p99_ms},
                             {"max", figures.latency_max_ms}};
    }
    if (figures.has_sequence)
    {
      topic["lost"] = figures.lost;
      topic["out_of_order"] = figures.out_of_order;
    }
  }
  const Json json{{"node", node}, {"span_s", span_s}, {"topics", std::move(topics)}};
  return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

std::string writeFileAtomically(const std::string& path, const std::string& content)
{
  const std::string temporary = path + ".tmp" + std::to_string(getpid());
  const auto failure = [&](const char* action)
  {
    const int reason = errno;
    unlink(temporary.c_str());
    return path + ": " + action + " failed: " + std::strerror(reason);
  };
  const int descriptor = open(temporary.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (descriptor < 0)
  {
    return failure("creating");
  }
  for (size_t written = 0; written < content.size();)
  {
    const ssize_t count = write(descriptor, content.data() + written, content.size() - written);
    if (count < 0 && errno != EINTR)
    {
      const std::string reason = failure("writing");
      close(descriptor);
      return reason;
    }
    written += count > 0 ? static_cast<size_t>(count) : 0;
  }
  if (close(descriptor) != 0)
  {
    return failure("writing");
  }
  if (rename(temporary.c_str(), path.c_str()) != 0)
  {
    return failure("renaming");
  }
  return std::string();
}

}  // namespace pi_os_transport
