#include "ros/runtime_services.h"

#include <pi_node/child_process.h>

#include <algorithm>
#include <cstdio>
#include <stdexcept>

#include "ros/conversions.h"

namespace pi_runtime
{
namespace
{

/// Runs an action; the text of an exception becomes the message of the response.
template <typename Response, typename Action>
bool answer(Response& response, const Action& action)
{
  try
  {
    action();
    response.success = true;
  }
  catch (const std::exception& error)
  {
    response.success = false;
    response.message = error.what();
  }
  return true;
}

/// @param trace_path  file that Runtime::writeTrace() has written.
/// @param keep  false: removes that file.
void drawGantt(const std::string& trace_path, bool keep, const std::string& picture_path)
{
  const pi_node::ChildResult drawing =
      pi_node::runChild("/usr/bin/env", {"rosrun", "pi_runtime", "draw_gantt", trace_path, picture_path}, {});
  if (!keep)
  {
    std::remove(trace_path.c_str());
  }
  if (!drawing.in_time || drawing.status != 0)
  {
    const std::string reason =
        drawing.in_time ? drawing.output : "it took longer than 60 s; use a smaller trace_capacity";
    throw std::runtime_error("gantt_path " + picture_path + " cannot be drawn: " + reason);
  }
}

}  // namespace

RuntimeServices::RuntimeServices(ros::NodeHandle private_node, std::shared_ptr<Runtime> runtime,
                                 const CodeletRegistry* codelets)
  : runtime_(std::move(runtime)), codelets_(codelets)
{
  const auto advertise = [this, &private_node](const char* name, auto handler)
  { services_.push_back(private_node.advertiseService(name, handler, this)); };
  advertise("list_units", &RuntimeServices::listUnits);
  advertise("list_codelets", &RuntimeServices::listCodelets);
  advertise("get_etc", &RuntimeServices::getEtc);
  advertise("set_etc", &RuntimeServices::setEtc);
  advertise("get_policy", &RuntimeServices::getPolicy);
  advertise("set_policy", &RuntimeServices::setPolicy);
  advertise("admit_stream", &RuntimeServices::admitStream);
  advertise("retire_stream", &RuntimeServices::retireStream);
  advertise("list_streams", &RuntimeServices::listStreams);
  advertise("set_unit_available", &RuntimeServices::setUnitAvailable);
  advertise("save_trace", &RuntimeServices::saveTrace);
}

bool RuntimeServices::listUnits(ListUnits::Request&, ListUnits::Response& response)
{
  for (const UnitStatus& unit : runtime_->units())
  {
    response.units.push_back(toMsg(unit));
  }
  return true;
}

bool RuntimeServices::listCodelets(ListCodelets::Request&, ListCodelets::Response& response)
{
  for (const RegisteredCodelet& entry : codelets_->list())
  {
    response.codelets.push_back(toMsg(entry));
  }
  return true;
}

bool RuntimeServices::getEtc(GetEtc::Request&, GetEtc::Response& response)
{
  for (const EtcTable::Entry& entry : runtime_->etcEntries())
  {
    response.entries.push_back(toMsg(entry));
  }
  return true;
}

bool RuntimeServices::setEtc(SetEtc::Request& request, SetEtc::Response& response)
{
  return answer(response,
                [&]
                {
                  std::vector<EtcTable::Entry> entries;
                  for (const EtcEntry& entry : request.entries)
                  {
                    entries.push_back(fromMsg(entry));
                  }
                  if (request.clear)
                  {
                    runtime_->clearEtc();
                  }
                  runtime_->setEtcEntries(entries);
                });
}

bool RuntimeServices::getPolicy(GetPolicy::Request&, GetPolicy::Response& response)
{
  response.policy = toMsg(SchedulerOptions{runtime_->interCoreOptions(), runtime_->innerCoreOptions()});
  return true;
}

bool RuntimeServices::setPolicy(SetPolicy::Request& request, SetPolicy::Response& response)
{
  return answer(response,
                [&]
                {
                  const SchedulerOptions options = fromMsg(request.policy);
                  runtime_->setInterCoreOptions(options.inter_core);
                  runtime_->setInnerCoreOptions(options.inner_core);
                });
}

bool RuntimeServices::admitStream(AdmitStream::Request& request, AdmitStream::Response& response)
{
  try
  {
    const CodeletPtr codelet = codelets_->find(request.codelet);
    if (!codelet)
    {
      throw std::invalid_argument("there is no codelet \"" + request.codelet + "\"; list_codelets tells the names");
    }
    const Admission admission = runtime_->admit(fromMsg(request, codelet));
    response.admitted = admission.admitted();
    response.id = admission.id;
    response.reason = admission.reason;
  }
  catch (const std::exception& error)
  {
    response.reason = error.what();
  }
  return true;
}

bool RuntimeServices::retireStream(RetireStream::Request& request, RetireStream::Response& response)
{
  return answer(response,
                [&]
                {
                  const std::vector<StreamStatus> streams = runtime_->streams();
                  if (request.id == NO_STREAM ||
                      std::none_of(streams.begin(), streams.end(),
                                   [&request](const StreamStatus& stream) { return stream.id == request.id; }))
                  {
                    throw std::invalid_argument("no stream " + std::to_string(request.id) + " is admitted");
                  }
                  runtime_->retire(request.id);
                });
}

bool RuntimeServices::listStreams(ListStreams::Request&, ListStreams::Response& response)
{
  for (const StreamStatus& stream : runtime_->streams())
  {
    response.streams.push_back(toMsg(stream));
  }
  return true;
}

bool RuntimeServices::setUnitAvailable(SetUnitAvailable::Request& request, SetUnitAvailable::Response& response)
{
  return answer(response, [&] { runtime_->setUnitAvailable(request.unit, request.available); });
}

bool RuntimeServices::saveTrace(SaveTrace::Request& request, SaveTrace::Response& response)
{
  return answer(response,
                [&]
                {
                  if (request.chrome_path.empty() && request.gantt_path.empty())
                  {
                    throw std::invalid_argument("neither chrome_path nor gantt_path is given");
                  }
                  if (!runtime_->trace().enabled())
                  {
                    throw std::runtime_error("nothing is recorded; start the runtime with trace_capacity above 0");
                  }
                  // Without chrome_path the trace is only a file between this node and draw_gantt.
                  const bool keep = !request.chrome_path.empty();
                  const std::string path = keep ? request.chrome_path : request.gantt_path + ".trace.json";
                  runtime_->writeTrace(path);
                  response.message = keep ? path : "";
                  if (!request.gantt_path.empty())
                  {
                    drawGantt(path, keep, request.gantt_path);
                    response.message += (keep ? ", " : "") + request.gantt_path;
                  }
                  response.message += " written";
                  response.tasks = static_cast<uint32_t>(runtime_->trace().snapshot().size());
                });
}

}  // namespace pi_runtime
