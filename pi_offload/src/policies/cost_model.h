#pragma once

namespace pi_offload
{

/// Needs of one task. Data volumes in megabits (10^6 bits), work in 10^9 clock cycles.
struct TaskNeeds
{
  double work_gcycles = 0.0;  ///< w
  double input_mbit = 0.0;    ///< D_in
  double output_mbit = 0.0;   ///< D_out
  double deadline_s = 0.0;    ///< D, from the creation of the task
};

/// The vehicle's computer: power = static_w + beta f^3.
struct LocalComputer
{
  double frequency_ghz = 1.9;  ///< f_L, the highest
  double least_frequency_ghz = 0.4;
  double static_w = 1.0;  ///< a
  double beta_w_per_ghz3 = 0.466540;

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// The vehicle's radio.
struct Radio
{
  double transmit_w = 1.2;  ///< P_in
  double receive_w = 0.9;   ///< P_out
  double wait_w = 0.0;      ///< during the node's work and the network's delay; not in the paper
  double tail_w = 0.0;      ///< after the last transfer; not in the paper
  double tail_s = 0.0;

  /// @throws std::invalid_argument naming field, value and bound.
  void validate() const;
};

/// Service of a node for one task.
struct RemoteService
{
  double frequency_ghz = 10.0;  ///< f_off
  double uplink_mbps = 0.0;     ///< r, vehicle to node
  double downlink_mbps = 0.0;
  double round_trip_s = 0.0;  ///< of an empty message
  double queue_s = 0.0;       ///< wait for a worker
};

/// Time [s] and energy of the vehicle [J].
struct Cost
{
  double time_s = 0.0;
  double energy_j = 0.0;
};

/// Equations 3 and 4 at a frequency; by default the highest.
/// @throws std::invalid_argument for a frequency that is not positive and finite.
Cost localCost(const TaskNeeds& needs, const LocalComputer& computer);
Cost localCost(const TaskNeeds& needs, const LocalComputer& computer, double frequency_ghz);

/// Equations 5 and 6 with round trip and queue. The radio waits during work, queue and round trip; the tail counts
/// once. A rate of 0 needs infinite time and energy.
Cost remoteCost(const TaskNeeds& needs, const Radio& radio, const RemoteService& service);

/// Equation 7 as printed: eta * seconds + (1 - eta) * joules. Its result depends on the units.
double printedCost(const Cost& cost, double eta);
/// Equation 7 without units: eta * time / deadline + (1 - eta) * energy / energy of the task on the vehicle.
double normalisedCost(const Cost& cost, double deadline_s, double local_energy_j, double eta);

/// Frequency of least energy per cycle: cube root of static_w / (2 beta), without the limits of the computer.
double mostEfficientFrequency(const LocalComputer& computer);
/// Frequency of least energy that meets the deadline: max(mostEfficientFrequency(), w / D), within the computer's
/// limits.
double bestLocalFrequency(const TaskNeeds& needs, const LocalComputer& computer);

}  // namespace pi_offload
