// pi_os_image_codec: compresses and restores images for pi_os_bridge, which starts it and may end it at any time.
//
// usage: pi_os_image_codec MAX_BYTES, with the socket as descriptor 3

#include <fcntl.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <vector>

#include <opencv2/core.hpp>

#include "image_codec/image_conversion.h"

namespace pi_os_transport
{
namespace
{

/// Repeats recv() or send() until all bytes are through. False at the end of the stream.
template <typename Byte, typename Transfer>
bool transferAll(Transfer transfer, Byte* data, size_t length, int flags)
{
  while (length > 0)
  {
    const ssize_t count = TEMP_FAILURE_RETRY(transfer(CODEC_SOCKET, data, length, flags));
    if (count <= 0)
    {
      return false;
    }
    data += count;
    length -= static_cast<size_t>(count);
  }
  return true;
}

bool receiveAll(uint8_t* data, size_t length)
{
  return transferAll(recv, data, length, 0);
}

bool sendAll(const uint8_t* data, size_t length)
{
  return transferAll(send, data, length, MSG_NOSIGNAL);
}

/// Limits the process: address space for a few copies of the largest message, no files, and no output. (libpng and
/// libjpeg write a line to stderr for every damaged image.)
void confine(uint64_t max_bytes)
{
  const int nowhere = open("/dev/null", O_RDWR | O_CLOEXEC);
  for (const int stream : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO})
  {
    dup2(nowhere, stream);
  }
  if (getpriority(PRIO_PROCESS, 0) < 0)
  {
    setpriority(PRIO_PROCESS, 0, 0);  // the bridge is favoured because it computes little
  }
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0);
  prctl(PR_SET_DUMPABLE, 0);
  if (rlim_t pages = 0; std::ifstream("/proc/self/statm") >> pages && pages > 0)
  {
    const rlim_t space = pages * static_cast<rlim_t>(sysconf(_SC_PAGESIZE)) + 6 * max_bytes + (64U << 20);
    const rlimit limit{space, space};
    setrlimit(RLIMIT_AS, &limit);
  }
  const rlimit none{0, 0};
  setrlimit(RLIMIT_CORE, &none);
  setrlimit(RLIMIT_FSIZE, &none);
  setrlimit(RLIMIT_NOFILE, &none);
}

int run(uint64_t max_bytes)
{
  for (;;)
  {
    uint8_t bytes[CodecHeader::BYTES];
    if (!receiveAll(bytes, sizeof(bytes)))
    {
      return 0;
    }
    const CodecHeader request = CodecHeader::decode(bytes);
    if (request.kind < CodecHeader::ENCODE_JPEG || request.kind > CodecHeader::DECODE || request.length > max_bytes)
    {
      return 1;
    }
    std::vector<uint8_t> data(request.length);
    if (!receiveAll(data.data(), data.size()))
    {
      return 0;
    }
    const CodecHeader reply = convertImage(request, &data, max_bytes);
    if (!sendAll(reply.encode().data(), CodecHeader::BYTES) || !sendAll(data.data(), data.size()))
    {
      return 0;
    }
  }
}

}  // namespace
}  // namespace pi_os_transport

int main(int argc, char** argv)
{
  const uint64_t max_bytes = argc == 2 ? std::strtoull(argv[1], nullptr, 10) : 0;
  int type = 0;
  socklen_t length = sizeof(type);
  if (max_bytes == 0 || getsockopt(pi_os_transport::CODEC_SOCKET, SOL_SOCKET, SO_TYPE, &type, &length) != 0)
  {
    std::fputs("pi_os_image_codec: is started by pi_os_bridge, not by hand\n", stderr);
    return 2;
  }
  cv::setNumThreads(1);
  pi_os_transport::confine(max_bytes);
  return pi_os_transport::run(max_bytes);
}
