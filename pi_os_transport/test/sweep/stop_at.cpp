// Runs a program, counts the stops of each of its threads, and kills it (SIGKILL) at one of them.
//
//   pi_os_transport_test_stop_at [--kill THREAD:N] [--steps FILE]... [--set NAME=VALUE]... --report FD [-- PROGRAM
//   ARG...]
//
// A stop is a system call that is about to be made, or a marked step (src/shm/step_mark.h) of one of the FILEs that has
// just been done. Threads are numbered in the order in which they are made, from 0; their stops from 1, behind exec. A
// process that is killed before a system call has not made it. FD gets one line of JSON when the program has ended:
//
//   {"stops":[1234,567],"killed":true,"at":"step push.tail","calls":1700,"steps":{"push.tail":3},"status":9}
//
// If this program is killed, the kernel kills the other one. Without PROGRAM it reports the steps that are marked:
//
//   {"marked":["push.tail","push.ticket"]}

#include <unistd.h>

#include <cstdio>
#include <cstring>
#include <exception>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

#include "marked_steps.h"
#include "victim.h"

namespace
{

struct Options : Plan
{
  int report = -1;

  Options(int argc, char** argv)
  {
    int i = 1;
    for (; i + 1 < argc && std::strcmp(argv[i], "--") != 0; i += 2)
    {
      const std::string name = argv[i];
      const std::string value = argv[i + 1];
      if (name == "--kill" && value.find(':') != std::string::npos)
      {
        thread = std::stoi(value);
        stop = std::stoull(value.substr(value.find(':') + 1));
      }
      else if (name == "--steps")
      {
        files.emplace_back(value);
      }
      else if (name == "--set" && value.find('=') != std::string::npos)
      {
        environment.push_back(value);
      }
      else if (name == "--report")
      {
        report = std::stoi(value);
      }
      else
      {
        throw std::runtime_error(name + " " + value + ": see the head of test/sweep/stop_at.cpp");
      }
    }
    if (report < 0)
    {
      throw std::runtime_error("--report FD is missing");
    }
    command = i + 1 < argc ? argv + i + 1 : nullptr;
  }
};

std::string marked(const std::vector<MarkedSteps>& files)
{
  std::set<std::string> names;
  for (const MarkedSteps& file : files)
  {
    const std::set<std::string> own = file.names();
    names.insert(own.begin(), own.end());
  }
  std::string text = "{\"marked\":[";
  for (const std::string& name : names)
  {
    text += (name == *names.begin() ? "\"" : ",\"") + name + "\"";
  }
  return text + "]}\n";
}

}  // namespace

int main(int argc, char** argv)
{
  try
  {
    const Options options(argc, argv);
    std::string report;
    if (options.command != nullptr)
    {
      Victim victim(options);
      victim.start();
      victim.run();
      report = victim.report();
    }
    else
    {
      report = marked(options.files);
    }
    return write(options.report, report.data(), report.size()) == static_cast<ssize_t>(report.size()) ? 0 : 1;
  }
  catch (const std::exception& error)
  {
    std::fprintf(stderr, "stop_at: %s\n", error.what());
    return 2;
  }
}
