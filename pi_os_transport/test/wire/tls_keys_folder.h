#pragma once

#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/x509v3.h>
#include <stdlib.h>
#include <sys/stat.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <memory>
#include <stdexcept>
#include <string>

namespace pi_os_transport
{

/// Certificates and keys for tests, as `pi_os keys` makes them, and broken ones.
struct TestAuthority
{
  std::shared_ptr<EVP_PKEY> key;
  std::shared_ptr<X509> certificate;
};

struct TestValidity
{
  long from_s = -3600;  ///< from now
  long to_s = 3600;
};

inline std::shared_ptr<EVP_PKEY> makeTestKey()
{
  return std::shared_ptr<EVP_PKEY>(EVP_EC_gen("P-256"), EVP_PKEY_free);
}

/// @param authority  null: self-signed
inline std::shared_ptr<X509> makeTestCertificate(const std::string& name, EVP_PKEY* key, const TestAuthority* authority,
                                                 bool is_authority, const TestValidity& validity = TestValidity())
{
  static long serial = 1;
  std::shared_ptr<X509> made(X509_new(), X509_free);
  X509_set_version(made.get(), X509_VERSION_3);
  ASN1_INTEGER_set(X509_get_serialNumber(made.get()), serial++);
  X509_gmtime_adj(X509_getm_notBefore(made.get()), validity.from_s);
  X509_gmtime_adj(X509_getm_notAfter(made.get()), validity.to_s);
  X509_set_pubkey(made.get(), key);
  X509_NAME_add_entry_by_txt(X509_get_subject_name(made.get()), "CN", MBSTRING_ASC,
                             reinterpret_cast<const unsigned char*>(name.c_str()), -1, -1, 0);
  X509* const issuer = authority != nullptr ? authority->certificate.get() : made.get();
  X509_set_issuer_name(made.get(), X509_get_subject_name(issuer));
  X509V3_CTX context;
  X509V3_set_ctx(&context, issuer, made.get(), nullptr, nullptr, 0);
  X509_EXTENSION* const extension = X509V3_EXT_conf_nid(nullptr, &context, NID_basic_constraints,
                                                        is_authority ? "critical,CA:TRUE" : "critical,CA:FALSE");
  X509_add_ext(made.get(), extension, -1);
  X509_EXTENSION_free(extension);
  if (X509_sign(made.get(), authority != nullptr ? authority->key.get() : key, EVP_sha256()) == 0)
  {
    throw std::runtime_error("no certificate for " + name);
  }
  return made;
}

inline TestAuthority makeTestAuthority()
{
  TestAuthority made;
  made.key = makeTestKey();
  made.certificate = makeTestCertificate("fleet", made.key.get(), nullptr, true);
  return made;
}

/// A folder of keys, which is removed with this object.
class TestKeysFolder
{
public:
  TestKeysFolder()
  {
    char folder[] = "/tmp/pi_os_test_XXXXXX";
    if (mkdtemp(folder) == nullptr)
    {
      throw std::runtime_error("no folder for keys");
    }
    path_ = folder;
  }
  TestKeysFolder(const TestKeysFolder&) = delete;
  TestKeysFolder& operator=(const TestKeysFolder&) = delete;
  ~TestKeysFolder() { std::filesystem::remove_all(path_); }

  /// @param issuer  of the device's certificate; null: self-signed. @param accepted  by the device
  TestKeysFolder& device(const std::string& name, const TestAuthority* issuer, const TestAuthority& accepted,
                         const TestValidity& validity = TestValidity())
  {
    const std::shared_ptr<EVP_PKEY> key = makeTestKey();
    const std::shared_ptr<X509> certificate = makeTestCertificate(name, key.get(), issuer, false, validity);
    store("device.pem", [&](FILE* file) { PEM_write_X509(file, certificate.get()); });
    store("authority.pem", [&](FILE* file) { PEM_write_X509(file, accepted.certificate.get()); });
    store("device.key",
          [&](FILE* file) { PEM_write_PrivateKey(file, key.get(), nullptr, nullptr, 0, nullptr, nullptr); });
    return *this;
  }
  TestKeysFolder& shared(const std::string& text)
  {
    store("shared.key", [&](FILE* file) { std::fputs(text.c_str(), file); });
    return *this;
  }
  const std::string& path() const { return path_; }

private:
  template <typename Write>
  void store(const std::string& name, Write write)
  {
    const std::string path = path_ + "/" + name;
    const std::unique_ptr<FILE, int (*)(FILE*)> file(std::fopen(path.c_str(), "w"), std::fclose);
    write(file.get());
    chmod(path.c_str(), S_IRUSR | S_IWUSR);
  }

  std::string path_;
};

}  // namespace pi_os_transport
