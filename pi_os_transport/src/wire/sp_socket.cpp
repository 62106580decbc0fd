#include "wire/sp_socket.h"

#include <cerrno>

namespace pi_os_transport
{

CloseReason reasonOf(int error)
{
  switch (error)
  {
    case ECONNREFUSED:
      return CloseReason::REFUSED;
    case ECONNRESET:
    case ECONNABORTED:
    case EPIPE:
      return CloseReason::PEER_CLOSED;
    default:
      return CloseReason::UNREACHABLE;
  }
}

CloseReason reasonOf(const SpReader::Result& result)
{
  switch (result.end)
  {
    case SpReader::End::CLOSED:
      return CloseReason::PEER_CLOSED;
    case SpReader::End::FAILED:
      return reasonOf(result.error);
    default:
      return CloseReason::MALFORMED;
  }
}

}  // namespace pi_os_transport
