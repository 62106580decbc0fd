// libpi_os_transport.so: the library that users preload or link.
//
// It replaces some functions of libroscpp (hooks.h), operator new, new[] and delete[], and memset(). In a process
// without roscpp it only adds one or two branches to each of the latter. The first call of a roscpp function loads the
// companion libpi_os_transport_roscpp.so from the same folder. If the companion declines or cannot be loaded, all calls
// go to libroscpp. This library needs no C++ runtime, because it must not bring one into processes that have none.

#include "preload/hooks.h"

#include <dlfcn.h>
#include <fcntl.h>
#include <limits.h>
#include <link.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

namespace
{

constexpr const char* COMPANION = "libpi_os_transport_roscpp.so";
constexpr const char* ROSCPP = "libroscpp.so";

constexpr const char* SYMBOLS[] = {
#define PI_OS_HOOK_SYMBOL(id, type, symbol, parameters, arguments) #symbol,
    PI_OS_HOOKS(PI_OS_HOOK_SYMBOL)
#undef PI_OS_HOOK_SYMBOL
};

__thread void* (*capture)(size_t) __attribute__((tls_model("initial-exec"))) = nullptr;

// At the first access in any thread, also in a signal handler, this memory exists: it is part of the thread's static
// block.
__thread PiOsZeroFill zero_fill __attribute__((tls_model("initial-exec"))) = {0, nullptr, 0, 0};

// A vector's first element is made by itself, the others by memset().
constexpr size_t LARGEST_ELEMENT = 8;

const char* pool_base = nullptr;
size_t pool_length = 0;
void (*pool_release)(void*) = nullptr;

PiOsShim shim;
void* targets[PI_OS_HOOK_COUNT];
pthread_once_t resolved = PTHREAD_ONCE_INIT;

void setPool(const void* base, size_t length, void (*release)(void*))
{
  pool_release = release;
  pool_base = static_cast<const char*>(base);
  pool_length = length;
}

void setCapture(void* (*allocate)(size_t))
{
  capture = allocate;
}

PiOsZeroFill* zeroFill()
{
  return &zero_fill;
}

/// True if memset(memory, value, bytes) clears the newest array, which is overwritten afterwards. True once per array.
bool skipsFill(const void* memory, int value, size_t bytes)
{
  const auto before = static_cast<size_t>(static_cast<const char*>(memory) - zero_fill.array);
  if (zero_fill.array == nullptr || value != 0 || before > LARGEST_ELEMENT || before + bytes != zero_fill.bytes)
  {
    return false;
  }
  zero_fill.array = nullptr;
  ++zero_fill.skipped;
  return true;
}

void complain(const char* what, const char* detail)
{
  char line[2 * PATH_MAX];
  const int length =
      snprintf(line, sizeof(line), "pi_os_transport: %s%s; topics of this process stay on TCPROS\n", what, detail);
  if (length > 0 && write(STDERR_FILENO, line, strnlen(line, sizeof(line))) < 0)
  {
    // nowhere left to report it
  }
}

/// Names the file behind `roscpp_path`, whose name has the version of roscpp.
void complainOfMissing(const char* symbol, const char* roscpp_path)
{
  char resolved[PATH_MAX];
  char what[PATH_MAX + 64];
  snprintf(what, sizeof(what), "unknown roscpp: %s lacks ",
           realpath(roscpp_path, resolved) != nullptr ? resolved : roscpp_path);
  complain(what, symbol);
}

int findRoscpp(dl_phdr_info* info, size_t, void* result)
{
  const char* slash = strrchr(info->dlpi_name, '/');
  const char* name = slash != nullptr ? slash + 1 : info->dlpi_name;
  if (strncmp(name, ROSCPP, strlen(ROSCPP)) != 0)
  {
    return 0;
  }
  *static_cast<const char**>(result) = info->dlpi_name;
  return 1;
}

/// Path of the companion, which lies beside this library.
bool companionPath(char (&path)[PATH_MAX])
{
  Dl_info self;
  if (dladdr(reinterpret_cast<void*>(&companionPath), &self) == 0 || realpath(self.dli_fname, path) == nullptr)
  {
    return false;
  }
  char* slash = strrchr(path, '/');
  const size_t folder = slash != nullptr ? static_cast<size_t>(slash + 1 - path) : 0;
  return snprintf(path + folder, sizeof(path) - folder, "%s", COMPANION) < static_cast<int>(sizeof(path) - folder);
}

/// True if [offset, offset + length) lies within a file of `size` bytes.
bool within(uint64_t offset, uint64_t length, uint64_t size)
{
  return offset <= size && length <= size - offset;
}

/// True if `file` is a complete shared object of this machine's word size.
bool isWholeObject(int file)
{
  struct stat status;
  ElfW(Ehdr) header;
  if (fstat(file, &status) != 0 || pread(file, &header, sizeof(header), 0) != static_cast<ssize_t>(sizeof(header)) ||
      memcmp(header.e_ident, ELFMAG, SELFMAG) != 0 ||
      header.e_ident[EI_CLASS] != (sizeof(void*) == 8 ? ELFCLASS64 : ELFCLASS32))
  {
    return false;
  }
  const auto size = static_cast<uint64_t>(status.st_size);
  if (header.e_phnum == 0 || header.e_phentsize != sizeof(ElfW(Phdr)) ||
      !within(header.e_phoff, uint64_t{header.e_phnum} * header.e_phentsize, size) ||
      !within(header.e_shoff, uint64_t{header.e_shnum} * header.e_shentsize, size))
  {
    return false;
  }
  for (int index = 0; index < header.e_phnum; ++index)
  {
    ElfW(Phdr) part;
    const auto offset = static_cast<off_t>(header.e_phoff + index * sizeof(part));
    if (pread(file, &part, sizeof(part), offset) != static_cast<ssize_t>(sizeof(part)) ||
        (part.p_type == PT_LOAD && !within(part.p_offset, part.p_filesz, size)))
    {
      return false;
    }
  }
  return true;
}

/// False if the file of the companion is truncated: dlopen() would die of SIGBUS. All other defects are reported by
/// dlopen().
bool isWholeCompanion(const char* path)
{
  const int file = open(path, O_RDONLY | O_CLOEXEC);
  if (file < 0)
  {
    return true;
  }
  const bool whole = isWholeObject(file);
  close(file);
  return whole;
}

/// Loads the companion and lets it fill in shim.replacement.
void attachCompanion()
{
  char path[PATH_MAX];
  if (!companionPath(path))
  {
    return;
  }
  if (!isWholeCompanion(path))
  {
    complain("its part for roscpp is incomplete: ", path);
    return;
  }
  void* companion = dlopen(path, RTLD_NOW | RTLD_LOCAL);
  const auto attach =
      companion != nullptr
          ? reinterpret_cast<decltype(&pi_os_transport_attach)>(dlsym(companion, "pi_os_transport_attach"))
          : nullptr;
  if (attach == nullptr)
  {
    complain("cannot load its part for roscpp: ", dlerror());
  }
  else if (attach(&shim) != 0)
  {
    memset(shim.replacement, 0, sizeof(shim.replacement));
    shim.zero_copy = nullptr;
  }
}

void resolveAll()
{
  const char* roscpp_path = nullptr;
  dl_iterate_phdr(findRoscpp, &roscpp_path);
  void* roscpp = roscpp_path != nullptr ? dlopen(roscpp_path, RTLD_LAZY | RTLD_NOLOAD) : nullptr;
  if (roscpp == nullptr)
  {
    complain("found no libroscpp behind a call of roscpp", "");
    abort();  // libroscpp lacks the function that the caller expects
  }
  shim.version = PI_OS_SHIM_VERSION;
  shim.roscpp_path = roscpp_path;
  shim.set_pool = setPool;
  shim.set_capture = setCapture;
  shim.zero_fill = zeroFill;
  const char* missing = nullptr;
  for (int hook = 0; hook < PI_OS_HOOK_COUNT; ++hook)
  {
    shim.original[hook] = dlsym(roscpp, SYMBOLS[hook]);
    if (shim.original[hook] == nullptr)
    {
      missing = SYMBOLS[hook];
    }
  }
  if (missing != nullptr)
  {
    complainOfMissing(missing, roscpp_path);
  }
  else
  {
    attachCompanion();
  }
  for (int hook = 0; hook < PI_OS_HOOK_COUNT; ++hook)
  {
    void* target = shim.replacement[hook] != nullptr ? shim.replacement[hook] : shim.original[hook];
    __atomic_store_n(&targets[hook], target, __ATOMIC_RELEASE);
  }
}

template <typename Function>
Function* target(PiOsHook hook)
{
  void* address = __atomic_load_n(&targets[hook], __ATOMIC_ACQUIRE);
  if (address == nullptr)
  {
    pthread_once(&resolved, resolveAll);
    address = targets[hook];
  }
  return reinterpret_cast<Function*>(address);
}

/// Stands for a returned std::string in the calling convention: a class with a destructor. Only the functions behind
/// the hooks create and destroy it.
struct ReturnedString
{
  ReturnedString(const ReturnedString&);
  ~ReturnedString();
  void* words[4];
};

/// The same for a boost::shared_ptr.
struct ReturnedPointer
{
  ReturnedPointer(const ReturnedPointer&);
  ~ReturnedPointer();
  void* words[2];
};

/// The next implementation of an allocation function, from the C++ runtime or another allocator.
void* nextImplementation(const char* symbol)
{
  void* next = dlsym(RTLD_NEXT, symbol);
  if (next == nullptr)
  {
    // A plug-in may have loaded the C++ runtime outside the global scope, or contain one.
    void* runtime = dlopen("libstdc++.so.6", RTLD_LAZY);
    next = runtime != nullptr ? dlsym(runtime, symbol) : nullptr;
  }
  if (next == nullptr)
  {
    complain("found no next ", symbol);
    abort();
  }
  return next;
}

/// operator new(size_t) of the C++ runtime or another allocator.
void* (*next_new)(size_t) = nullptr;

/// operator new(size_t) for its first call, and for arrays whose zeros may be superfluous.
__attribute__((noinline)) void* allocateArray(size_t bytes)
{
  if (next_new == nullptr)
  {
    next_new = reinterpret_cast<void* (*)(size_t)>(nextImplementation("_Znwm"));
  }
  void* memory = next_new(bytes);
  if (bytes < PI_OS_ZERO_FILL_MIN || bytes > zero_fill.longest)
  {
    return memory;
  }
  zero_fill.array = static_cast<char*>(memory);
  zero_fill.bytes = bytes;
  return memory;
}

bool inPool(void* pointer)
{
  return static_cast<size_t>(static_cast<const char*>(pointer) - pool_base) < pool_length;
}

}  // namespace

/// The C library's memset() behind a check of `room`, which this library does not replace: no lookup, so nothing is
/// allocated, and memset() also works before the first constructor. Not by its own name, which compilers know too well.
extern "C" void* memsetWithin(void* memory, int value, size_t bytes, size_t room) __asm__("__memset_chk");

#pragma GCC visibility push(default)
extern "C"
{
#define PI_OS_FORWARD(id, type, symbol, parameters, arguments) \
  type symbol parameters                                       \
  {                                                            \
    return target<type parameters>(PI_OS_##id) arguments;      \
  }
  PI_OS_HOOKS(PI_OS_FORWARD)

  const PiOsZeroCopyApi* pi_os_transport_zero_copy(uint32_t version)
  {
    pthread_once(&resolved, resolveAll);
    return shim.zero_copy != nullptr && shim.zero_copy->version == version ? shim.zero_copy : nullptr;
  }

  void* memset(void* memory, int value, size_t bytes)
  {
    if (__builtin_expect(bytes >= PI_OS_ZERO_FILL_MIN - LARGEST_ELEMENT, 0) && skipsFill(memory, value, bytes))
    {
      return memory;
    }
    return memsetWithin(memory, value, bytes, SIZE_MAX);
  }

  /// operator new(size_t)
  void* _Znwm(size_t bytes)
  {
    if (__builtin_expect(bytes >= PI_OS_ZERO_FILL_MIN || next_new == nullptr, 0))
    {
      return allocateArray(bytes);
    }
    return next_new(bytes);
  }

  /// operator new[](size_t)
  void* _Znam(size_t bytes)
  {
    if (__builtin_expect(capture != nullptr, 0))
    {
      void* (*allocate)(size_t) = capture;
      capture = nullptr;
      void* memory = allocate(bytes);
      if (memory != nullptr)
      {
        return memory;
      }
    }
    static void* (*next)(size_t) = nullptr;
    if (__builtin_expect(next == nullptr, 0))
    {
      next = reinterpret_cast<void* (*)(size_t)>(nextImplementation("_Znam"));
    }
    return next(bytes);
  }

  /// operator delete[](void*)
  void _ZdaPv(void* memory)
  {
    if (__builtin_expect(inPool(memory), 0))
    {
      pool_release(memory);
      return;
    }
    static void (*next)(void*) = nullptr;
    if (__builtin_expect(next == nullptr, 0))
    {
      next = reinterpret_cast<void (*)(void*)>(nextImplementation("_ZdaPv"));
    }
    next(memory);
  }

  /// operator delete[](void*, size_t)
  void _ZdaPvm(void* memory, size_t bytes)
  {
    if (__builtin_expect(inPool(memory), 0))
    {
      pool_release(memory);
      return;
    }
    static void (*next)(void*, size_t) = nullptr;
    if (__builtin_expect(next == nullptr, 0))
    {
      next = reinterpret_cast<void (*)(void*, size_t)>(nextImplementation("_ZdaPvm"));
    }
    next(memory, bytes);
  }
}
#pragma GCC visibility pop
