#pragma once

#include <openssl/ssl.h>

#include <map>
#include <memory>
#include <string>
#include <vector>

namespace pi_os_transport
{

/// What a device shows to others and accepts from them: its certificate and the fleet's authority, or keys that the
/// fleet shares. `pi_os keys` writes these files:
///
///   authority.pem             certificates of the authorities whose devices are accepted
///   device.pem, device.key    certificate and private key of this device
///   shared.key                lines of "ID HEXADECIMAL"; the first is shown, all are accepted. Used without device.pem
class TlsKeys
{
public:
  /// @throws std::runtime_error naming the file, what is wrong with it and the remedy
  explicit TlsKeys(const std::string& folder);

  /// For TLS 1.3 alone, with mutual proof of identity.
  SSL_CTX* context() const { return context_.get(); }
  /// The device's name in its certificate, or the id of the key that it shows.
  const std::string& identity() const { return identity_; }
  bool areShared() const { return !shared_.empty(); }
  /// Null if the id is unknown.
  const std::vector<unsigned char>* sharedKey(const std::string& id) const;

private:
  void loadCertificates(const std::string& folder);
  void loadShared(const std::string& path);

  struct Free
  {
    void operator()(SSL_CTX* context) const { SSL_CTX_free(context); }
  };
  std::unique_ptr<SSL_CTX, Free> context_;
  std::string identity_;
  std::map<std::string, std::vector<unsigned char>> shared_;
};

/// The common name of a certificate; empty if it has none, several, or one with other characters than A-Z a-z 0-9 . _ -
std::string nameOf(X509* certificate);
bool isIdentity(const std::string& text);

}  // namespace pi_os_transport
