// Parameters and environment variables.

#include "fuzz_input.h"
#include "roscpp/options.h"

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size)
{
  using namespace pi_os_transport;  // NOLINT
  FuzzInput input(data, size);
  Options options;
  std::vector<std::string> errors;
  options.load(
      [&input](const std::string&) -> std::optional<std::string>
      {
        const std::vector<uint8_t> bytes = input.bytes(input.below(40));
        return bytes.empty() ? std::nullopt : std::optional<std::string>(std::string(bytes.begin(), bytes.end()));
      },
      [](const std::string& name) { return name; }, &errors);
  require(options.pool_limit_mb >= 1 && options.pool_limit_mb <= 65536, "the limit of the pool is in its range");
  require(options.min_bytes <= 1000000000, "min_bytes is in its range");
  const std::vector<uint8_t> topic = input.bytes(40);
  options.carries(std::string(topic.begin(), topic.end()));
  return 0;
}
