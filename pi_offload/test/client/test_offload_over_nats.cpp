// Vehicles and workers through real nats-servers on loopback.

#include <gtest/gtest.h>
#include <pi_node/child_process.h>
#include <pi_node/durations.h>
#include <pi_node/test_support/temporary_folder.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "client/vehicle_under_test.h"
#include "fleet/nats_server.h"
#include "server/edge_server.h"
#include "wire/nats_socket.h"

namespace pi_offload
{
namespace
{

using How = Outcome::How;
using pi_offload_bench::NatsServer;

/// A worker that answers at once, or holds its tasks until release().
class Worker
{
public:
  explicit Worker(const std::string& server, const NatsOptions& nats = {}, size_t max_queued = 32)
  {
    EdgeServerOptions options;
    options.transport = Transport::NATS;
    options.nats = nats;
    options.nats.servers = {server};
    options.site = "yard";
    options.address = server;
    options.model = "street";
    options.admission.workers = 1;
    options.admission.max_queued = max_queued;
    options.admission.max_queued_per_vehicle = std::min<size_t>(8, max_queued);
    const ExecutorFactory detect = [this]
    {
      return [this](const OffloadRequest&, double*)
      {
        std::unique_lock<std::mutex> lock(mutex_);
        ++begun_;
        changed_.notify_all();
        changed_.wait(lock, [&] { return !hold_; });
        OffloadReply reply;
        reply.objects = {{"car", 0.75F, 10.0F, 20.0F, 30.0F, 40.0F}};
        return reply;
      };
    };
    EdgeServer::Callbacks callbacks;
    callbacks.event = [this](const std::string& text)
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      logged_ += text + "\n";
      changed_.notify_all();
    };
    server_ = std::make_unique<EdgeServer>(options, std::array<ExecutorFactory, TASK_KINDS>{detect, {}}, callbacks);
  }
  ~Worker() { release(); }

  void hold()
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    hold_ = true;
  }
  void release()
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    hold_ = false;
    changed_.notify_all();
  }
  bool waitForBegun(size_t count)
  {
    std::unique_lock<std::mutex> lock(mutex_);
    return changed_.wait_for(lock, std::chrono::duration<double>(TIMEOUT_S), [&] { return begun_ >= count; });
  }
  bool waitForLog(const std::string& part)
  {
    std::unique_lock<std::mutex> lock(mutex_);
    return changed_.wait_for(lock, std::chrono::duration<double>(TIMEOUT_S),
                             [&] { return logged_.find(part) != std::string::npos; });
  }
  std::string logged()
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    return logged_;
  }
  EdgeServer& server() { return *server_; }

private:
  std::mutex mutex_;
  std::condition_variable changed_;
  bool hold_ = false;
  size_t begun_ = 0;
  std::string logged_;
  std::unique_ptr<EdgeServer> server_;
};

OffloadClientOptions overNats(const NatsOptions& nats = {})
{
  OffloadClientOptions options = VehicleUnderTest::usual();
  options.transport = Transport::NATS;
  options.nats = nats;
  return options;
}

TEST(OffloadOverNats, APictureIsAnsweredByTheSitesWorker)
{
  NatsServer nats;
  Worker worker(nats.address());
  VehicleUnderTest vehicle(overNats());
  vehicle.add("yard", nats);
  ASSERT_TRUE(vehicle.waitUntilUsed("yard"));
  const Ended ended = vehicle.end(vehicle.show());
  EXPECT_EQ(How::REMOTE, ended.outcome.how);
  ASSERT_TRUE(ended.reply);
  EXPECT_EQ("car", ended.reply->objects.at(0).label);
  EXPECT_EQ(1u, worker.server().statistics().vehicles);
  EXPECT_EQ("", worker.logged());
}

TEST(OffloadOverNats, WhereNobodyWorksTheVehicleDoesItAtOnce)
{
  NatsServer nats;
  VehicleUnderTest vehicle(overNats());
  vehicle.add("yard", nats);
  ASSERT_TRUE(vehicle.waitUntilLink("yard", true));
  EXPECT_EQ(How::LOCAL, vehicle.end(vehicle.show()).outcome.how);  // the probes said so
}

TEST(OffloadOverNats, ATaskThatFindsNobodyIsTheVehiclesAtOnce)
{
  NatsServer nats;
  Worker worker(nats.address());
  OffloadClientOptions options = overNats();
  options.engine.probe_period_s = 60.0;  // the task must learn it
  options.engine.probe_period_far_s = 60.0;
  options.engine.advertisement_valid_s = 3600.0;
  VehicleUnderTest vehicle(options);
  ASSERT_TRUE(vehicle.until([&] { return worker.server().health().ready; }));
  vehicle.add("yard", nats);
  ASSERT_TRUE(vehicle.waitUntilUsed("yard"));
  ASSERT_TRUE(worker.server().drain(TIMEOUT_S));
  const uint64_t task = vehicle.show();
  const Ended ended = vehicle.end(task);
  EXPECT_EQ(How::FALLBACK, ended.outcome.how);
  EXPECT_LT(pi_node::seconds(ended.outcome.finished_ns - ended.outcome.task.created_ns), 10.0);  // of 20
  EXPECT_EQ(0u, worker.server().statistics().admission.refused);
}

TEST(OffloadOverNats, ABusyWorkerRefusesAndAnotherSiteDoesIt)
{
  NatsServer busy_nats;
  NatsServer idle_nats;
  Worker busy(busy_nats.address(), {}, 1);
  VehicleUnderTest other(
      [&]
      {
        OffloadClientOptions options = overNats();
        options.vehicle = "other";
        return options;
      }());
  other.add("busy", busy_nats);
  ASSERT_TRUE(other.waitUntilUsed("busy"));
  busy.hold();
  const uint64_t running = other.show();
  ASSERT_TRUE(busy.waitForBegun(1));
  Worker idle(idle_nats.address());
  VehicleUnderTest vehicle(overNats());
  vehicle.add("busy", busy_nats);
  vehicle.add("idle", idle_nats);
  ASSERT_TRUE(vehicle.until(
      [&]
      {
        return vehicle.client->call(
            [&](int64_t now_ns)
            {
              const auto nodes = vehicle.client->engine().nodes(now_ns);
              return nodes[0].connected && nodes[1].connected;
            });
      }));
  std::vector<uint64_t> tasks;
  for (int i = 0; i < 8; ++i)
  {
    tasks.push_back(vehicle.show(2.0));
  }
  for (const uint64_t task : tasks)
  {
    EXPECT_TRUE(vehicle.end(task).outcome.by_deadline);
    EXPECT_EQ(1u, vehicle.ends(task));
  }
  EXPECT_TRUE(idle.waitForBegun(1));
  busy.release();
  other.end(running);
}

TEST(OffloadOverNats, AServerThatDiesWithItsTaskLeavesItToTheVehicleAndIsUsedAgain)
{
  NatsServer nats;
  Worker worker(nats.address());
  VehicleUnderTest vehicle(overNats());
  vehicle.add("yard", nats);
  ASSERT_TRUE(vehicle.waitUntilUsed("yard"));
  worker.hold();
  const uint64_t task = vehicle.show();
  ASSERT_TRUE(worker.waitForBegun(1));
  nats.kill();
  EXPECT_EQ(How::FALLBACK, vehicle.end(task).outcome.how);
  EXPECT_TRUE(vehicle.waitForLog("node yard: not connected: "));
  EXPECT_EQ(How::LOCAL, vehicle.end(vehicle.show()).outcome.how);
  EXPECT_TRUE(worker.waitForLog("not connected to NATS: "));
  EXPECT_FALSE(worker.server().health().ready);
  worker.release();
  nats.revive();
  // Until the worker is back too, the server says at once that nobody is there.
  EXPECT_TRUE(vehicle.until([&] { return vehicle.end(vehicle.show()).outcome.how == How::REMOTE; }));
  EXPECT_EQ(1u, vehicle.ends(task));
}

TEST(OffloadOverNats, AWorkerThatIsLateCostsOneFallback)
{
  NatsServer nats;
  Worker worker(nats.address());
  VehicleUnderTest vehicle(overNats());
  vehicle.add("yard", nats);
  ASSERT_TRUE(vehicle.waitUntilUsed("yard"));
  worker.hold();
  const uint64_t task = vehicle.show(1.0);
  ASSERT_TRUE(worker.waitForBegun(1));
  const Ended ended = vehicle.end(task);
  EXPECT_EQ(How::FALLBACK, ended.outcome.how);
  EXPECT_TRUE(ended.outcome.by_deadline);
  worker.release();
  ASSERT_TRUE(vehicle.waitUntilUsed("yard"));
  EXPECT_EQ(How::REMOTE, vehicle.end(vehicle.show()).outcome.how);
  EXPECT_EQ(1u, vehicle.ends(task));
}

TEST(OffloadOverNats, ADrainingWorkerEndsItsTasksAndLeavesNewOnesToOthers)
{
  NatsServer nats;
  Worker first(nats.address());
  VehicleUnderTest vehicle(overNats());
  vehicle.add("yard", nats);
  ASSERT_TRUE(vehicle.waitUntilUsed("yard"));
  first.hold();
  const uint64_t task = vehicle.show();
  ASSERT_TRUE(first.waitForBegun(1));
  Worker second(nats.address());
  ASSERT_TRUE(vehicle.until([&] { return second.server().health().ready; }));
  EXPECT_FALSE(first.server().drain(0.0));
  EXPECT_FALSE(first.server().health().ready);
  first.release();
  EXPECT_TRUE(first.server().drain(TIMEOUT_S));
  EXPECT_EQ(How::REMOTE, vehicle.end(task).outcome.how);
  ASSERT_TRUE(vehicle.waitUntilUsed("yard"));
  EXPECT_EQ(How::REMOTE, vehicle.end(vehicle.show()).outcome.how);
  EXPECT_TRUE(second.waitForBegun(1));
}

TEST(OffloadOverNats, AWorkersSiteThatHasNoneLeftIsServedByItsNeighbour)
{
  const std::string cluster = "max_payload: 8MB\ncluster {name: fleet, listen: \"127.0.0.1:-1\", routes: [";
  NatsServer near(cluster + "]}");
  NatsServer far(cluster + "\"" + near.routes() + "\"]}");
  Worker worker(far.address());
  VehicleUnderTest vehicle(overNats());
  vehicle.add("near", near);
  ASSERT_TRUE(vehicle.waitUntilUsed("near"));
  EXPECT_EQ(How::REMOTE, vehicle.end(vehicle.show()).outcome.how);
}

TEST(OffloadOverNats, APictureAboveMaxPayloadIsTheVehiclesAndReported)
{
  NatsServer nats("max_payload: 1KB");
  Worker worker(nats.address());
  OffloadClientOptions options = overNats();
  options.encoder.mode = PictureMode::RAW;  // 3 kB
  VehicleUnderTest vehicle(options);
  vehicle.add("yard", nats);
  ASSERT_TRUE(vehicle.waitUntilUsed("yard"));
  EXPECT_NE(How::REMOTE, vehicle.end(vehicle.show()).outcome.how);
  EXPECT_TRUE(vehicle.waitForLog("above the server's max_payload = 1024; raise max_payload in its configuration"));
}

TEST(OffloadOverNats, ARequestInTheNameOfAnotherVehicleIsNotDone)
{
  NatsServer nats;
  Worker worker(nats.address());
  NatsRequester::Options options;
  options.connection.nats.servers = {nats.address()};
  options.vehicle = "thief";
  std::mutex mutex;
  std::condition_variable changed;
  bool up = false;
  Requester::Callbacks callbacks;
  callbacks.reply = [](uint32_t, const std::vector<uint8_t>&, int64_t) { ADD_FAILURE() << "it was answered"; };
  callbacks.link = [&](bool is_up, const std::string&)
  {
    const std::lock_guard<std::mutex> lock(mutex);
    up = is_up;
    changed.notify_all();
  };
  NatsRequester requester(options, callbacks);
  {
    std::unique_lock<std::mutex> lock(mutex);
    ASSERT_TRUE(changed.wait_for(lock, std::chrono::duration<double>(TIMEOUT_S), [&] { return up; }));
  }
  OffloadRequest request;
  request.type = OffloadRequest::Type::PROBE;
  request.vehicle = "van";
  for (int i = 0; i < 100 && worker.logged().empty(); ++i)  // until the worker has subscribed
  {
    ASSERT_TRUE(requester.send(1, encode(request)));
    std::unique_lock<std::mutex> lock(mutex);
    changed.wait_for(lock, std::chrono::milliseconds(50), [] { return false; });
  }
  EXPECT_NE(std::string::npos, worker.logged().find("thief calls itself van"));
}

TEST(OffloadOverNats, ConnectsToTheNodesInRangeAndAheadOnly)
{
  std::vector<std::unique_ptr<NatsServer>> servers;
  OffloadClientOptions options = overNats();
  options.max_connections = 2;
  VehicleUnderTest vehicle(options);
  VehicleState state;
  state.known = true;
  state.speed = 3.0;  // to the north
  for (int i = 0; i < 4; ++i)
  {
    servers.push_back(std::make_unique<NatsServer>());
    NodeDescription node;
    node.id = "site_" + std::to_string(i);
    node.address = servers.back()->address();
    node.position = {0.0, 100.0 * i};
    node.range_m = 60.0;
    vehicle.client->call([&](int64_t now_ns) { vehicle.client->setNode(node, now_ns); });
  }
  const auto connected = [&]
  {
    std::string ids;
    for (const auto& [id, link] : vehicle.client->call([&](int64_t) { return vehicle.client->links(); }))
    {
      ids += link.up ? id.substr(5) : "";
    }
    return ids;
  };
  EXPECT_EQ("", connected());  // where it is is not known yet
  const auto drive = [&](double y)
  {
    state.position.y = y;
    vehicle.client->call([&](int64_t) { vehicle.client->engine().setVehicle(state); });
  };
  drive(0.0);
  EXPECT_TRUE(vehicle.until([&] { return connected() == "01"; })) << connected();
  drive(110.0);
  EXPECT_TRUE(vehicle.until([&] { return connected() == "12"; })) << connected();
  drive(900.0);
  EXPECT_TRUE(vehicle.until([&] { return connected().empty(); })) << connected();
}

// ----------------------------------------------------------------------------------------------------------
// certificates

/// A throw-away authority and what it signed.
class Certificates
{
public:
  Certificates()
  {
    run("openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -keyout ca.key -out ca.pem -days 2 "
        "-subj /CN=authority");
    run("openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -keyout other_ca.key -out other_ca.pem "
        "-days 2 -subj /CN=stranger");
    make("server", "ca", "IP:127.0.0.1");
    make("elsewhere", "ca", "DNS:elsewhere.example");
    make("van", "ca", "DNS:van");
    make("yard", "ca", "DNS:yard");
    make("stranger", "other_ca", "DNS:van");
    make("old", "ca", "");
  }
  std::string path(const std::string& name) const { return folder_.path() + "/" + name; }
  NatsOptions of(const std::string& name, const std::string& authority = "ca") const
  {
    return {{}, path(authority + ".pem"), path(name + ".pem"), path(name + ".key")};
  }
  std::string config(const std::string& server = "server") const
  {
    return "max_payload: 8MB\ntls {cert_file: \"" + path(server + ".pem") + "\", key_file: \"" + path(server + ".key") +
           "\", ca_file: \"" + path("ca.pem") + "\", verify: true}";
  }

private:
  /// @param names  empty: the certificate has expired.
  void make(const std::string& name, const std::string& authority, const std::string& names)
  {
    run("openssl req -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -keyout " + name + ".key -out " + name +
        ".csr -subj /CN=" + name);
    if (!names.empty())
    {
      run("echo subjectAltName=" + names + " > ext; openssl x509 -req -in " + name + ".csr -CA " + authority +
          ".pem -CAkey " + authority + ".key -CAcreateserial -days 1 -extfile ext -out " + name + ".pem");
      return;
    }
    run("touch index; openssl ca -batch -config /dev/stdin -cert ca.pem -keyfile ca.key -in " + name + ".csr -out " +
        name +
        ".pem -startdate 20200101000000Z -enddate 20200201000000Z <<E\n[ca]\ndefault_ca=d\n[d]\ndatabase=index\n"
        "new_certs_dir=.\nrand_serial=yes\ndefault_md=sha256\npolicy=p\n[p]\ncommonName=supplied\nE");
  }
  void run(const std::string& command)
  {
    const pi_node::ChildResult result =
        pi_node::runChild("/bin/sh", {"-ec", "cd " + folder_.path() + "; " + command}, {});
    if (result.status != 0)
    {
      throw std::runtime_error(command + ": " + result.output);
    }
  }
  const pi_node::test_support::TemporaryFolder folder_;
};

class OffloadOverTls : public ::testing::Test
{
protected:
  static void SetUpTestSuite() { certificates_ = std::make_unique<Certificates>(); }
  static void TearDownTestSuite() { certificates_.reset(); }
  static std::unique_ptr<Certificates> certificates_;
};

std::unique_ptr<Certificates> OffloadOverTls::certificates_;

std::string problemOf(const std::function<void()>& function)
{
  try
  {
    function();
  }
  catch (const std::invalid_argument& error)
  {
    return error.what();
  }
  return "";
}

TEST_F(OffloadOverTls, BothEndsShowTheirCertificates)
{
  NatsServer nats(certificates_->config());
  Worker worker(nats.address(), certificates_->of("yard"));
  VehicleUnderTest vehicle(overNats(certificates_->of("van")));
  vehicle.add("yard", nats);
  ASSERT_TRUE(vehicle.waitUntilUsed("yard"));
  EXPECT_EQ(How::REMOTE, vehicle.end(vehicle.show()).outcome.how);
}

TEST_F(OffloadOverTls, AVehicleOfAnotherAuthorityIsNotLetInAndSaysSo)
{
  NatsServer nats(certificates_->config());
  VehicleUnderTest vehicle(overNats(certificates_->of("stranger")));
  vehicle.add("yard", nats);
  EXPECT_TRUE(vehicle.waitForLog("node yard: not connected: "));
  EXPECT_FALSE(vehicle.client->call([&](int64_t) { return vehicle.client->links().at("yard").up; }));
  EXPECT_EQ(How::LOCAL, vehicle.end(vehicle.show()).outcome.how);
}

TEST_F(OffloadOverTls, AServerOfAnotherAuthorityOrNameOrTimeIsNotTrusted)
{
  for (const auto& [server, authority] :
       {std::pair("server", "other_ca"), std::pair("elsewhere", "ca"), std::pair("old", "ca")})
  {
    NatsServer nats(certificates_->config(server));
    VehicleUnderTest vehicle(overNats(certificates_->of("van", authority)));
    vehicle.add("yard", nats);
    EXPECT_TRUE(vehicle.waitForLog("SSL handshake error")) << server;
    EXPECT_EQ(How::LOCAL, vehicle.end(vehicle.show()).outcome.how);
  }
}

TEST_F(OffloadOverTls, WithoutTlsNoVehicleIsLetIn)
{
  NatsServer nats(certificates_->config());
  VehicleUnderTest vehicle(overNats());
  vehicle.add("yard", nats);
  EXPECT_TRUE(vehicle.waitForLog("node yard: not connected: "));
  EXPECT_EQ(How::LOCAL, vehicle.end(vehicle.show()).outcome.how);
}

TEST_F(OffloadOverTls, WrongFilesAndPlacesAreNamed)
{
  NatsOptions options = certificates_->of("old");
  EXPECT_EQ("nats/certificate_file = \"" + options.certificate_file + "\", has expired; make a new certificate",
            problemOf([&] { options.validate(); }));
  options = certificates_->of("van");
  options.validate();
  options.key_file = certificates_->path("none.key");
  EXPECT_EQ("nats/key_file = \"" + options.key_file + "\", cannot be read: No such file or directory",
            problemOf([&] { options.validate(); }));
  options.key_file = "";
  EXPECT_EQ("nats/key_file = \"\", must be set if one of ca_file, certificate_file and key_file is",
            problemOf([&] { options.validate(); }));
  options = certificates_->of("van");
  options.ca_file = options.key_file;
  EXPECT_EQ("nats/ca_file = \"" + options.ca_file + "\", must be a certificate in PEM format",
            problemOf([&] { options.validate(); }));
  options = NatsOptions();
  options.servers = {"10.0.0.17:4222"};
  EXPECT_EQ(
      "nats/servers = \"10.0.0.17:4222\", must be on the loopback interface unless ca_file, certificate_file and "
      "key_file are set",
      problemOf([&] { options.validate(); }));
  VehicleUnderTest vehicle(overNats());
  EXPECT_EQ(
      "node yard: address = \"10.0.0.17:4222\", must be on the loopback interface unless ca_file, "
      "certificate_file and key_file are set",
      problemOf([&] { vehicle.add("yard", std::string("10.0.0.17:4222")); }));
  OffloadClientOptions dotted = overNats();
  dotted.vehicle = "van.7";
  EXPECT_EQ("vehicle = \"van.7\", must be without spaces, '.', '*' and '>' for transport nats",
            problemOf([&] { VehicleUnderTest{dotted}; }));
}

}  // namespace
}  // namespace pi_offload
