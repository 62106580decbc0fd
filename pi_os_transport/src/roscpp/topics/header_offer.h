#pragma once

#include <ros/datatypes.h>

#include <optional>
#include <string>

#include "shm/side_channel.h"

namespace pi_os_transport
{

/// The header field that tells the peer of a TCPROS connection where to fetch the shared memory of a link.
struct HeaderOffer
{
  Token socket;  ///< of the offering process
  Token link;

  std::string toString() const;
  /// Empty if `text` is not an offer of this version.
  static std::optional<HeaderOffer> parse(const std::string& text);

  /// Name of the abstract socket behind `socket`.
  static std::string socketName(const Token& socket);
};

/// Adds the field to the next connection header that this thread writes while this object lives.
class OfferScope
{
public:
  explicit OfferScope(std::string value);
  ~OfferScope();
  OfferScope(const OfferScope&) = delete;
  OfferScope& operator=(const OfferScope&) = delete;

  /// Called for each header that is written. Adds the field once, unless `fields` report an error.
  /// @return true if it was added.
  static bool extend(ros::M_string* fields);
};

}  // namespace pi_os_transport
