// The fields of connection headers that name sockets and links.

#include "fuzz_input.h"
#include "shm/side_channel.h"

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size)
{
  using pi_os_transport::Token;
  const std::string text(reinterpret_cast<const char*>(data), size);
  if (const std::optional<Token> token = Token::fromString(text))
  {
    std::string lower = text;
    for (char& character : lower)
    {
      character = character >= 'A' && character <= 'F' ? static_cast<char>(character - 'A' + 'a') : character;
    }
    pi_os_transport::require(token->toString() == lower, "a token is read as what was written");
  }
  return 0;
}
