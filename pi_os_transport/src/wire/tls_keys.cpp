#include "wire/tls_keys.h"

#include <openssl/err.h>
#include <openssl/pem.h>
#include <sys/stat.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <system_error>

#include "wire/tls_session.h"

namespace pi_os_transport
{
namespace
{

constexpr size_t MOST_IDENTITY_BYTES = 64;
constexpr size_t SHARED_KEY_BYTES = 32;
constexpr int MOST_CERTIFICATES = 2;  ///< between a device and its authority
/// Both have SHA-256, which shared keys need.
constexpr char WITH_AES[] = "TLS_AES_128_GCM_SHA256:TLS_CHACHA20_POLY1305_SHA256";
constexpr char WITHOUT_AES[] = "TLS_CHACHA20_POLY1305_SHA256:TLS_AES_128_GCM_SHA256";

[[noreturn]] void refuse(const std::string& path, const std::string& problem)
{
  throw std::runtime_error(path + " " + problem + ". Make keys with: rosrun pi_os_transport pi_os keys init");
}

std::string opensslError()
{
  const unsigned long error = ERR_get_error();
  const char* const reason = ERR_reason_error_string(error);
  ERR_clear_error();
  return reason != nullptr ? reason : "error " + std::to_string(error);
}

bool exists(const std::string& path)
{
  struct stat state
  {
  };
  return stat(path.c_str(), &state) == 0;
}

/// A private key that others can read protects nothing.
void requirePrivate(const std::string& path)
{
  struct stat state
  {
  };
  if (stat(path.c_str(), &state) != 0)
  {
    refuse(path, "cannot be read: " + std::generic_category().message(errno));
  }
  if ((state.st_mode & (S_IRWXG | S_IRWXO)) != 0)
  {
    throw std::runtime_error(path + " can be read or written by others: chmod 600 " + path);
  }
}

bool hasAes()
{
  std::ifstream info("/proc/cpuinfo");
  for (std::string line; std::getline(info, line);)
  {
    if (line.rfind("flags", 0) == 0 || line.rfind("Features", 0) == 0)
    {
      return (line + " ").find(" aes ") != std::string::npos;
    }
  }
  return false;
}

}  // namespace

TlsKeys::TlsKeys(const std::string& folder) : context_(SSL_CTX_new(TLS_method()))
{
  SSL_CTX* const context = context_.get();
  if (context == nullptr || SSL_CTX_set_min_proto_version(context, TLS1_3_VERSION) != 1 ||
      SSL_CTX_set_ciphersuites(context, hasAes() ? WITH_AES : WITHOUT_AES) != 1)
  {
    throw std::runtime_error("OpenSSL cannot do TLS 1.3: " + opensslError());
  }
  // Whole records leave one by one. No tickets: each connection proves its identity anew.
  SSL_CTX_set_mode(context, SSL_MODE_ENABLE_PARTIAL_WRITE | SSL_MODE_ACCEPT_MOVING_WRITE_BUFFER);
  SSL_CTX_set_options(context, SSL_OP_NO_TICKET | SSL_OP_IGNORE_UNEXPECTED_EOF | SSL_OP_PRIORITIZE_CHACHA |
                                   SSL_OP_CIPHER_SERVER_PREFERENCE);
  SSL_CTX_set_num_tickets(context, 0);
  SSL_CTX_set_session_cache_mode(context, SSL_SESS_CACHE_OFF);
  SSL_CTX_set_read_ahead(context, 1);
  SSL_CTX_set_default_read_buffer_len(context, TlsSession::BATCH_BYTES);
  // Also for shared keys: then no certificate is accepted, as there is no authority.
  SSL_CTX_set_verify(context, SSL_VERIFY_PEER | SSL_VERIFY_FAIL_IF_NO_PEER_CERT, TlsSession::onCertificate);
  SSL_CTX_set_verify_depth(context, MOST_CERTIFICATES);
  if (exists(folder + "/device.pem") || !exists(folder + "/shared.key"))
  {
    loadCertificates(folder);
  }
  else
  {
    loadShared(folder + "/shared.key");
  }
}

void TlsKeys::loadCertificates(const std::string& folder)
{
  const std::string authority = folder + "/authority.pem";
  const std::string certificate = folder + "/device.pem";
  const std::string key = folder + "/device.key";
  requirePrivate(key);
  if (SSL_CTX_load_verify_locations(context(), authority.c_str(), nullptr) != 1)
  {
    refuse(authority, "holds no certificate of an authority: " + opensslError());
  }
  if (SSL_CTX_use_certificate_chain_file(context(), certificate.c_str()) != 1)
  {
    refuse(certificate, "holds no certificate: " + opensslError());
  }
  if (SSL_CTX_use_PrivateKey_file(context(), key.c_str(), SSL_FILETYPE_PEM) != 1 ||
      SSL_CTX_check_private_key(context()) != 1)
  {
    refuse(key, "is not the private key of device.pem: " + opensslError());
  }
  identity_ = nameOf(SSL_CTX_get0_certificate(context()));
  if (identity_.empty())
  {
    refuse(certificate, "names no device: its common name must be 1 to 64 letters, digits, '.', '_' or '-'");
  }
}

void TlsKeys::loadShared(const std::string& path)
{
  requirePrivate(path);
  std::ifstream file(path);
  size_t number = 0;
  for (std::string line; std::getline(file, line);)
  {
    ++number;
    std::istringstream words(line);
    std::string id;
    std::string digits;
    if (!(words >> id) || id.front() == '#')
    {
      continue;
    }
    words >> digits;
    long length = 0;
    unsigned char* const bytes = OPENSSL_hexstr2buf(digits.c_str(), &length);
    const std::vector<unsigned char> key(bytes, bytes + (bytes != nullptr ? length : 0));
    OPENSSL_free(bytes);
    ERR_clear_error();
    if (!isIdentity(id) || key.size() != SHARED_KEY_BYTES || !shared_.emplace(id, key).second)
    {
      refuse(path + ":" + std::to_string(number), "is no shared key: it must be a new id and " +
                                                      std::to_string(2 * SHARED_KEY_BYTES) + " hexadecimal digits");
    }
    identity_ = identity_.empty() ? id : identity_;
  }
  if (shared_.empty())
  {
    refuse(path, "holds no key");
  }
  SSL_CTX_set_psk_client_callback(context(), TlsSession::onShowKey);
  SSL_CTX_set_psk_server_callback(context(), TlsSession::onKeyShown);
}

const std::vector<unsigned char>* TlsKeys::sharedKey(const std::string& id) const
{
  const auto found = shared_.find(id);
  return found != shared_.end() ? &found->second : nullptr;
}

std::string nameOf(X509* certificate)
{
  X509_NAME* const subject = X509_get_subject_name(certificate);
  const int index = X509_NAME_get_index_by_NID(subject, NID_commonName, -1);
  if (index < 0 || X509_NAME_get_index_by_NID(subject, NID_commonName, index) >= 0)
  {
    return {};
  }
  unsigned char* text = nullptr;
  const int length = ASN1_STRING_to_UTF8(&text, X509_NAME_ENTRY_get_data(X509_NAME_get_entry(subject, index)));
  const std::string name(text, text + std::max(length, 0));
  OPENSSL_free(text);
  return isIdentity(name) ? name : std::string();
}

bool isIdentity(const std::string& text)
{
  return !text.empty() && text.size() <= MOST_IDENTITY_BYTES &&
         std::all_of(text.begin(), text.end(),
                     [](unsigned char c)
                     { return c < 0x80 && (std::isalnum(c) != 0 || c == '.' || c == '_' || c == '-'); });
}

}  // namespace pi_os_transport
