// A plain roscpp node that the rostests of pi_os_transport steer: it reads commands from stdin and answers each with
// one line of JSON on stdout that starts with '@'. It knows nothing of pi_os_transport, so the same binary shows the
// behaviour of TCPROS without LD_PRELOAD and that of the library with it. transport_harness.py is the other end.
//
//   verb key=value key=value ...        ->  @{"reply":"verb","ok":true,...}
//
// The node ends at "exit", at the end of stdin (the judge died) and at a signal.

#include <malloc.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <sstream>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <boost/make_shared.hpp>

#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <sensor_msgs/Image.h>
#include <std_msgs/Empty.h>
#include <std_msgs/String.h>
#include <std_msgs/UInt8.h>
#include <topic_tools/shape_shifter.h>

#include "peers/message_pattern.h"
#include "peers/peer_verbs.h"

namespace
{
using Clock = std::chrono::steady_clock;

constexpr uint32_t GREETING_ID_OFFSET = 1000;  ///< publisher id of a greeting = id of its publisher + this

// ---------------------------------------------------------------------------------------------------------- messages

struct Decoded
{
  uint32_t id = 0;
  uint64_t seq = 0;
  uint64_t bytes = 0;
  bool intact = true;
};

/// One specialisation per message type: how (id, seq, size) becomes a message and comes back.
template <class M>
struct Payload;

template <>
struct Payload<sensor_msgs::Image>
{
  static void encode(uint32_t id, uint64_t seq, size_t bytes, sensor_msgs::Image* m) { fillImage(id, seq, bytes, m); }
  static Decoded decode(const sensor_msgs::Image& m) { return {m.height, m.width, m.data.size(), isIntact(m)}; }
};

template <>
struct Payload<std_msgs::String>
{
  static std::string text(uint32_t id, uint64_t seq, size_t bytes)
  {
    std::string s = std::to_string(id) + ":" + std::to_string(seq) + ":";
    while (s.size() < bytes)
    {
      s.push_back(static_cast<char>('a' + (seq + s.size()) % 26));
    }
    return s;
  }
  static void encode(uint32_t id, uint64_t seq, size_t bytes, std_msgs::String* m) { m->data = text(id, seq, bytes); }
  static Decoded decode(const std_msgs::String& m)
  {
    Decoded d;
    d.bytes = m.data.size();
    char colon1 = 0;
    char colon2 = 0;
    std::istringstream in(m.data);
    in >> d.id >> colon1 >> d.seq >> colon2;
    d.intact = in && colon1 == ':' && colon2 == ':' && m.data == text(d.id, d.seq, m.data.size());
    return d;
  }
};

template <>
struct Payload<std_msgs::UInt8>
{
  static void encode(uint32_t, uint64_t seq, size_t, std_msgs::UInt8* m) { m->data = static_cast<uint8_t>(seq); }
  static Decoded decode(const std_msgs::UInt8& m) { return {0, m.data, 1, true}; }
};

template <>
struct Payload<std_msgs::Empty>
{
  static void encode(uint32_t, uint64_t, size_t, std_msgs::Empty*) {}
  static Decoded decode(const std_msgs::Empty&) { return {0, 0, 0, true}; }
};

template <>
struct Payload<topic_tools::ShapeShifter>
{
  static Decoded decode(const topic_tools::ShapeShifter& m) { return {0, 0, m.size(), true}; }
};

// -------------------------------------------------------------------------------------------------------- subscriber

/// What one publisher's messages looked like from here.
struct Flow
{
  uint64_t received = 0;
  uint64_t first = 0;
  uint64_t last = 0;
  uint64_t highest = 0;
  uint64_t reordered = 0;  ///< messages with a number at or below one seen before
  uint32_t last_header_seq = 0;
  std::set<uint64_t> missing;  ///< numbers between the first and the highest that have not come

  void add(uint64_t seq)
  {
    if (received++ == 0)
    {
      first = highest = seq;
    }
    else if (seq > highest)
    {
      for (uint64_t s = highest + 1; s < seq; ++s)
      {
        missing.insert(s);
      }
      highest = seq;
    }
    else
    {
      ++reordered;
      missing.erase(seq);
    }
    last = seq;
  }
};

uint32_t headerSeq(const sensor_msgs::Image& m)
{
  return m.header.seq;
}
template <class M>
uint32_t headerSeq(const M&)
{
  return 0;
}

class Inbox
{
public:
  explicit Inbox(const Command& c)
    : hold_(c.flag("hold")), keep_log_(c.flag("log")), unsubscribe_after_(c.integer("unsubscribe_after", 0))
  {
  }

  template <class M>
  void receive(const ros::MessageEvent<M const>& event)
  {
    const int concurrent = ++in_callback_;
    const Decoded d = Payload<M>::decode(*event.getConstMessage());
    std::unique_lock<std::mutex> lock(mutex_);
    most_concurrent_ = std::max(most_concurrent_, concurrent);
    ++received_;
    bytes_ += d.bytes;
    if (d.intact)
    {
      Flow& flow = flows_[d.id];
      flow.add(d.seq);
      flow.last_header_seq = headerSeq(*event.getConstMessage());
      if (keep_log_)
      {
        log_.emplace_back(d.id, d.seq);
      }
    }
    else
    {
      ++corrupt_;
    }
    if (received_ == 1)
    {
      header_ = event.getConnectionHeader();
      publisher_name_ = event.getPublisherName();
    }
    publisher_names_.insert(event.getPublisherName());
    if (unsubscribe_after_ > 0 && received_ == static_cast<uint64_t>(unsubscribe_after_))
    {
      subscriber.shutdown();
    }
    changed_.notify_all();
    changed_.wait(lock, [this] { return !hold_; });
    --in_callback_;
  }

  void hold(bool on)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    hold_ = on;
    changed_.notify_all();
  }

  bool awaitReceived(const Command& c)
  {
    std::unique_lock<std::mutex> lock(mutex_);
    const uint64_t n = static_cast<uint64_t>(c.integer("n", 0));
    return changed_.wait_until(lock, c.deadline(),
                               [&]
                               {
                                 if (!c.has("seq"))
                                 {
                                   return received_ >= n;
                                 }
                                 const auto it = flows_.find(static_cast<uint32_t>(c.integer("id", 1)));
                                 return it != flows_.end() &&
                                        it->second.highest >= static_cast<uint64_t>(c.integer("seq", 0));
                               });
  }

  void reset()
  {
    std::lock_guard<std::mutex> lock(mutex_);
    received_ = bytes_ = corrupt_ = 0;
    flows_.clear();
    log_.clear();
  }

  /// Reports what came from one publisher and begins anew with it.
  void forget(uint32_t id, JsonObject* out)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    const Flow flow = flows_[id];
    flows_.erase(id);
    out->number("received", flow.received).number("lost", flow.missing.size()).number("reordered", flow.reordered);
    out->number("first", flow.first).number("corrupt", corrupt_);
  }

  void report(const Command& c, JsonObject* out)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    out->number("received", received_).number("bytes", bytes_).number("corrupt", corrupt_);
    out->number("most_concurrent", most_concurrent_);
    JsonObject flows;
    for (const auto& [id, flow] : flows_)
    {
      JsonObject f;
      f.number("received", flow.received).number("first", flow.first).number("last", flow.last);
      f.number("highest", flow.highest).number("lost", flow.missing.size()).number("reordered", flow.reordered);
      f.number("last_header_seq", flow.last_header_seq);
      flows.raw(std::to_string(id), f.str());
    }
    out->raw("flows", flows.str());
    out->number("publishers", subscriber.getNumPublishers());
    out->raw("publisher_names", jsonArray(publisher_names_, quoted));
    if (keep_log_)
    {
      out->raw("log",
               jsonArray(log_, [](const std::pair<uint32_t, uint64_t>& entry)
                         { return "[" + std::to_string(entry.first) + "," + std::to_string(entry.second) + "]"; }));
    }
    if (c.flag("header"))
    {
      JsonObject header;
      for (const auto& [key, value] : header_)
      {
        header.text(key, value);
      }
      out->raw("header", header.str()).text("publisher_name", publisher_name_);
    }
  }

  ros::Subscriber subscriber;

private:
  std::mutex mutex_;
  std::condition_variable changed_;
  bool hold_;
  const bool keep_log_;
  const long unsubscribe_after_;
  std::atomic<int> in_callback_{0};
  int most_concurrent_ = 0;
  uint64_t received_ = 0;
  uint64_t bytes_ = 0;
  uint64_t corrupt_ = 0;
  std::map<uint32_t, Flow> flows_;
  std::vector<std::pair<uint32_t, uint64_t>> log_;
  ros::M_string header_;  ///< connection header of the first message
  std::string publisher_name_;
  std::set<std::string> publisher_names_;
};

// --------------------------------------------------------------------------------------------------------- publisher

/// Payload sizes as a function of the sequence number: "sizes=0,1,4096" cycles, "sizes=rand:64:2000000" draws.
class Sizes
{
public:
  explicit Sizes(const std::string& text)
  {
    if (text.rfind("rand:", 0) == 0)
    {
      const size_t colon = text.find(':', 5);
      low_ = std::stoul(text.substr(5, colon - 5));
      high_ = std::stoul(text.substr(colon + 1));
      return;
    }
    std::istringstream in(text);
    for (std::string item; std::getline(in, item, ',');)
    {
      cycle_.push_back(std::stoul(item));
    }
  }
  size_t operator()(uint64_t seq) const
  {
    if (!cycle_.empty())
    {
      return cycle_[seq % cycle_.size()];
    }
    // Log-uniform, so that small and large messages both come often.
    const double unit = static_cast<double>(patternWord(77, seq, 0) >> 11) / 9007199254740992.0;
    return static_cast<size_t>(low_ * std::pow(static_cast<double>(high_) / low_, unit));
  }

private:
  std::vector<size_t> cycle_;
  size_t low_ = 1;
  size_t high_ = 1;
};

class Outbox
{
public:
  explicit Outbox(const Command& c)
    : type(c.text("type", "image")), id(static_cast<uint32_t>(c.integer("id", 1))), greeting_(c.integer("greet", -1))
  {
  }
  ~Outbox() { stop(); }

  template <class M>
  void send(uint32_t sender, uint64_t seq, size_t bytes, bool by_reference)
  {
    auto message = boost::make_shared<M>();
    Payload<M>::encode(sender, seq, bytes, message.get());
    const auto start = Clock::now();
    by_reference ? publisher.publish(*message) : publisher.publish(message);
    const int64_t took = std::chrono::duration_cast<std::chrono::microseconds>(Clock::now() - start).count();
    int64_t slowest = slowest_call_us_;
    while (took > slowest && !slowest_call_us_.compare_exchange_weak(slowest, took))
    {
    }
  }

  /// Starts one thread that publishes; several may run at once on one publisher (id tells them apart).
  void start(const Command& c)
  {
    const uint32_t sender = static_cast<uint32_t>(c.integer("id", id));
    const uint64_t first = static_cast<uint64_t>(c.integer("first", static_cast<long>(last_[sender] + 1)));
    const uint64_t count = static_cast<uint64_t>(c.integer("count", 1));
    const double rate = c.real("rate", 0);
    const bool by_reference = c.flag("by_reference");
    const Sizes sizes(c.text("sizes", "64"));
    if (count != 0)
    {
      last_[sender] = first + count - 1;
    }
    stop_ = false;
    jobs_.emplace_back(
        [=]
        {
          auto next = Clock::now();
          for (uint64_t seq = first; !stop_ && ros::ok() && (count == 0 || seq < first + count); ++seq)
          {
            publishOne(sender, seq, sizes(seq), by_reference);
            published = seq;
            if (rate > 0)
            {
              next += std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(1.0 / rate));
              std::this_thread::sleep_until(next);
            }
          }
        });
  }

  void join()
  {
    for (auto& job : jobs_)
    {
      job.join();
    }
    jobs_.clear();
  }

  void stop()
  {
    stop_ = true;
    join();
    last_[id] = published;
  }

  void connected(const ros::SingleSubscriberPublisher& peer)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    if (greeting_ >= 0)
    {
      sensor_msgs::Image greeting;
      Payload<sensor_msgs::Image>::encode(id + GREETING_ID_OFFSET, ++greetings_, static_cast<size_t>(greeting_),
                                          &greeting);
      peer.publish(greeting);
    }
    connected_.push_back(peer.getSubscriberName());
  }

  void disconnected(const ros::SingleSubscriberPublisher& peer)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    disconnected_.push_back(peer.getSubscriberName());
  }

  void report(JsonObject* out)
  {
    std::lock_guard<std::mutex> lock(mutex_);
    out->number("subscribers", publisher.getNumSubscribers()).number("published", published.load());
    out->raw("connected", jsonArray(connected_, quoted)).raw("disconnected", jsonArray(disconnected_, quoted));
    out->boolean("latched", publisher.isLatched()).number("slowest_call_us", slowest_call_us_.load());
  }

  const std::string type;
  const uint32_t id;
  ros::Publisher publisher;
  std::atomic<uint64_t> published{0};  ///< number of the newest message handed to roscpp

private:
  void publishOne(uint32_t sender, uint64_t seq, size_t bytes, bool by_reference)
  {
    if (type == "image")
    {
      send<sensor_msgs::Image>(sender, seq, bytes, by_reference);
    }
    else if (type == "string")
    {
      send<std_msgs::String>(sender, seq, bytes, by_reference);
    }
    else if (type == "uint8")
    {
      send<std_msgs::UInt8>(sender, seq, bytes, by_reference);
    }
    else
    {
      send<std_msgs::Empty>(sender, seq, bytes, by_reference);
    }
  }

  const long greeting_;
  uint64_t greetings_ = 0;
  std::map<uint32_t, uint64_t> last_;  ///< newest number of each publisher id; a publish goes on behind it
  std::atomic<bool> stop_{false};
  std::atomic<int64_t> slowest_call_us_{0};
  std::vector<std::thread> jobs_;
  std::mutex mutex_;
  std::vector<std::string> connected_;
  std::vector<std::string> disconnected_;
};

// -------------------------------------------------------------------------------------------------------------- node

class Peer
{
public:
  static const Verbs<Peer> VERBS;

  /// A held callback would keep the spinner, and with it the end of the node, waiting.
  void releaseAll()
  {
    for (auto& entry : inboxes_)
    {
      entry.second->hold(false);
    }
  }

private:
  template <class M>
  void advertise(const Command& c, const std::shared_ptr<Outbox>& box)
  {
    Outbox* raw = box.get();
    ros::AdvertiseOptions options;
    options.init<M>(
        c.text("topic"), static_cast<uint32_t>(c.integer("queue", 100)),
        [raw](const ros::SingleSubscriberPublisher& peer) { raw->connected(peer); },
        [raw](const ros::SingleSubscriberPublisher& peer) { raw->disconnected(peer); });
    options.latch = c.flag("latch");
    options.tracked_object = boost::shared_ptr<void>();
    box->publisher = node_.advertise(options);
  }

  bool verbAdvertise(const Command& c, JsonObject*)
  {
    auto box = std::make_shared<Outbox>(c);
    if (box->type == "image")
    {
      advertise<sensor_msgs::Image>(c, box);
    }
    else if (box->type == "string")
    {
      advertise<std_msgs::String>(c, box);
    }
    else if (box->type == "uint8")
    {
      advertise<std_msgs::UInt8>(c, box);
    }
    else if (box->type == "empty")
    {
      advertise<std_msgs::Empty>(c, box);
    }
    else
    {
      throw std::invalid_argument("advertise type=" + box->type + ": must be image, string, uint8 or empty");
    }
    // A callback of a publisher that was shut down may still run, so an outbox lives as long as the node.
    outboxes_[c.text("as", "p")] = box;
    retired_.push_back(box);
    return static_cast<bool>(box->publisher);
  }

  template <class M>
  void subscribe(const Command& c, const std::shared_ptr<Inbox>& box)
  {
    ros::SubscribeOptions options;
    options.template initByFullCallbackType<const ros::MessageEvent<M const>&>(
        c.text("topic"), static_cast<uint32_t>(c.integer("queue", 100)),
        [box](const ros::MessageEvent<M const>& event) { box->receive(event); });
    options.transport_hints = hints(c.text("hints", ""));
    options.allow_concurrent_callbacks = c.flag("concurrent");
    box->subscriber = node_.subscribe(options);
  }

  static ros::TransportHints hints(const std::string& names)
  {
    ros::TransportHints result;
    std::istringstream in(names);
    for (std::string name; std::getline(in, name, ',');)
    {
      if (name == "tcp")
      {
        result.tcp();
      }
      else if (name == "udp")
      {
        result.udp();
      }
      else if (name == "reliable")
      {
        result.reliable();
      }
      else if (name == "unreliable")
      {
        result.unreliable();
      }
      else if (name == "nodelay")
      {
        result.tcpNoDelay();
      }
      else
      {
        throw std::invalid_argument("hints=" + name + ": must be tcp, udp, reliable, unreliable or nodelay");
      }
    }
    return result;
  }

  bool verbSubscribe(const Command& c, JsonObject*)
  {
    auto box = std::make_shared<Inbox>(c);
    inboxes_[c.text("as", "s")] = box;
    const std::string type = c.text("type", "image");
    if (type == "image")
    {
      subscribe<sensor_msgs::Image>(c, box);
    }
    else if (type == "string")
    {
      subscribe<std_msgs::String>(c, box);
    }
    else if (type == "uint8")
    {
      subscribe<std_msgs::UInt8>(c, box);
    }
    else if (type == "empty")
    {
      subscribe<std_msgs::Empty>(c, box);
    }
    else if (type == "any")
    {
      subscribe<topic_tools::ShapeShifter>(c, box);
    }
    else
    {
      throw std::invalid_argument("subscribe type=" + type + ": must be image, string, uint8, empty or any");
    }
    return static_cast<bool>(box->subscriber);
  }

  Outbox& outbox(const Command& c) { return *outboxes_.at(c.text("pub", "p")); }
  Inbox& inbox(const Command& c) { return *inboxes_.at(c.text("sub", "s")); }

  bool verbPublish(const Command& c, JsonObject* out)
  {
    Outbox& box = outbox(c);
    box.start(c);
    if (!c.flag("background"))
    {
      box.join();
      box.report(out);
    }
    return true;
  }
  bool verbJoin(const Command& c, JsonObject* out)
  {
    outbox(c).join();
    outbox(c).report(out);
    return true;
  }
  bool verbStop(const Command& c, JsonObject* out)
  {
    outbox(c).stop();
    outbox(c).report(out);
    return true;
  }
  bool verbPublisher(const Command& c, JsonObject* out)
  {
    outbox(c).report(out);
    return true;
  }
  bool verbUnadvertise(const Command& c, JsonObject*)
  {
    outbox(c).publisher.shutdown();
    return true;
  }
  bool verbAwaitSubscribers(const Command& c, JsonObject* out)
  {
    Outbox& box = outbox(c);
    const uint32_t n = static_cast<uint32_t>(c.integer("n", 1));
    const bool ok = awaitState(c.deadline(), [&] { return box.publisher.getNumSubscribers() == n; });
    box.report(out);
    return ok;
  }
  bool verbAwaitPublished(const Command& c, JsonObject* out)
  {
    Outbox& box = outbox(c);
    const uint64_t n = static_cast<uint64_t>(c.integer("n", 1));
    const bool ok = awaitState(c.deadline(), [&] { return box.published >= n; });
    box.report(out);
    return ok;
  }

  bool verbReport(const Command& c, JsonObject* out)
  {
    inbox(c).report(c, out);
    return true;
  }
  bool verbReset(const Command& c, JsonObject*)
  {
    inbox(c).reset();
    return true;
  }
  bool verbForget(const Command& c, JsonObject* out)
  {
    inbox(c).forget(static_cast<uint32_t>(c.integer("id", 1)), out);
    return true;
  }
  bool verbAwaitReceived(const Command& c, JsonObject* out)
  {
    const bool ok = inbox(c).awaitReceived(c);
    inbox(c).report(c, out);
    return ok;
  }
  bool verbAwaitPublishers(const Command& c, JsonObject* out)
  {
    Inbox& box = inbox(c);
    const uint32_t n = static_cast<uint32_t>(c.integer("n", 1));
    const bool ok = awaitState(c.deadline(), [&] { return box.subscriber.getNumPublishers() == n; });
    box.report(c, out);
    return ok;
  }
  bool verbHold(const Command& c, JsonObject*)
  {
    inbox(c).hold(true);
    return true;
  }
  bool verbRelease(const Command& c, JsonObject*)
  {
    inbox(c).hold(false);
    return true;
  }
  bool verbUnsubscribe(const Command& c, JsonObject*)
  {
    inbox(c).subscriber.shutdown();
    return true;
  }

  /// kind=idle: the child stays in pause() for the judge to end; kind=exec: it runs /bin/sh; kind=exit: it calls _exit.
  bool verbFork(const Command& c, JsonObject* out)
  {
    const std::string kind = c.text("kind");
    const pid_t child = ::fork();
    if (child == 0)
    {
      if (kind == "exec")
      {
        ::execl("/bin/sh", "sh", "-c", "exit 7", static_cast<char*>(nullptr));
      }
      if (kind == "idle")
      {
        for (;;)
        {
          ::pause();
        }
      }
      ::_exit(3);
    }
    out->number("pid", child);
    if (kind != "idle")
    {
      int status = 0;
      ::waitpid(child, &status, 0);
      out->number("status", WIFEXITED(status) ? WEXITSTATUS(status) : -1);
    }
    return child > 0;
  }

  /// trim: returns what the allocator holds in reserve, so that the process's memory is what it uses.
  bool verbTrim(const Command&, JsonObject*)
  {
    ::malloc_trim(0);
    return true;
  }

  ros::NodeHandle node_;
  std::vector<std::shared_ptr<Outbox>> retired_;
  std::map<std::string, std::shared_ptr<Outbox>> outboxes_;
  std::map<std::string, std::shared_ptr<Inbox>> inboxes_;
};

const Verbs<Peer> Peer::VERBS = {
    {"advertise", &Peer::verbAdvertise},
    {"publish", &Peer::verbPublish},
    {"join", &Peer::verbJoin},
    {"stop", &Peer::verbStop},
    {"publisher", &Peer::verbPublisher},
    {"unadvertise", &Peer::verbUnadvertise},
    {"await_subscribers", &Peer::verbAwaitSubscribers},
    {"await_published", &Peer::verbAwaitPublished},
    {"subscribe", &Peer::verbSubscribe},
    {"report", &Peer::verbReport},
    {"reset", &Peer::verbReset},
    {"forget", &Peer::verbForget},
    {"await_received", &Peer::verbAwaitReceived},
    {"await_publishers", &Peer::verbAwaitPublishers},
    {"hold", &Peer::verbHold},
    {"release", &Peer::verbRelease},
    {"unsubscribe", &Peer::verbUnsubscribe},
    {"fork", &Peer::verbFork},
    {"trim", &Peer::verbTrim},
};

}  // namespace

int main(int argc, char** argv)
{
  ros::init(argc, argv, "test_peer");
  const uint32_t threads = argc > 1 ? static_cast<uint32_t>(std::stoul(argv[1])) : 1;
  Peer peer;
  ros::AsyncSpinner spinner(threads);
  spinner.start();
  serveCommands(ros::this_node::getName(), Peer::VERBS, &peer, ros::ok);
  peer.releaseAll();
  ros::shutdown();
  return 0;
}
