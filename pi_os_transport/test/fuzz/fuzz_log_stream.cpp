// What comes over the TCPROS connections of the rosout node: headers, and messages of the log.

#include "fuzz_input.h"
#include "rosout/log_message.h"
#include "rosout/tcpros_header.h"

namespace pi_os_transport
{
namespace
{

constexpr size_t MOST_BYTES = 600;

void readHeader(std::string_view part)
{
  if (const std::optional<TcprosHeader> header = decodeTcprosHeader(part))
  {
    const std::string written = encodeTcprosHeader(*header);
    require(decodeTcprosHeader(std::string_view(written).substr(4)) == header, "a header is read as written");
  }
}

void readMessage(std::string_view part)
{
  if (const std::optional<LogMessage> message = readLogMessage(part))
  {
    const size_t texts = message->node.size() + message->text.size() + message->file.size() + message->function.size();
    require(texts <= part.size(), "all texts lie in the message");
    require(formatLogMessage(*message, true).size() > texts, "a line has all texts");
  }
}

/// @param most_bytes  handed over at a time. @return all parts.
std::vector<std::string> read(std::string_view bytes, size_t most_bytes)
{
  std::vector<std::string> parts;
  TcprosReader reader(MOST_BYTES);
  while (!bytes.empty() && !reader.isBroken())
  {
    reader.feed(bytes.substr(0, most_bytes));
    bytes.remove_prefix(std::min(most_bytes, bytes.size()));
    while (const std::optional<std::string_view> part = reader.next())
    {
      require(part->size() <= MOST_BYTES, "no part is longer than allowed");
      readHeader(*part);
      readMessage(*part);
      parts.emplace_back(*part);
    }
  }
  return parts;
}

}  // namespace
}  // namespace pi_os_transport

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size)
{
  using namespace pi_os_transport;  // NOLINT
  FuzzInput input(data, size);
  const size_t most_bytes = 1 + input.below(200);
  const std::vector<uint8_t> bytes = input.rest();
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  readHeader(text);
  readMessage(text);
  require(read(text, most_bytes) == read(text, bytes.size()), "it does not matter in which pieces the bytes come");
  return 0;
}
