// RuntimeRos: the services that show and set what the runtime knows.
#include "trace/gantt.h"
#include "ros/conversions.h"
#include "ros/runtime_ros.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <stdexcept>

namespace pi_runtime
{
namespace
{

/// Runs an action; what it throws becomes the message of the response.
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

void writeChromeFile(const std::string& path, const std::vector<TaskTrace>& records,
                     const std::vector<std::string>& units)
{
  errno = 0;
  std::ofstream file(path);
  writeChromeTrace(file, records, units);
  file.close();
  if (!file)
  {
    throw std::runtime_error("chrome_path " + path + " cannot be written: " + std::strerror(errno));
  }
}

}  // namespace

bool RuntimeRos::listUnits(ListUnits::Request&, ListUnits::Response& response)
{
  for (const UnitStatus& unit : runtime_->units())
  {
    response.units.push_back(toMsg(unit));
  }
  return true;
}

bool RuntimeRos::listCodelets(ListCodelets::Request&, ListCodelets::Response& response)
{
  for (const RegisteredCodelet& entry : codelets_.list())
  {
    response.codelets.push_back(toMsg(entry));
  }
  return true;
}

bool RuntimeRos::getEtc(GetEtc::Request&, GetEtc::Response& response)
{
  for (const EtcTable::Entry& entry : runtime_->etcEntries())
  {
    response.entries.push_back(toMsg(entry));
  }
  return true;
}

bool RuntimeRos::setEtc(SetEtc::Request& request, SetEtc::Response& response)
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

bool RuntimeRos::getPolicy(GetPolicy::Request&, GetPolicy::Response& response)
{
  response.policy = toMsg(SchedulerOptions{runtime_->interCoreOptions(), runtime_->innerCoreOptions()});
  return true;
}

bool RuntimeRos::setPolicy(SetPolicy::Request& request, SetPolicy::Response& response)
{
  return answer(response,
                [&]
                {
                  const SchedulerOptions options = fromMsg(request.policy);
                  runtime_->setInterCoreOptions(options.inter_core);
                  runtime_->setInnerCoreOptions(options.inner_core);
                });
}

bool RuntimeRos::admitStream(AdmitStream::Request& request, AdmitStream::Response& response)
{
  try
  {
    const CodeletPtr codelet = codelets_.find(request.codelet);
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

bool RuntimeRos::retireStream(RetireStream::Request& request, RetireStream::Response& response)
{
  return answer(response,
                [&]
                {
                  const std::vector<StreamStatus> streams = runtime_->streams();
                  if (std::none_of(streams.begin(), streams.end(),
                                   [&request](const StreamStatus& stream) { return stream.id == request.id; }))
                  {
                    throw std::invalid_argument("no stream " + std::to_string(request.id) + " is admitted");
                  }
                  runtime_->retire(request.id);
                });
}

bool RuntimeRos::listStreams(ListStreams::Request&, ListStreams::Response& response)
{
  for (const StreamStatus& stream : runtime_->streams())
  {
    response.streams.push_back(toMsg(stream));
  }
  return true;
}

bool RuntimeRos::setUnitAvailable(SetUnitAvailable::Request& request, SetUnitAvailable::Response& response)
{
  return answer(response, [&] { runtime_->setUnitAvailable(request.unit, request.available); });
}

bool RuntimeRos::saveTrace(SaveTrace::Request& request, SaveTrace::Response& response)
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
                  const std::vector<TaskTrace> records = runtime_->trace().snapshot();
                  std::vector<std::string> units;
                  for (const UnitStatus& unit : runtime_->units())
                  {
                    units.push_back(unit.name);
                  }
                  if (!request.chrome_path.empty())
                  {
                    writeChromeFile(request.chrome_path, records, units);
                    response.message = request.chrome_path;
                  }
                  if (!request.gantt_path.empty())
                  {
                    writeGantt(request.gantt_path, records, units);
                    response.message += (response.message.empty() ? "" : ", ") + request.gantt_path;
                  }
                  response.message += " written";
                  response.tasks = static_cast<uint32_t>(records.size());
                });
}

}  // namespace pi_runtime
