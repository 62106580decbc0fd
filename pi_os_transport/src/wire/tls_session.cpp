#include "wire/tls_session.h"

#include <openssl/err.h>
#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <new>
#include <utility>

#include "wire/sp_socket.h"

namespace pi_os_transport
{
namespace
{

constexpr std::array<unsigned char, 5> ORIGIN{'p', 'i', '_', 'o', 's'};
constexpr int FIRST_ALERT = SSL_AD_REASON_OFFSET;  ///< reason codes from here on are alerts of the other end

/// A socket that raises no SIGPIPE, behind a buffer for records.
const BIO_METHOD* socketMethod()
{
  static BIO_METHOD* const method = []
  {
    BIO_METHOD* const made = BIO_meth_new(BIO_get_new_index() | BIO_TYPE_SOURCE_SINK, "pi_os socket");
    BIO_meth_set_write(made, TlsSession::bufferRecord);
    BIO_meth_set_read(made, TlsSession::readSocket);
    BIO_meth_set_ctrl(made, TlsSession::control);
    BIO_meth_set_create(made,
                        [](BIO* bio)
                        {
                          BIO_set_init(bio, 1);
                          return 1;
                        });
    return made;
  }();
  return method;
}

/// What the alert of the other bridge means here.
std::string meaningOf(int alert)
{
  switch (alert)
  {
    case SSL_AD_BAD_CERTIFICATE:
      return "it does not accept this device: its trust and peers must allow the name, and the clocks be right";
    case SSL_AD_CERTIFICATE_REVOKED:
      return "this device is revoked there";
    case SSL_AD_CERTIFICATE_EXPIRED:
      return "the certificate of this device has expired";
    case SSL_AD_UNKNOWN_CA:
      return "the certificate of this device is not of its fleet's authority";
    case SSL_AD_CERTIFICATE_REQUIRED:
      return "this device shows no certificate";
    case SSL_AD_ILLEGAL_PARAMETER:
    case SSL_AD_DECRYPT_ERROR:
      return "its keys are of another fleet, or its shared key is another one";
    case SSL_AD_HANDSHAKE_FAILURE:
      return "it does not know the kind of key, or the key id, of this device";
    default:
      return SSL_alert_desc_string_long(alert);
  }
}

}  // namespace

TlsSession::TlsSession(const TlsKeys* keys, int socket, Role role, Judge judge)
  : keys_(keys), socket_(socket), judge_(std::move(judge)), ssl_(SSL_new(keys->context()))
{
  BIO* const bio = ssl_ != nullptr ? BIO_new(socketMethod()) : nullptr;
  if (bio == nullptr)
  {
    throw std::bad_alloc();
  }
  BIO_set_data(bio, this);
  SSL_set_bio(ssl_.get(), bio, bio);
  SSL_set_app_data(ssl_.get(), this);
  if (role == Role::CLIENT)
  {
    SSL_set_connect_state(ssl_.get());
    return;
  }
  SSL_set_accept_state(ssl_.get());
  // To OpenSSL a shared key is a session, of which a server wants to know the origin.
  SSL_set_session_id_context(ssl_.get(), ORIGIN.data(), ORIGIN.size());
}

TlsSession* TlsSession::of(const SSL* ssl)
{
  return static_cast<TlsSession*>(SSL_get_app_data(ssl));
}

int TlsSession::bufferRecord(BIO* bio, const char* bytes, int count)
{
  auto* const self = static_cast<TlsSession*>(BIO_get_data(bio));
  BIO_clear_retry_flags(bio);
  self->out_.insert(self->out_.end(), bytes, bytes + count);
  return count;
}

long TlsSession::control(BIO* bio, int command, long, void*)
{
  auto* const self = static_cast<TlsSession*>(BIO_get_data(bio));
  switch (command)
  {
    case BIO_CTRL_FLUSH:
      BIO_clear_retry_flags(bio);
      if (self->flush())
      {
        return 1;
      }
      if (errno == EAGAIN)
      {
        BIO_set_retry_write(bio);
      }
      return -1;
    case BIO_CTRL_EOF:
      return BIO_test_flags(bio, BIO_FLAGS_IN_EOF) != 0 ? 1 : 0;
    default:
      return 0;
  }
}

/// @return false if not all records could leave, with errno set; EAGAIN: try again when the socket is writable
bool TlsSession::flush()
{
  while (out_sent_ != out_.size())
  {
    const ssize_t sent = ::send(socket_, out_.data() + out_sent_, out_.size() - out_sent_,
                                MSG_NOSIGNAL | MSG_DONTWAIT | (more_ ? MSG_MORE : 0));
    if (sent < 0)
    {
      errno = isTemporary(errno) ? EAGAIN : errno;
      return false;
    }
    out_sent_ += static_cast<size_t>(sent);
  }
  out_.clear();
  out_sent_ = 0;
  return true;
}

int TlsSession::readSocket(BIO* bio, char* bytes, int count)
{
  const auto* const self = static_cast<TlsSession*>(BIO_get_data(bio));
  BIO_clear_retry_flags(bio);
  const ssize_t received = recv(self->socket_, bytes, static_cast<size_t>(count), MSG_DONTWAIT);
  if (received < 0 && isTemporary(errno))
  {
    BIO_set_retry_read(bio);
  }
  else if (received == 0)
  {
    BIO_set_flags(bio, BIO_FLAGS_IN_EOF);
  }
  return static_cast<int>(received);
}

TlsSession::Step TlsSession::handshake()
{
  ERR_clear_error();
  errno = 0;
  const int result = SSL_do_handshake(ssl_.get());
  if (result == 1)
  {
    const bool is_proved = !identity_.empty() && (!keys_->areShared() || SSL_session_reused(ssl_.get()) == 1);
    problem_ = is_proved ? "" : "it has not proved who it is";
    return is_proved ? Step::DONE : Step::FAILED;
  }
  const int reason = SSL_get_error(ssl_.get(), result);
  if (reason == SSL_ERROR_WANT_READ || reason == SSL_ERROR_WANT_WRITE)
  {
    return reason == SSL_ERROR_WANT_READ ? Step::AWAITS_DATA : Step::AWAITS_SPACE;
  }
  failed(result);
  return Step::FAILED;
}

/// Sets errno and problem() from a failed call. @return what receive() and send() return
ssize_t TlsSession::failed(int result)
{
  const int error = errno;
  switch (SSL_get_error(ssl_.get(), result))
  {
    case SSL_ERROR_WANT_READ:
    case SSL_ERROR_WANT_WRITE:
      errno = EAGAIN;
      return -1;
    case SSL_ERROR_ZERO_RETURN:
      return 0;
    case SSL_ERROR_SYSCALL:
      errno = error != 0 ? error : ECONNRESET;
      return -1;
    default:
      problem_ = problem_.empty() ? describe() : problem_;
      errno = problem_.empty() ? ECONNRESET : EPROTO;
      return -1;
  }
}

/// The error of OpenSSL in words; empty for the end of the connection.
std::string TlsSession::describe()
{
  unsigned long error = ERR_get_error();
  for (unsigned long next = error; next != 0 && ERR_GET_LIB(error) != ERR_LIB_SSL; next = ERR_get_error())
  {
    error = next;  // before it, the reasons that other parts of OpenSSL gave
  }
  const int reason = ERR_GET_REASON(error);
  if (reason >= FIRST_ALERT)
  {
    return "refused by the other bridge: " + meaningOf(reason - FIRST_ALERT);
  }
  switch (reason)
  {
    case SSL_R_CERTIFICATE_VERIFY_FAILED:
      return std::string("its certificate is not accepted: ") +
             X509_verify_cert_error_string(SSL_get_verify_result(ssl_.get()));
    case SSL_R_PEER_DID_NOT_RETURN_A_CERTIFICATE:
      return "it shows no certificate";
    case SSL_R_WRONG_VERSION_NUMBER:
      is_foreign_ = true;
      return "it does not speak TLS: set secure: tls on both devices";
    case SSL_R_UNSUPPORTED_PROTOCOL:
      return "it does not speak TLS 1.3";
    case SSL_R_BINDER_DOES_NOT_VERIFY:
      return "its shared key differs from that of the same id here";
    default:
      break;
  }
  const char* const text = ERR_reason_error_string(error);
  return text != nullptr ? text : "error " + std::to_string(error);
}

ssize_t TlsSession::receivePiece(const iovec& place)
{
  size_t filled = 0;
  while (filled < place.iov_len)
  {
    size_t count = 0;
    ERR_clear_error();
    errno = 0;
    const int result =
        SSL_read_ex(ssl_.get(), static_cast<uint8_t*>(place.iov_base) + filled, place.iov_len - filled, &count);
    if (result != 1)
    {
      return filled != 0 ? static_cast<ssize_t>(filled) : failed(result);
    }
    filled += count;
  }
  return static_cast<ssize_t>(filled);
}

ssize_t TlsSession::receive(const iovec* places, size_t count)
{
  ssize_t total = 0;
  for (size_t place = 0; place < count; ++place)
  {
    const ssize_t received = receivePiece(places[place]);
    if (received <= 0)
    {
      return total != 0 ? total : received;
    }
    total += received;
    if (static_cast<size_t>(received) < places[place].iov_len)
    {
      break;
    }
  }
  return total;
}

/// Writes the record that begins `skipped` bytes into the pieces.
int TlsSession::writeRecord(const iovec* pieces, size_t count, size_t skipped, bool more, size_t* written)
{
  const auto* bytes = static_cast<const uint8_t*>(pieces[0].iov_base) + skipped;
  size_t length = std::min(RECORD_BYTES, pieces[0].iov_len - skipped);
  size_t left = pieces[0].iov_len - skipped;
  if (length < RECORD_BYTES && count > 1)
  {
    std::memcpy(record_.data(), bytes, length);
    bytes = record_.data();
  }
  for (size_t piece = 1; piece < count; ++piece)
  {
    const size_t part = std::min(RECORD_BYTES - length, pieces[piece].iov_len);
    std::memcpy(record_.data() + length, pieces[piece].iov_base, part);
    length += part;
    left += pieces[piece].iov_len;
  }
  more_ = more || length < left;
  return SSL_write_ex(ssl_.get(), bytes, length, written);
}

ssize_t TlsSession::send(const iovec* pieces, size_t count, bool more)
{
  if (!flush())
  {
    return -1;
  }
  size_t piece = 0;
  size_t skipped = 0;
  const auto skip = [&](size_t bytes)
  {
    for (; piece < count && bytes >= pieces[piece].iov_len - skipped; skipped = 0)
    {
      bytes -= pieces[piece++].iov_len - skipped;
    }
    skipped += bytes;
  };
  size_t total = std::exchange(last_record_, 0);
  // If records wait for the socket, the last one counts as not sent: its data come again and ask for the rest.
  const auto wait = [&]
  { return errno == EAGAIN && total > last_record_ ? static_cast<ssize_t>(total - last_record_) : ssize_t{-1}; };
  for (skip(total); piece < count; skip(last_record_))
  {
    ERR_clear_error();
    errno = 0;
    const int result = writeRecord(pieces + piece, count - piece, skipped, more, &last_record_);
    if (result != 1)
    {
      last_record_ = 0;
      failed(result);
      errno = errno == EAGAIN ? EPROTO : errno;  // never: records always find room
      return -1;
    }
    total += last_record_;
    if (out_.size() >= BATCH_BYTES && !flush())
    {
      return wait();
    }
  }
  if (!flush())
  {
    return wait();
  }
  last_record_ = 0;
  return static_cast<ssize_t>(total);
}

/// For each certificate of the chain, the device's own last.
int TlsSession::onCertificate(int is_valid, X509_STORE_CTX* chain)
{
  const auto* const ssl =
      static_cast<const SSL*>(X509_STORE_CTX_get_ex_data(chain, SSL_get_ex_data_X509_STORE_CTX_idx()));
  TlsSession* const self = of(ssl);
  if (is_valid != 1 || X509_STORE_CTX_get_error_depth(chain) != 0)
  {
    return is_valid;
  }
  const std::string name = nameOf(X509_STORE_CTX_get_current_cert(chain));
  const Verdict verdict = name.empty() ? Verdict{"its certificate names no device"} : self->judge_(name);
  if (!verdict.refusal.empty())
  {
    self->problem_ = verdict.refusal;
    X509_STORE_CTX_set_error(chain, verdict.is_revoked ? X509_V_ERR_CERT_REVOKED : X509_V_ERR_CERT_REJECTED);
    return 0;
  }
  self->identity_ = name;
  return 1;
}

unsigned int TlsSession::onShowKey(SSL* ssl, const char*, char* id, unsigned int id_bytes, unsigned char* key,
                                   unsigned int key_bytes)
{
  TlsSession* const self = of(ssl);
  const std::string& own = self->keys_->identity();
  const std::vector<unsigned char>& bytes = *self->keys_->sharedKey(own);
  const Verdict verdict = self->judge_(own);
  if (!verdict.refusal.empty() || own.size() >= id_bytes || bytes.size() > key_bytes)
  {
    self->problem_ = verdict.refusal;
    return 0;
  }
  std::copy(own.begin(), own.end(), id);
  id[own.size()] = '\0';
  std::copy(bytes.begin(), bytes.end(), key);
  self->identity_ = own;
  return static_cast<unsigned int>(bytes.size());
}

unsigned int TlsSession::onKeyShown(SSL* ssl, const char* id, unsigned char* key, unsigned int key_bytes)
{
  TlsSession* const self = of(ssl);
  const std::vector<unsigned char>* const bytes = isIdentity(id) ? self->keys_->sharedKey(id) : nullptr;
  const Verdict verdict = bytes == nullptr ? Verdict{"the id of its shared key is not known here"} : self->judge_(id);
  if (!verdict.refusal.empty() || bytes->size() > key_bytes)
  {
    self->problem_ = verdict.refusal;
    return 0;
  }
  std::copy(bytes->begin(), bytes->end(), key);
  self->identity_ = id;
  return static_cast<unsigned int>(bytes->size());
}

}  // namespace pi_os_transport
