#pragma once

#include <ros/datatypes.h>

#include <optional>
#include <string>

#include "shm/side_channel.h"

namespace pi_os_transport
{

/// Where the peer of a TCPROS connection finds the shared memory of a link: what the header field tells it.
struct HeaderOffer
{
  Token socket;  ///< of the process that offers
  Token link;

  std::string toString() const;
  /// Empty if `text` is no offer of this version.
  static std::optional<HeaderOffer> parse(const std::string& text);

  /// Name of the abstract socket behind `socket`.
  static std::string socketName(const Token& socket);
};

/// Adds the field to the one connection header that this thread writes during its life.
class OfferScope
{
public:
  explicit OfferScope(std::string value);
  ~OfferScope();
  OfferScope(const OfferScope&) = delete;
  OfferScope& operator=(const OfferScope&) = delete;

  /// Called for each header that is written: adds the field, once, unless `fields` report an error.
  /// @return true if it was added.
  static bool extend(ros::M_string* fields);
};

}  // namespace pi_os_transport
