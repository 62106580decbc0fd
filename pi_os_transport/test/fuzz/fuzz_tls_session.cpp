// What a device sends before it has proved who it is, and what follows: the bytes of a handshake come as they are, or
// through OpenSSL's own client, which has no key or one of another fleet.

#include <sys/socket.h>

#include <algorithm>
#include <memory>
#include <vector>

#include "fuzz_input.h"
#include "shm/file_descriptor.h"
#include "wire/tls_keys_folder.h"
#include "wire/tls_session.h"

namespace pi_os_transport
{
namespace
{

/// Keys of a bridge: certificates, or shared ones.
const TlsKeys& keysOf(bool shared)
{
  static const TestAuthority fleet = makeTestAuthority();
  static TestKeysFolder certificates;
  static TestKeysFolder ids;
  static const TlsKeys first(certificates.device("vehicle", &fleet, fleet).path());
  static const TlsKeys second(ids.shared("fleet " + std::string(64, 'a')).path());
  return shared ? second : first;
}

void fuzz(FuzzInput input)
{
  int ends[2];
  require(socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0, ends) == 0, "there are sockets");
  const FileDescriptor ours(ends[0]);
  FileDescriptor theirs(ends[1]);
  const bool shared = input.below(2) == 1;
  const auto role = input.below(2) == 1 ? TlsSession::Role::CLIENT : TlsSession::Role::SERVER;
  bool judged = false;
  TlsSession session(&keysOf(shared), ours.get(), role,
                     [&](const std::string& identity)
                     {
                       require(isIdentity(identity), "an identity has few characters");
                       judged = true;
                       return Verdict{};
                     });
  auto step = TlsSession::Step::AWAITS_DATA;
  while (!input.empty() && (step == TlsSession::Step::AWAITS_DATA || step == TlsSession::Step::AWAITS_SPACE))
  {
    const std::vector<uint8_t> bytes = input.bytes(1 + input.below(2000));
    send(theirs.get(), bytes.data(), bytes.size(), MSG_NOSIGNAL);
    step = session.handshake();
    require(step != TlsSession::Step::DONE, "nobody is met who knows no key");
  }
  theirs.reset();
  if (step != TlsSession::Step::FAILED)
  {
    require(session.handshake() == TlsSession::Step::FAILED, "the end of the connection ends the handshake");
  }
  require(judged == false || shared, "no certificate is judged that is not of the fleet");
}

}  // namespace
}  // namespace pi_os_transport

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size)
{
  pi_os_transport::fuzz(pi_os_transport::FuzzInput(data, size));
  return 0;
}
