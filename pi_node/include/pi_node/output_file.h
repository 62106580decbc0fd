#pragma once

#include <filesystem>
#include <fstream>
#include <ostream>
#include <stdexcept>
#include <string>

namespace pi_node
{

/// A text file that a tool writes. The file appears under its name when it is complete; until then it is
/// `NAME.partial`. What is no regular file, such as /dev/stdout, is written directly. Not thread safe.
class OutputFile
{
public:
  /// @throws std::runtime_error naming the file.
  explicit OutputFile(const std::string& path)
    : path_(path)
    , is_special_(std::filesystem::exists(path) && !std::filesystem::is_regular_file(path))
    , partial_(is_special_ ? path : path + ".partial")
    , stream_(partial_)
  {
    if (!stream_)
    {
      throw std::runtime_error(partial_ + ": cannot be written: does the folder exist, and is it yours?");
    }
  }
  /// Removes what is not complete.
  ~OutputFile()
  {
    if (!is_special_)
    {
      std::error_code ignored;
      std::filesystem::remove(partial_, ignored);
    }
  }
  OutputFile(const OutputFile&) = delete;
  OutputFile& operator=(const OutputFile&) = delete;

  std::ostream& stream() { return stream_; }

  /// @throws std::runtime_error naming the file.
  void complete()
  {
    stream_.close();
    if (!stream_)
    {
      throw std::runtime_error(partial_ + ": could not be written to its end: is the disk full?");
    }
    if (!is_special_)
    {
      std::filesystem::rename(partial_, path_);
    }
  }

private:
  const std::string path_;
  const bool is_special_;
  const std::string partial_;
  std::ofstream stream_;
};

}  // namespace pi_node
