#include "master/registrations.h"

#include <gtest/gtest.h>

namespace pi_os_transport
{
namespace
{

const std::string API = "http://a:1/";
const std::string OTHER_API = "http://b:2/";

TEST(Registrations, ListsProvidersInTheirOrderAndOnce)
{
  Registrations registrations;
  registrations.add(Role::PUBLISHER, "/t", "/z", API);
  registrations.add(Role::PUBLISHER, "/t", "/a", OTHER_API);
  registrations.add(Role::PUBLISHER, "/t", "/z", API);
  EXPECT_EQ((RpcValue::Array{API, OTHER_API}), registrations.apis(Role::PUBLISHER, "/t"));
  EXPECT_EQ((RpcValue::Array{RpcValue::Array{"/t", RpcValue::Array{"/z", "/a"}}}),
            registrations.state(Role::PUBLISHER));
  EXPECT_TRUE(registrations.apis(Role::SUBSCRIBER, "/t").empty());
  EXPECT_TRUE(registrations.apis(Role::PUBLISHER, "/u").empty());
}

TEST(Registrations, ForgetsANodeWithItsLastRegistration)
{
  Registrations registrations;
  registrations.add(Role::PUBLISHER, "/t", "/n", API);
  registrations.add(Role::SUBSCRIBER, "/t", "/n", API);
  EXPECT_EQ(1, registrations.remove(Role::PUBLISHER, "/t", "/n", API).count);
  ASSERT_NE(nullptr, registrations.nodeApi("/n"));
  EXPECT_EQ(API, *registrations.nodeApi("/n"));
  const Registrations::Removal removal = registrations.remove(Role::SUBSCRIBER, "/t", "/n", API);
  EXPECT_EQ(1, removal.count);
  EXPECT_EQ("Unregistered [/n] as provider of [/t]", removal.message);
  EXPECT_EQ(nullptr, registrations.nodeApi("/n"));
  EXPECT_TRUE(registrations.keys(Role::SUBSCRIBER).empty());
}

TEST(Registrations, RemovesOnlyWhatIsRegistered)
{
  Registrations registrations;
  EXPECT_EQ("[/n] is not a registered node", registrations.remove(Role::PUBLISHER, "/t", "/n", API).message);
  registrations.add(Role::PUBLISHER, "/t", "/n", API);
  Registrations::Removal removal = registrations.remove(Role::PUBLISHER, "/t", "/n", OTHER_API);
  EXPECT_EQ(0, removal.count);
  EXPECT_EQ("[/n] is not a known provider of [/t]", removal.message);
  removal = registrations.remove(Role::SERVICE, "/s", "/n", "rosrpc://a:3");
  EXPECT_EQ("[/n] is not a provider of [/s]", removal.message);
  EXPECT_EQ((RpcValue::Array{API}), registrations.apis(Role::PUBLISHER, "/t"));
}

TEST(Registrations, GivesAServiceToTheLastOne)
{
  Registrations registrations;
  registrations.add(Role::SERVICE, "/s", "/n", API, "rosrpc://a:3");
  registrations.add(Role::SERVICE, "/s", "/m", OTHER_API, "rosrpc://b:4");
  ASSERT_NE(nullptr, registrations.serviceApi("/s"));
  EXPECT_EQ("rosrpc://b:4", *registrations.serviceApi("/s"));
  EXPECT_EQ((RpcValue::Array{RpcValue::Array{"/s", RpcValue::Array{"/m"}}}), registrations.state(Role::SERVICE));
  const Registrations::Removal late = registrations.remove(Role::SERVICE, "/s", "/n", "rosrpc://a:3");
  EXPECT_EQ(0, late.count);
  EXPECT_EQ("[rosrpc://a:3] is no longer the current service api handle for [/s]", late.message);
  EXPECT_EQ(1, registrations.remove(Role::SERVICE, "/s", "/m", "rosrpc://b:4").count);
  EXPECT_EQ(nullptr, registrations.serviceApi("/s"));
}

TEST(Registrations, ReplacesTheProcessBehindANode)
{
  Registrations registrations;
  registrations.add(Role::PUBLISHER, "/t", "/n", API);
  registrations.add(Role::PUBLISHER, "/t", "/m", "http://c:3/");
  registrations.add(Role::SUBSCRIBER, "/u", "/n", API);
  registrations.add(Role::SERVICE, "/s", "/n", API, "rosrpc://a:3");
  registrations.add(Role::PARAMETER_SUBSCRIBER, "/p/", "/n", API);
  const auto replaced = registrations.add(Role::PUBLISHER, "/v", "/n", OTHER_API);
  ASSERT_TRUE(replaced.has_value());
  EXPECT_EQ(API, replaced->api);
  EXPECT_EQ((std::vector<std::string>{"/t"}), replaced->topics);
  EXPECT_EQ((RpcValue::Array{"http://c:3/"}), registrations.apis(Role::PUBLISHER, "/t"));
  EXPECT_TRUE(registrations.keys(Role::SUBSCRIBER).empty());
  EXPECT_TRUE(registrations.keys(Role::PARAMETER_SUBSCRIBER).empty());
  EXPECT_EQ(nullptr, registrations.serviceApi("/s"));
  EXPECT_EQ((RpcValue::Array{OTHER_API}), registrations.apis(Role::PUBLISHER, "/v"));
  EXPECT_EQ(OTHER_API, *registrations.nodeApi("/n"));
}

TEST(Registrations, KnowsTheProcessOfANode)
{
  Registrations registrations;
  registrations.add(Role::PUBLISHER, "/t", "/n", API);
  registrations.setPid("/n", OTHER_API, 6);
  registrations.setPid("/n", API, 7);
  registrations.setPid("/m", API, 8);
  EXPECT_TRUE(registrations.isInUse(API));
  EXPECT_FALSE(registrations.isInUse(OTHER_API));
  EXPECT_EQ(7, registrations.add(Role::PUBLISHER, "/t", "/n", OTHER_API)->pid);
  EXPECT_EQ(0, registrations.add(Role::PUBLISHER, "/t", "/n", API)->pid);
}

TEST(Registrations, LeavesAServiceToWhoHasTakenItOver)
{
  Registrations registrations;
  registrations.add(Role::SERVICE, "/s", "/n", API, "rosrpc://a:3");
  registrations.add(Role::SERVICE, "/s", "/m", OTHER_API, "rosrpc://b:4");
  registrations.add(Role::PUBLISHER, "/t", "/n", "http://new:9/");
  ASSERT_NE(nullptr, registrations.serviceApi("/s"));
  EXPECT_EQ("rosrpc://b:4", *registrations.serviceApi("/s"));
  EXPECT_EQ(1U, registrations.providers(Role::SERVICE, "/s").size());
}

}  // namespace
}  // namespace pi_os_transport
