#include <openssl/evp.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <memory>
#include <vector>

#include <pi_detect/model_description.h>

namespace pi_detect
{

std::string sha256OfFile(const std::string& path)
{
  errno = 0;
  std::ifstream file(path, std::ios::binary);
  if (!file)
  {
    throw ModelError(path + ": " + std::strerror(errno));
  }
  const std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)> context(EVP_MD_CTX_new(), EVP_MD_CTX_free);
  bool good = context != nullptr && EVP_DigestInit_ex(context.get(), EVP_sha256(), nullptr) == 1;
  std::vector<char> block(1 << 16);
  while (good && (file.read(block.data(), static_cast<std::streamsize>(block.size())) || file.gcount() > 0))
  {
    good = EVP_DigestUpdate(context.get(), block.data(), static_cast<size_t>(file.gcount())) == 1;
  }
  std::array<unsigned char, EVP_MAX_MD_SIZE> digest{};
  unsigned size = 0;
  if (!good || file.bad() || EVP_DigestFinal_ex(context.get(), digest.data(), &size) != 1)
  {
    throw ModelError(path + ": could not be read to its end");
  }
  constexpr char DIGITS[] = "0123456789abcdef";
  std::string text;
  for (unsigned i = 0; i < size; ++i)
  {
    text += DIGITS[digest[i] >> 4];
    text += DIGITS[digest[i] & 15];
  }
  return text;
}

}  // namespace pi_detect
