#include "victim.h"

#include <elf.h>
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

#include <cerrno>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <stdexcept>

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

[[noreturn]] void fail(const std::string& what)
{
  throw std::runtime_error(what + ": " + std::strerror(errno));
}

}  // namespace

void Victim::become()
{
  for (const std::string& variable : plan_.environment)
  {
    const size_t equal = variable.find('=');
    setenv(variable.substr(0, equal).c_str(), variable.c_str() + equal + 1, 1);
  }
  sock_filter everything[] = {BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_TRACE)};
  sock_fprog filter{1, everything};
  raise(SIGSTOP);  // until this process is traced
  if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0 && prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &filter) == 0)
  {
    execvp(plan_.command[0], plan_.command);
  }
  std::perror(plan_.command[0]);
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
  if (++stops_[thread.number] == plan_.stop && static_cast<int>(thread.number) == plan_.thread)
  {
    at_ = what;
    killed_ = true;
    kill(pid_, SIGKILL);
  }
}

void Victim::setBreakpoints()
{
  FILE* memory = nullptr;
  for (const MarkedSteps& file : plan_.files)
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
