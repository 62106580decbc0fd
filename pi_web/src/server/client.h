#pragma once

#include "protocol/messages.h"
#include "protocol/requests.h"

#include <cstdint>
#include <string>

namespace pi_web
{

/// A connected client, as its handler sees it. All calls on the server's thread.
class Client
{
public:
  virtual ~Client() = default;

  /// For the log: its address.
  virtual const std::string& name() const = 0;
  virtual bool mayControl() const = 0;
  /// Sends in order, before all data. A client that reads nothing of it is disconnected.
  virtual void answer(OutMessage message) = 0;
  /// Queues a message of a subscription. @param most  that may wait; the newest stay.
  virtual void push(uint32_t lane, OutMessage message, size_t most) = 0;
  virtual void forget(uint32_t lane) = 0;
  /// The client has taken all that was pushed on this lane.
  virtual bool isReady(uint32_t lane) const = 0;
  virtual uint64_t dropped() const = 0;
};

/// What is done with clients and their requests.
class ClientHandler
{
public:
  virtual ~ClientHandler() = default;
  virtual void onOpen(Client* client) = 0;
  /// @throws std::invalid_argument  whose text is sent to the client.
  virtual void onRequest(Client* client, const Request& request) = 0;
  /// The last call for this client.
  virtual void onClose(Client* client) = 0;
};

}  // namespace pi_web
