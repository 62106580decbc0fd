#pragma once

#include <xmlrpcpp/XmlRpcValue.h>

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <map>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace pi_vehicle
{

/// A call to a ROS master or node with a limit of time, which that of xmlrpcpp has not.
/// @param uri  http://HOST:PORT/. @param stop  ends the call early.
/// @return the value of the answer [1, text, value]; invalid if there was none in time.
XmlRpc::XmlRpcValue callWithin(double timeout_s, const std::string& uri, const std::string& method,
                               const XmlRpc::XmlRpcValue& arguments, const std::atomic<bool>& stop);

/// Whether a host name or address is this computer's. Asks the system's resolver.
bool isThisComputer(const std::string& host);

/// Finds the processes of nodes on this computer, on a thread of its own: the master says where a node is, the node its
/// process. A node whose process has ended is looked for again. A node that does not answer is asked again later; it
/// holds up the search for the others by the timeout, and nobody else.
class NodeFinder
{
public:
  struct Options
  {
    double period_s = 2.0;   ///< between searches for nodes that are not known [s]
    double timeout_s = 1.0;  ///< of each answer [s]
    double again_s = 10.0;   ///< known ones are asked again after so long [s]: another may have taken the name
  };

  /// @param nodes  full names. Begins at once.
  NodeFinder(std::vector<std::string> nodes, const Options& options);
  ~NodeFinder();
  NodeFinder(const NodeFinder&) = delete;
  NodeFinder& operator=(const NodeFinder&) = delete;

  struct Found
  {
    std::map<std::string, int32_t> pids;          ///< by name
    std::map<std::string, std::string> problems;  ///< by name: why it has no process here
    bool master = true;                           ///< the master answers
    uint64_t searches = 0;                        ///< that were finished
  };
  /// Thread safe.
  Found found() const;

private:
  struct Known
  {
    int32_t pid = 0;
    uint64_t start_ticks = 0;
    double asked_s = 0.0;
  };

  void run();
  void search();
  bool look(const std::string& node, double now_s);  ///< @return false if the master does not answer

  const std::vector<std::string> nodes_;
  const Options options_;
  std::map<std::string, Known> known_;  ///< of the thread
  std::atomic<bool> stopping_{false};
  mutable std::mutex mutex_;
  std::condition_variable stopped_;
  Found found_;
  std::thread thread_;
};

}  // namespace pi_vehicle
