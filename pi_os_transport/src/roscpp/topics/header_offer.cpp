#include "roscpp/topics/header_offer.h"

#include <sstream>
#include <utility>

#include "roscpp/runtime.h"

namespace pi_os_transport
{
namespace
{

/// The field that the next connection header written by this thread carries; empty for none.
thread_local std::string next_field;

}  // namespace

std::string HeaderOffer::toString() const
{
  return std::to_string(PROTOCOL_VERSION) + " " + socket.toString() + " " + link.toString();
}

std::optional<HeaderOffer> HeaderOffer::parse(const std::string& text)
{
  std::istringstream fields(text);
  uint32_t version = 0;
  std::string socket_token;
  std::string link_token;
  fields >> version >> socket_token >> link_token;
  const std::optional<Token> socket = Token::fromString(socket_token);
  const std::optional<Token> link = Token::fromString(link_token);
  return version == PROTOCOL_VERSION && socket && link ? std::optional<HeaderOffer>(HeaderOffer{*socket, *link})
                                                       : std::nullopt;
}

std::string HeaderOffer::socketName(const Token& socket)
{
  return "pi_os/" + socket.toString();
}

OfferScope::OfferScope(std::string value)
{
  next_field = std::move(value);
}

OfferScope::~OfferScope()
{
  next_field.clear();
}

bool OfferScope::extend(ros::M_string* fields)
{
  if (next_field.empty() || fields->count("error") != 0)
  {
    return false;
  }
  (*fields)[HEADER_FIELD] = std::exchange(next_field, std::string());
  return true;
}

}  // namespace pi_os_transport
