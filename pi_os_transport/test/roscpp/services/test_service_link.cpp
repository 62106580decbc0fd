// Both ends of connections to a service in one process, with the threads that a node has: one for the network, one for
// callbacks, some that call. What the sanitizers see of services over shared memory, since nodes are built without
// them.

#include <gtest/gtest.h>
#include <ros/callback_queue.h>
#include <ros/service_callback_helper.h>
#include <ros/service_client_link.h>
#include <ros/service_publication.h>
#include <ros/service_server_link.h>

#include <atomic>
#include <cstring>
#include <memory>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "pi_os_transport/little_endian.h"
#include "roscpp/services/links_without_network.h"
#include "roscpp/services/service_caller.h"
#include "roscpp/services/service_responder.h"
#include "roscpp/services/tcp_calls.h"

namespace pi_os_transport
{
namespace
{

constexpr size_t ANSWER_PREFIX = 5;

/// Answers with the bytes of the request, each plus one.
class Increment : public ros::ServiceCallbackHelper
{
public:
  bool call(ros::ServiceCallbackHelperCallParams& params) override
  {
    const size_t length = params.request.num_bytes;
    params.response.num_bytes = ANSWER_PREFIX + length;
    params.response.buf.reset(new uint8_t[params.response.num_bytes]);
    params.response.buf[0] = 1;
    storeLittleEndian(params.response.buf.get() + 1, static_cast<uint32_t>(length));
    for (size_t i = 0; i < length; ++i)
    {
      params.response.buf[ANSWER_PREFIX + i] = static_cast<uint8_t>(params.request.buf[i] + 1);
    }
    ++calls;
    return true;
  }

  std::atomic<uint64_t> calls{0};
};

ros::SerializedMessage makeRequest(uint32_t length, uint8_t first)
{
  ros::SerializedMessage request(boost::shared_array<uint8_t>(new uint8_t[LENGTH_PREFIX + length]),
                                 LENGTH_PREFIX + length);
  storeLittleEndian(request.buf.get(), length);
  for (uint32_t i = 0; i < length; ++i)
  {
    request.buf[LENGTH_PREFIX + i] = static_cast<uint8_t>(first + i);
  }
  return request;
}

bool isAnswerTo(const ros::SerializedMessage& request, const ros::SerializedMessage& response)
{
  if (response.num_bytes != request.num_bytes - LENGTH_PREFIX)
  {
    return false;
  }
  for (size_t i = 0; i < response.num_bytes; ++i)
  {
    if (response.buf[i] != static_cast<uint8_t>(request.buf[LENGTH_PREFIX + i] + 1))
    {
      return false;
    }
  }
  return true;
}

/// One connection: what both processes have of it.
struct ServiceConnection
{
  explicit ServiceConnection(const ros::ServicePublicationPtr& publication)
  {
    Runtime& runtime = runtimeWithoutPreload();
    client_link->connection_ = server;
    client_link->parent_ = publication;
    server_link->connection_ = client;
    responder = std::make_shared<ServiceResponder>("/service", client_link, server);
    runtime.service_responders.insert(server.get(), responder);
    server->addDropListener([responder = responder](const ros::ConnectionPtr&, ros::Connection::DropReason)
                            { responder->disconnect(); });
    const std::string offer = runtime.expect(
        responder->token(), [responder = responder](const std::shared_ptr<ProcessPair>& pair, const Packet& hello)
        { responder->meet(pair, hello); });
    caller = std::make_shared<ServiceCaller>("/service", client, ServiceCaller::Use::PERSISTENT);
    client->addDropListener(
        [caller = caller, link = server_link](const ros::ConnectionPtr&, ros::Connection::DropReason)
        {
          caller->disconnect();
          endCalls(link.get());
        });
    EXPECT_TRUE(caller->meet(offer));
  }
  ~ServiceConnection()
  {
    client->drop(ros::Connection::TransportDisconnect);
    server->drop(ros::Connection::TransportDisconnect);
    runtimeWithoutPreload().service_responders.erase(server.get());
  }

  ServiceCaller::Outcome call(const ros::SerializedMessage& request, ros::SerializedMessage* response)
  {
    return caller->call(server_link.get(), request, *response);
  }

  const ros::ConnectionPtr client = makeConnection();
  const ros::ConnectionPtr server = makeConnection();
  const boost::shared_ptr<ros::ServiceClientLink> client_link = boost::make_shared<ros::ServiceClientLink>();
  const boost::shared_ptr<ros::ServiceServerLink> server_link =
      boost::make_shared<ros::ServiceServerLink>("/service", true, "*", "*", ros::M_string());
  std::shared_ptr<ServiceResponder> responder;
  std::shared_ptr<ServiceCaller> caller;
};

class ServiceLink : public testing::Test
{
protected:
  ServiceLink()
    : publication_(boost::make_shared<ros::ServicePublication>("/service", "*", "a/S", "a/SRequest", "a/SResponse",
                                                               increment_, &queue_, ros::VoidConstPtr()))
  {
    runtimeWithoutPreload();
    network_ = std::thread(
        [this]
        {
          while (!stopped_)
          {
            ros::PollManager::instance()->getPollSet().update(10);
          }
        });
    spinner_ = std::thread(
        [this]
        {
          while (!stopped_)
          {
            const ros::WallDuration time(0.01);
            if (!QueueWaiter::of(&queue_)->wait(&queue_, time))
            {
              queue_.callAvailable(time);
            }
            queue_.callAvailable(ros::WallDuration());
          }
        });
  }
  ~ServiceLink() override
  {
    stopped_ = true;
    spinner_.join();
    network_.join();
    runNetworkThread();
    queue_.clear();
  }

  /// Each thread calls over a connection of its own until one fails. @return how many calls were answered.
  uint64_t callFrom(const std::vector<std::unique_ptr<ServiceConnection>>& connections, uint32_t most)
  {
    std::atomic<uint64_t> answered{0};
    std::vector<std::thread> callers;
    for (const auto& connection : connections)
    {
      callers.emplace_back(
          [&answered, &connection, most]
          {
            std::mt19937 random(1);
            for (uint32_t i = 0; i < most; ++i)
            {
              // The first one is so large that it waits for the rings.
              const uint32_t length = i % 50 == 0 ? 70000 + random() % 100000 : random() % 500;
              const ros::SerializedMessage request = makeRequest(length, static_cast<uint8_t>(i));
              ros::SerializedMessage response;
              if (connection->call(request, &response) != ServiceCaller::Outcome::SUCCESS)
              {
                return;
              }
              EXPECT_TRUE(isAnswerTo(request, response));
              ++answered;
            }
          });
    }
    for (std::thread& caller : callers)
    {
      caller.join();
    }
    return answered;
  }

  std::vector<std::unique_ptr<ServiceConnection>> connect(size_t count)
  {
    std::vector<std::unique_ptr<ServiceConnection>> connections;
    for (size_t i = 0; i < count; ++i)
    {
      connections.push_back(std::make_unique<ServiceConnection>(publication_));
    }
    return connections;
  }

  ros::CallbackQueue queue_;
  const boost::shared_ptr<Increment> increment_ = boost::make_shared<Increment>();
  const ros::ServicePublicationPtr publication_;
  std::atomic<bool> stopped_{false};
  std::thread network_;
  std::thread spinner_;
};

TEST_F(ServiceLink, AnswersEveryCallOfManyThreads)
{
  EXPECT_EQ(3U * 300U, callFrom(connect(3), 300));
}

TEST_F(ServiceLink, CallsOverOneConnectionTakeTurns)
{
  const ServiceConnection connection(publication_);
  std::vector<std::thread> callers;
  for (uint8_t caller = 0; caller < 3; ++caller)
  {
    callers.emplace_back(
        [&connection, caller]
        {
          for (uint32_t i = 0; i < 100; ++i)
          {
            const ros::SerializedMessage request = makeRequest(70000 + i, static_cast<uint8_t>(caller * 80));
            ros::SerializedMessage response;
            ASSERT_EQ(ServiceCaller::Outcome::SUCCESS,
                      connection.caller->call(connection.server_link.get(), request, response));
            EXPECT_TRUE(isAnswerTo(request, response));
          }
        });
  }
  for (std::thread& caller : callers)
  {
    caller.join();
  }
}

TEST_F(ServiceLink, NoCallHangsWhenTheServerEndsTheConnection)
{
  for (uint64_t round = 0; round < 20; ++round)
  {
    const auto connections = connect(2);
    const uint64_t end_at = increment_->calls + round;  // from while they negotiate to in the middle of calls
    std::atomic<bool> all_failed{false};
    std::thread ending(
        [this, &connections, &all_failed, end_at]
        {
          while (increment_->calls < end_at && !all_failed)
          {
            std::this_thread::yield();
          }
          for (const auto& connection : connections)
          {
            connection->server->drop(ros::Connection::TransportDisconnect);
          }
          for (const auto& connection : connections)
          {
            connection->client->drop(ros::Connection::TransportDisconnect);  // what the network reports at last
          }
        });
    callFrom(connections, 1000000);
    all_failed = true;
    ending.join();
    EXPECT_GE(increment_->calls, end_at);
  }
}

}  // namespace
}  // namespace pi_os_transport

/// In the place of roscpp's, as the hook of the preloaded library is.
void ros::ServiceClientLink::processResponse(bool, const ros::SerializedMessage& response)
{
  const auto responder = pi_os_transport::Runtime::instance().service_responders.find(getConnection().get());
  if (responder)
  {
    responder->respond(response);
  }
}
