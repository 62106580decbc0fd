// What the monitor reads of foreign topics, and lists of topics.

#include <stdexcept>

#include "fuzz_input.h"
#include "topic_monitor/topic_report.h"

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size)
{
  using namespace pi_os_transport;  // NOLINT
  const std::vector<uint8_t> message(data, data + size);
  TopicStatistics statistics;
  int64_t arrival_ns = 1;
  if (const std::optional<StampedHeader> header = readHeader(message.data(), message.size()))
  {
    statistics.record(arrival_ns, message.size(), arrival_ns - header->stamp_ns, header->seq, "/publisher", 1);
  }
  for (size_t i = 0; i + 8 <= size; i += 8)
  {
    FuzzInput input(data + i, 8);
    const uint32_t seq = input.take<uint32_t>();
    arrival_ns += input.take<uint16_t>();
    statistics.record(arrival_ns, size, input.take<int16_t>(), seq, "/publisher", input.below(2));
  }
  const std::string text(message.begin(), message.end());
  beginsWithHeader(text);
  try
  {
    for (const std::string& topic : parseTopicList(text))
    {
      require(!topic.empty(), "no topic without a name");
    }
  }
  catch (const std::invalid_argument&)
  {
  }
  TopicReport report;
  report.topic = text;
  report.figures = statistics.total();
  formatTable({report});
  formatJson(text, 1.0, {report});
  return 0;
}
