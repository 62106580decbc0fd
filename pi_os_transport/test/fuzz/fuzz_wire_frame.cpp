// Headers and payloads of the frames between two bridges.

#include "fuzz_input.h"
#include "wire/wire_frame.h"

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size)
{
  using namespace pi_os_transport;  // NOLINT
  if (size >= FrameHeader::BYTES)
  {
    FrameHeader header;
    if (FrameHeader::decode(data, &header) && header.version == WIRE_VERSION)
    {
      const auto bytes = header.encode();
      require(std::equal(bytes.begin(), bytes.end(), data), "a header is read as what was written");
    }
  }
  const std::vector<uint8_t> payload(data, data + size);
  Hello hello;
  if (Hello::decode(payload.data(), payload.size(), &hello))
  {
    require(hello.encode() == payload, "a greeting is read as what was written");
  }
  LinkOpen open;
  if (LinkOpen::decode(payload.data(), payload.size(), &open))
  {
    require(open.encode() == payload, "LinkOpen is read as what was written");
  }
  PayloadReader in(payload.data(), payload.size());
  while (in.ok())
  {
    LinkEntry::read(&in);
  }
  return 0;
}
