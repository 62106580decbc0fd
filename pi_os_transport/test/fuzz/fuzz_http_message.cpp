// What comes over the connections of the master: requests of whoever connects, answers of nodes.

#include "fuzz_input.h"
#include "master/http_reader.h"

namespace pi_os_transport
{
namespace
{

constexpr HttpLimits LIMITS{256, 512};

/// Reads message after message. @param most_bytes  handed over at a time; 0: all at once.
std::string read(HttpReader::Kind kind, std::string_view bytes, size_t most_bytes)
{
  std::string seen;
  HttpReader reader(kind, LIMITS);
  while (!bytes.empty() && reader.state() == HttpReader::State::READING)
  {
    const std::string_view part = bytes.substr(0, most_bytes == 0 ? bytes.size() : most_bytes);
    const size_t used = reader.feed(part);
    require(used <= part.size(), "no more is used than was there");
    require(used == part.size() || reader.state() != HttpReader::State::READING, "what is not used is not of it");
    require(reader.body().size() <= LIMITS.body_bytes, "no body is longer than allowed");
    bytes.remove_prefix(used);
    if (reader.state() == HttpReader::State::DONE)
    {
      seen += reader.method() + " " + reader.target() + " " + std::to_string(reader.status()) + " " + reader.body() +
              (reader.keepsAlive() ? " +" : " -") + (reader.expectsContinue() ? "c\n" : "\n");
      reader.reset();
    }
  }
  if (reader.state() == HttpReader::State::READING)
  {
    reader.feedEnd();
    require(reader.state() != HttpReader::State::READING, "the end ends a message");
  }
  const bool failed = reader.state() == HttpReader::State::FAILED;
  require(!failed || !reader.problem().empty(), "a refusal has a reason");
  require(!failed || (reader.status() >= 400 && reader.status() < 500), "a refusal has the status of one");
  return seen + (failed ? "failed" : reader.body());
}

}  // namespace
}  // namespace pi_os_transport

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size)
{
  using namespace pi_os_transport;  // NOLINT
  FuzzInput input(data, size);
  const auto kind = input.below(2) == 0 ? HttpReader::Kind::REQUEST : HttpReader::Kind::RESPONSE;
  const size_t most_bytes = 1 + input.below(40);
  const std::vector<uint8_t> bytes = input.rest();
  const std::string text(bytes.begin(), bytes.end());
  require(read(kind, text, most_bytes) == read(kind, text, 0), "it does not matter in which pieces a message comes");
  return 0;
}
