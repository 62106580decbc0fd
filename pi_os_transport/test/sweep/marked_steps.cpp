#include "marked_steps.h"

#include <elf.h>

#include <climits>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iterator>
#include <sstream>
#include <stdexcept>

namespace
{

constexpr uint64_t ENTRY_ALIGNMENT = 8;
constexpr uint64_t PAGE = 4096;

template <typename T>
T at(const std::string& content, uint64_t offset)
{
  T value;
  if (offset + sizeof(T) > content.size())
  {
    throw std::runtime_error("an ELF file ends too early");
  }
  std::memcpy(&value, content.data() + offset, sizeof(T));
  return value;
}

}  // namespace

MarkedSteps::MarkedSteps(const std::string& file)
{
  char resolved[PATH_MAX];
  path_ = realpath(file.c_str(), resolved) != nullptr ? resolved : file;
  std::ifstream in(path_, std::ios::binary);
  const std::string content{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
  if (content.compare(0, SELFMAG, ELFMAG) != 0 || content[EI_CLASS] != ELFCLASS64)
  {
    throw std::runtime_error("--steps " + file + ": not a 64-bit ELF file");
  }
  const auto header = at<Elf64_Ehdr>(content, 0);
  for (uint64_t i = 0; i < header.e_phnum; ++i)
  {
    const auto part = at<Elf64_Phdr>(content, header.e_phoff + i * header.e_phentsize);
    if (part.p_type == PT_LOAD && (part.p_flags & PF_X) != 0)
    {
      code_address_ = part.p_vaddr / PAGE * PAGE;
      code_offset_ = part.p_offset / PAGE * PAGE;
    }
  }
  const auto names = at<Elf64_Shdr>(content, header.e_shoff + uint64_t{header.e_shstrndx} * header.e_shentsize);
  for (uint64_t i = 0; i < header.e_shnum; ++i)
  {
    const auto section = at<Elf64_Shdr>(content, header.e_shoff + i * header.e_shentsize);
    if (std::strcmp(content.c_str() + names.sh_offset + section.sh_name, "pi_os_steps") != 0)
    {
      continue;
    }
    for (uint64_t place = section.sh_offset; place < section.sh_offset + section.sh_size;)
    {
      const Step step{at<uint64_t>(content, place), content.c_str() + place + sizeof(uint64_t)};
      steps_.push_back(step);
      place += (sizeof(uint64_t) + step.name.size() + 1 + ENTRY_ALIGNMENT - 1) / ENTRY_ALIGNMENT * ENTRY_ALIGNMENT;
    }
  }
}

std::set<std::string> MarkedSteps::names() const
{
  std::set<std::string> all;
  for (const Step& step : steps_)
  {
    all.insert(step.name);
  }
  return all;
}

std::map<uint64_t, std::string> MarkedSteps::locate(pid_t pid) const
{
  std::map<uint64_t, std::string> found;
  std::ifstream maps("/proc/" + std::to_string(pid) + "/maps");
  for (std::string line; std::getline(maps, line);)
  {
    std::istringstream fields(line);
    std::string range;
    std::string rights;
    std::string offset;
    std::string device;
    std::string inode;
    std::string path;
    fields >> range >> rights >> offset >> device >> inode >> path;
    if (path == path_ && rights.find('x') != std::string::npos && std::stoull(offset, nullptr, 16) == code_offset_)
    {
      const uint64_t bias = std::stoull(range, nullptr, 16) - code_address_;
      for (const Step& step : steps_)
      {
        found.emplace(step.address + bias, step.name);
      }
    }
  }
  return found;
}
