#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace pi_web
{

struct AccessOptions
{
  std::string token;                     ///< empty: there is none, and nobody controls
  bool token_to_watch = false;           ///< who only watches needs it, too
  bool allow_control = false;            ///< who has the token may publish, call services and set parameters
  std::vector<std::string> host_names;   ///< beside addresses, localhost and the computer's own name
  std::vector<std::string> web_origins;  ///< pages from elsewhere that may connect, as https://app.foxglove.dev
};

/// What a connection may do.
struct Access
{
  std::string refusal;  ///< why not at all; empty: it may watch
  bool control = false;
};

/// Decides by the request's target and headers. A page of another site in the user's browser can reach this computer:
/// so the name in Host must be ours (against names that were made to point here), and the page in Origin, too.
/// @param host, origin  the headers; empty: not there. @param certified  it showed an operator's certificate, which
/// counts as the token.
Access accessOf(const AccessOptions& options, std::string_view target, std::string_view host, std::string_view origin,
                bool certified = false);

/// Of "/path?token=x&...": "x", decoded; "" if there is none.
std::string tokenOf(std::string_view target);

/// Reads the token from its file; makes a random one, readable by the user alone, if the file does not exist.
/// @throws std::runtime_error naming the file and the way out.
std::string tokenOfFile(const std::string& path);

}  // namespace pi_web
