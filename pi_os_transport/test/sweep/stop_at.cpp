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

#include <elf.h>
#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/ptrace.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <sys/user.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <map>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

#include "marked_steps.h"

// glibc's <sys/ptrace.h> has this only as an enum of newer versions
#ifndef PTRACE_EVENT_STOP
#define PTRACE_EVENT_STOP 128
#endif

namespace
{

#if defined(__x86_64__)
const std::vector<uint8_t> NOP = {0x90};
const std::vector<uint8_t> BREAKPOINT = {0xcc};
uint64_t& programCounter(user_regs_struct* registers)
{
  return reinterpret_cast<uint64_t&>(registers->rip);
}
constexpr uint64_t TRAP_ADVANCE = 1;  // the counter stands behind a breakpoint that was hit
#elif defined(__aarch64__)
const std::vector<uint8_t> NOP = {0x1f, 0x20, 0x03, 0xd5};
const std::vector<uint8_t> BREAKPOINT = {0x00, 0x00, 0x20, 0xd4};
uint64_t& programCounter(user_regs_struct* registers)
{
  return reinterpret_cast<uint64_t&>(registers->pc);
}
constexpr uint64_t TRAP_ADVANCE = 0;
#else
#error "the breakpoint instruction of this machine is not known here"
#endif

struct Options
{
  int thread = -1;  ///< to be killed at its stop number `stop`; -1: none
  uint64_t stop = 0;
  int report = -1;
  std::vector<MarkedSteps> files;
  std::vector<std::string> environment;
  char** command = nullptr;

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

[[noreturn]] void fail(const std::string& what)
{
  throw std::runtime_error(what + ": " + std::strerror(errno));
}

class Victim
{
public:
  explicit Victim(const Options& options) : options_(options) {}

  void start();
  void run();
  std::string report() const;

private:
  struct Thread
  {
    size_t number = 0;
    bool maps_code = false;  ///< the system call that it was in maps executable memory
  };

  [[noreturn]] void become();
  void onStop(pid_t tid, int status);
  void onSystemCall(pid_t tid);
  bool onBreakpoint(pid_t tid);
  void count(pid_t tid, const std::string& what);
  void setBreakpoints();
  void add(pid_t tid);

  const Options& options_;
  pid_t pid_ = 0;
  bool executed_ = false;
  bool killed_ = false;
  int status_ = 0;
  std::map<pid_t, Thread> threads_;
  std::vector<uint64_t> stops_;
  std::map<uint64_t, std::string> breakpoints_;
  std::map<std::string, uint64_t> steps_;
  uint64_t calls_ = 0;
  std::string at_;
};

void Victim::become()
{
  for (const std::string& variable : options_.environment)
  {
    const size_t equal = variable.find('=');
    setenv(variable.substr(0, equal).c_str(), variable.c_str() + equal + 1, 1);
  }
  sock_filter everything[] = {BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_TRACE)};
  sock_fprog filter{1, everything};
  raise(SIGSTOP);  // until this process is traced
  if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0 && prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &filter) == 0)
  {
    execvp(options_.command[0], options_.command);
  }
  std::perror(options_.command[0]);
  _exit(127);
}

void Victim::start()
{
  pid_ = fork();
  if (pid_ == 0)
  {
    become();
  }
  int status = 0;
  if (pid_ < 0 || waitpid(pid_, &status, WUNTRACED) != pid_ || !WIFSTOPPED(status))
  {
    fail("start of the program");
  }
  constexpr long FOLLOW = PTRACE_O_EXITKILL | PTRACE_O_TRACECLONE | PTRACE_O_TRACEEXEC | PTRACE_O_TRACESECCOMP;
  if (ptrace(PTRACE_SEIZE, pid_, nullptr, FOLLOW) != 0)
  {
    fail("ptrace of the program");
  }
  add(pid_);
  kill(pid_, SIGCONT);
}

void Victim::add(pid_t tid)
{
  if (threads_.count(tid) == 0)
  {
    threads_[tid].number = stops_.size();
    stops_.push_back(0);
  }
}

void Victim::run()
{
  int status = 0;
  for (pid_t tid = waitpid(-1, &status, __WALL); tid > 0; tid = waitpid(-1, &status, __WALL))
  {
    if (WIFSTOPPED(status))
    {
      onStop(tid, status);
    }
    else if (tid == pid_)
    {
      status_ = status;
    }
  }
}

void Victim::onStop(pid_t tid, int status)
{
  const int signal = WSTOPSIG(status);
  const int event = status >> 16;
  if (killed_)
  {
    return;  // it is on its way out
  }
  if (threads_.count(tid) != 0 && threads_[tid].maps_code)
  {
    threads_[tid].maps_code = false;
    setBreakpoints();
  }
  if (event == PTRACE_EVENT_CLONE)
  {
    unsigned long child = 0;
    ptrace(PTRACE_GETEVENTMSG, tid, nullptr, &child);
    add(static_cast<pid_t>(child));
  }
  else if (event == PTRACE_EVENT_EXEC)
  {
    executed_ = true;
    setBreakpoints();
  }
  else if (event == PTRACE_EVENT_SECCOMP)
  {
    onSystemCall(tid);
  }
  else if (event == PTRACE_EVENT_STOP && signal != SIGTRAP)
  {
    ptrace(PTRACE_LISTEN, tid, nullptr, nullptr);  // SIGSTOP and the like stop it as ever
    return;
  }
  else if (event == 0 && !(signal == SIGTRAP && onBreakpoint(tid)))
  {
    ptrace(PTRACE_CONT, tid, nullptr, signal);
    return;
  }
  if (!killed_)
  {
    ptrace(PTRACE_CONT, tid, nullptr, nullptr);
  }
}

void Victim::onSystemCall(pid_t tid)
{
  if (!executed_)
  {
    return;
  }
  __ptrace_syscall_info call{};
  if (ptrace(PTRACE_GET_SYSCALL_INFO, tid, sizeof(call), &call) <= 0)
  {
    return;  // killed meanwhile
  }
  threads_[tid].maps_code = call.seccomp.nr == SYS_mmap && (call.seccomp.args[2] & PROT_EXEC) != 0;
  ++calls_;
  count(tid, "call " + std::to_string(call.seccomp.nr));
}

bool Victim::onBreakpoint(pid_t tid)
{
  user_regs_struct registers{};
  iovec all{&registers, sizeof(registers)};
  if (ptrace(PTRACE_GETREGSET, tid, NT_PRSTATUS, &all) != 0)
  {
    return false;
  }
  const auto found = breakpoints_.find(programCounter(&registers) - TRAP_ADVANCE);
  if (found == breakpoints_.end())
  {
    return false;
  }
  if (TRAP_ADVANCE == 0)
  {
    programCounter(&registers) += BREAKPOINT.size();
    ptrace(PTRACE_SETREGSET, tid, NT_PRSTATUS, &all);
  }
  ++steps_[found->second];
  count(tid, "step " + found->second);
  return true;
}

void Victim::count(pid_t tid, const std::string& what)
{
  const Thread& thread = threads_[tid];
  if (++stops_[thread.number] == options_.stop && static_cast<int>(thread.number) == options_.thread)
  {
    at_ = what;
    killed_ = true;
    kill(pid_, SIGKILL);
  }
}

void Victim::setBreakpoints()
{
  FILE* memory = nullptr;
  for (const MarkedSteps& file : options_.files)
  {
    for (const auto& [address, name] : file.locate(pid_))
    {
      if (!breakpoints_.emplace(address, name).second)
      {
        continue;
      }
      memory = memory != nullptr ? memory : std::fopen(("/proc/" + std::to_string(pid_) + "/mem").c_str(), "r+");
      std::vector<uint8_t> code(NOP.size());
      if (memory == nullptr || std::fseek(memory, static_cast<long>(address), SEEK_SET) != 0 ||
          std::fread(code.data(), code.size(), 1, memory) != 1 || code != NOP ||
          std::fseek(memory, static_cast<long>(address), SEEK_SET) != 0 ||
          std::fwrite(BREAKPOINT.data(), BREAKPOINT.size(), 1, memory) != 1 || std::fflush(memory) != 0)
      {
        fail("breakpoint at the marked step " + name);
      }
    }
  }
  if (memory != nullptr)
  {
    std::fclose(memory);
  }
}

std::string Victim::report() const
{
  std::string text = "{\"stops\":[";
  for (size_t i = 0; i < stops_.size(); ++i)
  {
    text += (i > 0 ? "," : "") + std::to_string(stops_[i]);
  }
  text += std::string("],\"killed\":") + (killed_ ? "true" : "false") + ",\"at\":\"" + at_ + "\"";
  text += ",\"calls\":" + std::to_string(calls_) + ",\"steps\":{";
  for (const auto& [name, times] : steps_)
  {
    text += (text.back() == '{' ? "\"" : ",\"") + name + "\":" + std::to_string(times);
  }
  return text + "},\"status\":" + std::to_string(WIFSIGNALED(status_) ? WTERMSIG(status_) : WEXITSTATUS(status_)) +
         "}\n";
}

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
