#pragma once

#include <openssl/ssl.h>
#include <sys/types.h>
#include <sys/uio.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "wire/frame_transport.h"
#include "wire/tls_keys.h"

namespace pi_os_transport
{

/// TLS 1.3 on one connected socket that does not block. Data are encrypted in records of 16 KiB, of which four leave
/// together: each departure may wake the receiver.
class TlsSession
{
public:
  enum class Role
  {
    CLIENT,
    SERVER,
  };
  enum class Step
  {
    DONE,
    AWAITS_DATA,   ///< call again when the socket is readable
    AWAITS_SPACE,  ///< call again when the socket is writable
    FAILED,        ///< see problem(); empty if the connection has ended
  };
  using Judge = std::function<Verdict(const std::string& identity)>;

  static constexpr size_t RECORD_BYTES = 16 * 1024;
  static constexpr size_t BATCH_BYTES = 4 * RECORD_BYTES;  ///< sent together at least, and read ahead at most

  /// @param keys  must outlive the session. @param socket  likewise; stays the caller's
  TlsSession(const TlsKeys* keys, int socket, Role role, Judge judge);

  Step handshake();
  /// Like recvmsg() and sendmsg(): number of bytes, 0 at the end, or -1 with errno set. EPROTO: see problem().
  /// Receives as much as there is. Pieces of which not all was sent must come again unchanged.
  ssize_t receive(const iovec* places, size_t count);
  ssize_t send(const iovec* pieces, size_t count, bool more);
  /// Received data wait in the session, which no readable socket tells.
  bool hasPending() const { return SSL_has_pending(ssl_.get()) == 1; }

  /// True if the handshake failed because the other end does not speak TLS.
  bool isForeign() const { return is_foreign_; }

  /// Name or key id of the other device; known after the handshake.
  const std::string& identity() const { return identity_; }
  /// Why the session failed, in words for an operator.
  const std::string& problem() const { return problem_; }

  // For OpenSSL.
  static int onCertificate(int is_valid, X509_STORE_CTX* chain);
  static unsigned int onShowKey(SSL* ssl, const char* hint, char* id, unsigned int id_bytes, unsigned char* key,
                                unsigned int key_bytes);
  static unsigned int onKeyShown(SSL* ssl, const char* id, unsigned char* key, unsigned int key_bytes);
  static int bufferRecord(BIO* bio, const char* bytes, int count);
  static long control(BIO* bio, int command, long number, void* pointer);
  static int readSocket(BIO* bio, char* bytes, int count);

private:
  ssize_t receivePiece(const iovec& place);
  int writeRecord(const iovec* pieces, size_t count, size_t skipped, bool more, size_t* written);
  bool flush();
  ssize_t failed(int result);
  std::string describe();
  static TlsSession* of(const SSL* ssl);

  struct Free
  {
    void operator()(SSL* ssl) const { SSL_free(ssl); }
  };
  const TlsKeys* const keys_;
  const int socket_;
  const Judge judge_;
  std::unique_ptr<SSL, Free> ssl_;
  std::string identity_;
  std::string problem_;
  bool is_foreign_ = false;
  bool more_ = false;                           ///< more follows the record that was written last
  std::vector<uint8_t> out_;                    ///< records that have not left yet
  size_t out_sent_ = 0;                         ///< of those, bytes that have
  size_t last_record_ = 0;                      ///< bytes of data in the last of those records
  std::array<uint8_t, RECORD_BYTES> record_{};  ///< of several pieces
};

}  // namespace pi_os_transport
