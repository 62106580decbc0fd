#pragma once

#include "sensors/vectornav.h"

#include <gtest/gtest.h>
#include <poll.h>
#include <pty.h>
#include <termios.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <filesystem>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace pi_vehicle
{

/// A VectorNav at the far end of a pseudo-terminal, at rest. It measures 200 times a second while it is on, and answers
/// commands.
class FakeVectorNav
{
public:
  /// @param link  becomes a link to the near end.
  explicit FakeVectorNav(std::string link) : link_(std::move(link)) { plugIn(); }
  ~FakeVectorNav() { unplug(); }

  void plugIn()
  {
    termios settings = {};
    ::cfmakeraw(&settings);
    char name[128] = {};
    int near_end = -1;
    ASSERT_EQ(0, ::openpty(&far_end_, &near_end, name, &settings, nullptr)) << "is /dev/pts mounted?";
    ::close(near_end);
    std::filesystem::remove(link_);
    std::filesystem::create_symlink(name, link_);
    stopping_ = false;
    thread_ = std::thread([this] { run(); });
  }
  void unplug()
  {
    stopping_ = true;
    if (thread_.joinable())
    {
      thread_.join();
      ::close(far_end_);
      std::filesystem::remove(link_);
    }
  }
  /// Sends bytes between two measurements.
  void send(const std::string& bytes)
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    extra_ += bytes;
  }
  /// What is sent in place of the measurement; "": nothing.
  void measure(const std::string& line)
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    line_ = line;
  }
  /// What commands are answered with in place of their own text; "": nothing.
  void answer(const std::string& text)
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    answer_ = text;
  }
  std::vector<std::string> commands() const
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    return commands_;
  }

  static std::string measurement()
  {
    return vectorNavCommand(
        "VNIMU,-00.0350,+00.4222,-00.6643,+00.010,-00.020,+09.810,+00.001000,-00.002000,+00.003000,"
        "+20.7,+084.322");
  }

private:
  void run()
  {
    VectorNavReader reader;
    for (auto due = std::chrono::steady_clock::now(); !stopping_; due += std::chrono::milliseconds(5))  // its rate
    {
      std::this_thread::sleep_until(due);
      const std::lock_guard<std::mutex> lock(mutex_);
      write(std::exchange(extra_, "") + line_);
      pollfd waiting = {far_end_, POLLIN, 0};
      uint8_t bytes[256];
      if (::poll(&waiting, 1, 0) > 0 && (waiting.revents & POLLIN) != 0)
      {
        const ssize_t count = ::read(far_end_, bytes, sizeof bytes);
        reader.onBytes(bytes, static_cast<size_t>(std::max<ssize_t>(0, count)),
                       [this](const VectorNavLine& line)
                       {
                         commands_.push_back(line.text);
                         EXPECT_EQ(VectorNavLine::Kind::OTHER, line.kind) << line.text;
                         write(answer_.empty() ? "" : vectorNavCommand(answer_ == "echo" ? line.text : answer_));
                       });
      }
    }
  }
  void write(const std::string& bytes) const
  {
    // Nobody at the other end, or a full buffer: lost, as on a wire.
    pollfd waiting = {far_end_, POLLOUT, 0};
    if (::poll(&waiting, 1, 0) > 0 && (waiting.revents & POLLHUP) == 0 && !bytes.empty())
    {
      EXPECT_LE(::write(far_end_, bytes.data(), bytes.size()), static_cast<ssize_t>(bytes.size()));
    }
  }

  const std::string link_;
  int far_end_ = -1;
  mutable std::mutex mutex_;
  std::string line_ = measurement();
  std::string answer_ = "echo";
  std::string extra_;
  std::vector<std::string> commands_;
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

}  // namespace pi_vehicle
