#include "power/power_account.h"

#include <pi_node/option_check.h>

#include <algorithm>
#include <cmath>

namespace pi_vehicle::power
{
namespace
{

using pi_node::PowerReading;

bool endsWith(const std::string& text, const std::string& end)
{
  return text.size() >= end.size() && text.compare(text.size() - end.size(), end.size(), end) == 0;
}

const PowerReading::Power* find(const PowerReading& reading, const std::string& name)
{
  const auto found = std::find_if(reading.powers.begin(), reading.powers.end(),
                                  [&name](const PowerReading::Power& power) { return power.name == name; });
  return found != reading.powers.end() ? &*found : nullptr;
}

/// "package-0", not "package-0/core".
bool isPackage(const std::string& name)
{
  const std::string prefix = "package-";
  return name.rfind(prefix, 0) == 0 && name.size() > prefix.size() &&
         name.find_first_not_of("0123456789", prefix.size()) == std::string::npos;
}

double meanFrequencyGhz(const PowerReading& reading)
{
  double sum = 0.0;
  for (const PowerReading::Frequency& frequency : reading.frequencies)
  {
    sum += 1e-9 * frequency.hertz;
  }
  return reading.frequencies.empty() ? 0.0 : sum / static_cast<double>(reading.frequencies.size());
}

}  // namespace

void ModelOptions::validate() const
{
  const pi_node::OptionCheck check("model");
  check.range("idle_w", idle_w, 0.0, 1000.0);
  check.range("board_w", board_w, 0.0, 1000.0);
  check.range("beta_w_per_ghz3", beta_w_per_ghz3, 0.0, 1000.0);
  check.range("frequency_ghz", frequency_ghz, 0.0, 100.0);
}

double busyCoreWatts(const ModelOptions& model, double frequency_ghz)
{
  return model.beta_w_per_ghz3 * std::pow(frequency_ghz, 3.0);
}

std::vector<std::string> computerSensors(const PowerReading& reading, const std::vector<std::string>& asked_for)
{
  if (!asked_for.empty())
  {
    const bool all = std::all_of(asked_for.begin(), asked_for.end(),
                                 [&reading](const std::string& name) { return find(reading, name) != nullptr; });
    return all ? asked_for : std::vector<std::string>();
  }
  std::vector<std::string> packages;
  std::string platform;
  for (const PowerReading::Power& power : reading.powers)
  {
    if (endsWith(power.name, "VDD_IN") || endsWith(power.name, "5V_IN"))
    {
      return {power.name};
    }
    if (power.name == "psys")
    {
      platform = power.name;
    }
    if (isPackage(power.name))
    {
      packages.push_back(power.name);
    }
  }
  return platform.empty() ? packages : std::vector<std::string>{platform};
}

PowerAccount accountPower(const MachineUse& use, const PowerReading& reading, const ModelOptions& model,
                          const std::vector<std::string>& sensors)
{
  PowerAccount account;
  double measured = 0.0;
  for (const std::string& name : computerSensors(reading, sensors))
  {
    measured += find(reading, name)->watts;
    account.source += (account.source.empty() ? "" : " + ") + name;
  }
  account.measured = !account.source.empty() && std::isfinite(measured);
  const double idle = model.idle_w + model.board_w;
  if (account.measured)
  {
    account.total = std::max(measured, 0.0);
    account.idle = std::min(idle, account.total);
    account.dynamic = account.total - account.idle;
  }
  else
  {
    const double frequency = model.frequency_ghz > 0.0 ? model.frequency_ghz : meanFrequencyGhz(reading);
    account.source = "model";
    account.idle = idle;
    account.dynamic = use.busy_cores * busyCoreWatts(model, frequency);
    account.total = account.idle + account.dynamic;
  }
  const double per_core = use.busy_cores > 0.0 ? account.dynamic / use.busy_cores : 0.0;
  for (const ServiceUse& service : use.services)
  {
    account.services.push_back(per_core * service.cores);
  }
  account.shared = per_core * use.shared.cores;
  account.other = per_core * use.other.cores;
  return account;
}

}  // namespace pi_vehicle::power
