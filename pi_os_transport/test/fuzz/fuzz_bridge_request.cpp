// What a process of this device asks its bridge for.

#include "bridge/bridge_request.h"
#include "fuzz_input.h"

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size)
{
  using pi_os_transport::BridgeRequest;
  BridgeRequest request;
  std::string error;
  const std::vector<uint8_t> packet(data, data + size);
  if (BridgeRequest::decode(packet, &request, &error))
  {
    pi_os_transport::require(request.encode() == packet, "a request is read as what was written");
  }
  else
  {
    pi_os_transport::require(!error.empty(), "a refusal has a reason");
  }
  return 0;
}
