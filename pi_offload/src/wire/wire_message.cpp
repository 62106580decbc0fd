#include "wire/wire_message.h"

#include <pi_os_transport/little_endian.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <set>
#include <type_traits>

namespace pi_offload
{
namespace
{

constexpr uint8_t REQUEST_MAGIC[4] = {'P', 'I', 'R', 'Q'};
constexpr uint8_t REPLY_MAGIC[4] = {'P', 'I', 'R', 'P'};
constexpr size_t MAX_VEHICLE = 64;
constexpr size_t MAX_OPTIONS = 64U << 10U;
constexpr size_t MAX_TEXT = 4096;
constexpr size_t MAX_MODEL = 256;
constexpr size_t MAX_OBJECTS = 10000;
constexpr size_t OBJECT_BYTES = 24;
constexpr size_t MAX_LABELS = 1024;
constexpr size_t MAX_LABEL = 256;
constexpr double INF = std::numeric_limits<double>::infinity();

constexpr uint8_t FLAG_DRAINING = 1;
constexpr uint8_t FLAG_POSITION = 2;
constexpr uint8_t FLAG_SERVED = 4;  ///< of the first kind; the others follow
constexpr uint8_t ALL_FLAGS = (FLAG_SERVED << TASK_KINDS) - 1;

/// Reads field by field; every fault names message and field.
class Reader
{
public:
  Reader(const char* message, const uint8_t* data, size_t size) : message_(message), next_(data), left_(size) {}

  [[noreturn]] void fail(const std::string& what) const { throw WireError(std::string(message_) + ": " + what); }

  const uint8_t* bytes(const char* field, size_t count)
  {
    if (count > left_)
    {
      fail("'" + std::string(field) + "' takes " + std::to_string(count) + " bytes, " + std::to_string(left_) +
           " are left");
    }
    const uint8_t* start = next_;
    next_ += count;
    left_ -= count;
    return start;
  }
  template <typename Number>
  Number number(const char* field)
  {
    return pi_os_transport::loadLittleEndian<Number>(bytes(field, sizeof(Number)));
  }
  uint8_t upTo(const char* field, uint8_t most)
  {
    const auto value = number<uint8_t>(field);
    checkCount(field, value, most);
    return value;
  }
  double real(const char* field, double least, double most)
  {
    const auto bits = number<uint64_t>(field);
    double value;
    std::memcpy(&value, &bits, sizeof(value));
    check(field, value, least, most);
    return value;
  }
  /// Any finite one.
  float real32(const char* field)
  {
    const auto bits = number<uint32_t>(field);
    float value;
    std::memcpy(&value, &bits, sizeof(value));
    check(field, value, -std::numeric_limits<float>::max(), std::numeric_limits<float>::max());
    return value;
  }
  size_t length(const char* field, size_t most)
  {
    const auto value = number<uint32_t>(field);
    checkCount(field, value, most);
    return value;
  }
  std::string text(const char* field, size_t count)
  {
    return std::string(reinterpret_cast<const char*>(bytes(field, count)), count);
  }
  void magicAndVersion(const uint8_t (&magic)[4])
  {
    if (left_ < sizeof(magic) || std::memcmp(next_, magic, sizeof(magic)) != 0)
    {
      fail("no message of this kind (" + std::to_string(left_) + " bytes)");
    }
    bytes("magic", sizeof(magic));
    const auto version = number<uint16_t>("version");
    if (version != WIRE_VERSION)
    {
      fail("version " + std::to_string(version) + ", this is version " + std::to_string(WIRE_VERSION));
    }
  }
  void end() const
  {
    if (left_ != 0)
    {
      fail(std::to_string(left_) + " bytes behind its end");
    }
  }

  void check(const char* field, double value, double least, double most) const
  {
    if (!(value >= least && value <= most))
    {
      fail("'" + std::string(field) + "' = " + std::to_string(value) + ", must be in [" + std::to_string(least) + ", " +
           std::to_string(most) + "]");
    }
  }
  void checkCount(const char* field, uint64_t value, uint64_t most) const
  {
    if (value > most)
    {
      fail("'" + std::string(field) + "' = " + std::to_string(value) + ", must be at most " + std::to_string(most));
    }
  }

private:
  const char* message_;
  const uint8_t* next_;
  size_t left_;
};

class Writer
{
public:
  explicit Writer(size_t size) { bytes_.reserve(size); }
  void bytes(const void* data, size_t count)
  {
    const auto* start = static_cast<const uint8_t*>(data);
    bytes_.insert(bytes_.end(), start, start + count);
  }
  template <typename Number>
  void number(Number value)
  {
    static_assert(std::is_unsigned<Number>::value, "numbers are sent as unsigned ones");
    uint8_t out[sizeof(Number)];
    pi_os_transport::storeLittleEndian(out, value);
    bytes(out, sizeof(out));
  }
  void real(double value)
  {
    uint64_t bits;
    std::memcpy(&bits, &value, sizeof(bits));
    number(bits);
  }
  void real32(float value)
  {
    uint32_t bits;
    std::memcpy(&bits, &value, sizeof(bits));
    number(bits);
  }
  std::vector<uint8_t> take() { return std::move(bytes_); }

private:
  std::vector<uint8_t> bytes_;
};

void checkVehicle(const Reader& reader, const std::string& vehicle)
{
  if (vehicle.empty() || vehicle.size() > MAX_VEHICLE)
  {
    reader.fail("'vehicle' has " + std::to_string(vehicle.size()) + " bytes, must have 1 to " +
                std::to_string(MAX_VEHICLE));
  }
  for (const char letter : vehicle)
  {
    if (letter < 0x21 || letter > 0x7e)
    {
      reader.fail("'vehicle' has a character of code " + std::to_string(static_cast<unsigned char>(letter)) +
                  ", must be of printable ASCII without spaces");
    }
  }
}

void require(bool fine, const char* message, const char* field, const std::string& must)
{
  if (!fine)
  {
    throw std::invalid_argument(std::string(message) + "/" + field + ": must be " + must);
  }
}

bool within(double value, double least)
{
  return value >= least && value < INF;
}

/// The names of classes, each once, in the order of their letters.
std::vector<std::string> labelsOf(const std::vector<DetectedObject>& objects)
{
  std::set<std::string> labels;
  for (const DetectedObject& object : objects)
  {
    labels.insert(object.label);
  }
  return std::vector<std::string>(labels.begin(), labels.end());
}

}  // namespace

std::vector<uint8_t> encode(const OffloadRequest& request)
{
  const auto check = [](bool fine, const char* field, const std::string& must)
  { require(fine, "request", field, must); };
  const auto printable = [](char letter) { return letter >= 0x21 && letter <= 0x7e; };
  check(!request.vehicle.empty() && request.vehicle.size() <= MAX_VEHICLE &&
            std::all_of(request.vehicle.begin(), request.vehicle.end(), printable),
        "vehicle", "1 to 64 printable ASCII characters without spaces");
  check(request.options.size() <= MAX_OPTIONS, "options", "at most " + std::to_string(MAX_OPTIONS) + " bytes");
  check(request.payload.size() <= MAX_PAYLOAD, "payload", "at most " + std::to_string(MAX_PAYLOAD) + " bytes");
  check(within(request.remaining_s, -INF) && std::isfinite(request.remaining_s), "remaining_s", "finite");
  for (const double rate_hz : request.lease_rate_hz)
  {
    check(within(rate_hz, 0.0), "lease_rate_hz", "finite and at least 0");
  }
  check(within(request.speech_s, 0.0), "speech_s", "finite and at least 0");
  Writer out(128 + request.vehicle.size() + request.options.size() + request.payload.size());
  out.bytes(REQUEST_MAGIC, sizeof(REQUEST_MAGIC));
  out.number(WIRE_VERSION);
  out.number(static_cast<uint8_t>(request.type));
  out.number(static_cast<uint8_t>(request.kind));
  out.number(request.request);
  out.number(static_cast<uint64_t>(request.sent_ns));
  out.real(request.remaining_s);
  for (const double rate_hz : request.lease_rate_hz)
  {
    out.real(rate_hz);
  }
  out.real(request.speech_s);
  out.number(static_cast<uint8_t>(request.encoding));
  out.number(static_cast<uint8_t>(request.vehicle.size()));
  out.number(request.width);
  out.number(request.height);
  out.number(static_cast<uint32_t>(request.options.size()));
  out.number(static_cast<uint32_t>(request.payload.size()));
  out.bytes(request.vehicle.data(), request.vehicle.size());
  out.bytes(request.options.data(), request.options.size());
  out.bytes(request.payload.data(), request.payload.size());
  return out.take();
}

OffloadRequest decodeRequest(const uint8_t* data, size_t size)
{
  Reader in("request", data, size);
  in.magicAndVersion(REQUEST_MAGIC);
  OffloadRequest request;
  const auto type = in.number<uint8_t>("type");
  if (type < static_cast<uint8_t>(OffloadRequest::Type::PROBE) ||
      type > static_cast<uint8_t>(OffloadRequest::Type::CANCEL))
  {
    in.fail("'type' = " + std::to_string(type) + ", must be in [1, 3]");
  }
  request.type = static_cast<OffloadRequest::Type>(type);
  request.kind = static_cast<TaskKind>(in.upTo("kind", TASK_KINDS - 1));
  request.request = in.number<uint64_t>("request");
  request.sent_ns = static_cast<int64_t>(in.number<uint64_t>("sent_ns"));
  request.remaining_s = in.real("remaining_s", -std::numeric_limits<double>::max(), std::numeric_limits<double>::max());
  for (double& rate_hz : request.lease_rate_hz)
  {
    rate_hz = in.real("lease_rate_hz", 0.0, std::numeric_limits<double>::max());
  }
  request.speech_s = in.real("speech_s", 0.0, std::numeric_limits<double>::max());
  request.encoding = static_cast<Encoding>(in.upTo("encoding", static_cast<uint8_t>(Encoding::S16LE)));
  const size_t vehicle_bytes = in.upTo("vehicle length", MAX_VEHICLE);
  request.width = in.number<uint32_t>("width");
  request.height = in.number<uint32_t>("height");
  const size_t options_bytes = in.length("options length", MAX_OPTIONS);
  const size_t payload_bytes = in.length("payload length", MAX_PAYLOAD);
  request.vehicle = in.text("vehicle", vehicle_bytes);
  checkVehicle(in, request.vehicle);
  request.options = in.text("options", options_bytes);
  const uint8_t* payload = in.bytes("payload", payload_bytes);
  in.end();
  request.payload.assign(payload, payload + payload_bytes);
  return request;
}

std::vector<uint8_t> encode(const OffloadReply& reply)
{
  const auto check = [](bool fine, const char* field, const std::string& must) { require(fine, "reply", field, must); };
  const NodeAdvertisement& node = reply.advertisement;
  check(within(reply.queue_s, 0.0), "queue_s", "finite and at least 0");
  check(within(reply.service_s, 0.0), "service_s", "finite and at least 0");
  check(std::isfinite(reply.confidence), "confidence", "finite");
  check(within(node.capacity_gcycles, 0.0), "capacity_gcycles", "finite and at least 0");
  check(std::isfinite(node.position.x) && std::isfinite(node.position.y), "position", "finite");
  check(node.range_m >= 0.0, "range_m", "at least 0");
  check(reply.objects.size() <= MAX_OBJECTS, "objects", "at most " + std::to_string(MAX_OBJECTS));
  const std::vector<std::string> labels = labelsOf(reply.objects);
  check(labels.size() <= MAX_LABELS, "objects", "of at most " + std::to_string(MAX_LABELS) + " classes");
  const size_t text_bytes = std::min(reply.text.size(), MAX_TEXT);
  const size_t model_bytes = std::min(reply.model.size(), MAX_MODEL);

  Writer out(256 + text_bytes + model_bytes + reply.objects.size() * OBJECT_BYTES);
  out.bytes(REPLY_MAGIC, sizeof(REPLY_MAGIC));
  out.number(WIRE_VERSION);
  out.number(static_cast<uint8_t>(reply.status));
  out.number(static_cast<uint8_t>(reply.type));
  out.number(reply.request);
  out.number(static_cast<uint8_t>(reply.kind));
  out.number(static_cast<uint8_t>(reply.accepted ? 1 : 0));
  auto flags = static_cast<uint8_t>((node.draining ? FLAG_DRAINING : 0) | (node.has_position ? FLAG_POSITION : 0));
  for (size_t kind = 0; kind < TASK_KINDS; ++kind)
  {
    flags = static_cast<uint8_t>(flags | (node.of_kind[kind].served ? FLAG_SERVED << kind : 0));
  }
  out.number(flags);
  out.number(static_cast<uint8_t>(TASK_KINDS));
  out.real32(reply.confidence);
  out.real(reply.queue_s);
  out.real(reply.service_s);
  out.real(node.capacity_gcycles);
  out.real(node.position.x);
  out.real(node.position.y);
  out.real(node.range_m);
  for (const NodeAdvertisement::OfKind& of : node.of_kind)
  {
    for (const double value : {of.service_s, of.service_deviation_s, of.queue_s, of.lease_until_s, of.lease_rate_hz})
    {
      check(within(value, 0.0), "advertisement", "finite and at least 0");
      out.real(value);
    }
  }
  out.number(static_cast<uint32_t>(reply.objects.size()));
  out.number(static_cast<uint32_t>(text_bytes));
  out.number(static_cast<uint32_t>(model_bytes));
  out.number(static_cast<uint32_t>(labels.size()));
  for (const DetectedObject& object : reply.objects)
  {
    const auto label = std::lower_bound(labels.begin(), labels.end(), object.label);
    out.number(static_cast<uint32_t>(label - labels.begin()));
    for (const float value : {object.score, object.x1, object.y1, object.x2, object.y2})
    {
      check(std::isfinite(value), "objects", "of finite numbers");
      out.real32(value);
    }
  }
  out.bytes(reply.text.data(), text_bytes);
  out.bytes(reply.model.data(), model_bytes);
  for (const std::string& label : labels)
  {
    check(label.size() <= MAX_LABEL, "label", "at most " + std::to_string(MAX_LABEL) + " bytes");
    out.number(static_cast<uint32_t>(label.size()));
    out.bytes(label.data(), label.size());
  }
  return out.take();
}

OffloadReply decodeReply(const uint8_t* data, size_t size)
{
  constexpr double MOST = std::numeric_limits<double>::max();
  Reader in("reply", data, size);
  in.magicAndVersion(REPLY_MAGIC);
  OffloadReply reply;
  NodeAdvertisement& node = reply.advertisement;
  reply.status =
      static_cast<OffloadReply::Status>(in.upTo("status", static_cast<uint8_t>(OffloadReply::Status::EXPIRED)));
  const auto type = in.upTo("type", static_cast<uint8_t>(OffloadRequest::Type::CANCEL));
  if (type < static_cast<uint8_t>(OffloadRequest::Type::PROBE))
  {
    in.fail("'type' = " + std::to_string(type) + ", must be in [1, 3]");
  }
  reply.type = static_cast<OffloadRequest::Type>(type);
  reply.request = in.number<uint64_t>("request");
  reply.kind = static_cast<TaskKind>(in.upTo("kind", TASK_KINDS - 1));
  reply.accepted = in.upTo("accepted", 1) != 0;
  const uint8_t flags = in.upTo("flags", ALL_FLAGS);
  node.draining = (flags & FLAG_DRAINING) != 0;
  node.has_position = (flags & FLAG_POSITION) != 0;
  const auto kinds = in.number<uint8_t>("kinds");
  if (kinds != TASK_KINDS)
  {
    in.fail("'kinds' = " + std::to_string(kinds) + ", must be " + std::to_string(TASK_KINDS));
  }
  reply.confidence = in.real32("confidence");
  reply.queue_s = in.real("queue_s", 0.0, MOST);
  reply.service_s = in.real("service_s", 0.0, MOST);
  node.capacity_gcycles = in.real("capacity_gcycles", 0.0, MOST);
  node.position.x = in.real("x", -MOST, MOST);
  node.position.y = in.real("y", -MOST, MOST);
  node.range_m = in.real("range_m", 0.0, INF);
  for (size_t kind = 0; kind < TASK_KINDS; ++kind)
  {
    NodeAdvertisement::OfKind& of = node.of_kind[kind];
    of.served = (flags & FLAG_SERVED << kind) != 0;
    of.service_s = in.real("advertised service_s", 0.0, MOST);
    of.service_deviation_s = in.real("advertised service_deviation_s", 0.0, MOST);
    of.queue_s = in.real("advertised queue_s", 0.0, MOST);
    of.lease_until_s = in.real("lease_until_s", 0.0, MOST);
    of.lease_rate_hz = in.real("lease_rate_hz", 0.0, MOST);
  }
  const size_t objects = in.length("number of objects", MAX_OBJECTS);
  const size_t text_bytes = in.length("text length", MAX_TEXT);
  const size_t model_bytes = in.length("model length", MAX_MODEL);
  const size_t label_count = in.length("number of labels", MAX_LABELS);
  Reader object("reply", in.bytes("objects", objects * OBJECT_BYTES), objects * OBJECT_BYTES);
  reply.text = in.text("text", text_bytes);
  reply.model = in.text("model", model_bytes);
  std::vector<std::string> labels(label_count);
  for (std::string& label : labels)
  {
    label = in.text("label", in.length("label length", MAX_LABEL));
  }
  in.end();
  std::vector<bool> used(labels.size());
  reply.objects.resize(objects);
  for (DetectedObject& found : reply.objects)
  {
    const auto label = object.number<uint32_t>("label");
    if (label >= labels.size())
    {
      in.fail("'label' = " + std::to_string(label) + ", there are " + std::to_string(labels.size()));
    }
    found.label = labels[label];
    used[label] = true;
    for (float* value : {&found.score, &found.x1, &found.y1, &found.x2, &found.y2})
    {
      *value = object.real32("objects");
    }
  }
  const bool ascending = std::adjacent_find(labels.begin(), labels.end(), std::greater_equal<>()) == labels.end();
  if (!ascending || std::find(used.begin(), used.end(), false) != used.end())
  {
    in.fail("labels must be in the order of their letters, each of an object");
  }
  return reply;
}

}  // namespace pi_offload
