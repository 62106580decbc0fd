#include "core/codelet_registry.h"

#include <gtest/gtest.h>

#include <stdexcept>
#include <thread>
#include <vector>

#include "kernels/builtin_codelets.h"

namespace pi_runtime
{
namespace
{

CodeletPtr codelet(const std::string& name)
{
  Codelet result;
  result.name = name;
  result.native = {NativeImplementation{[](const NativeCall&) {}}};
  return makeCodelet(std::move(result));
}

std::string refusal(CodeletRegistry& registry, RegisteredCodelet entry)
{
  try
  {
    registry.add(std::move(entry));
  }
  catch (const std::invalid_argument& error)
  {
    return error.what();
  }
  return "";
}

TEST(CodeletRegistry, FindsWhatWasAdded)
{
  CodeletRegistry registry;
  const CodeletPtr copy = codelet("copy");
  registry.add({copy, "copies", "0 in, 1 out"});
  EXPECT_EQ(copy, registry.find("copy"));
  ASSERT_EQ(1u, registry.list().size());
  EXPECT_EQ("copies", registry.list()[0].description);
  EXPECT_EQ("0 in, 1 out", registry.list()[0].arguments);
}

TEST(CodeletRegistry, KnowsNothingElse)
{
  CodeletRegistry registry;
  EXPECT_EQ(nullptr, registry.find("copy"));
  EXPECT_EQ(nullptr, registry.find(""));
  EXPECT_TRUE(registry.list().empty());
  EXPECT_FALSE(registry.remove("copy"));
}

TEST(CodeletRegistry, ListsByName)
{
  CodeletRegistry registry;
  for (const char* name : {"c", "a", "b"})
  {
    registry.add({codelet(name), "does something", ""});
  }
  std::string names;
  for (const RegisteredCodelet& entry : registry.list())
  {
    names += entry.codelet->name;
  }
  EXPECT_EQ("abc", names);
}

TEST(CodeletRegistry, RefusesASecondCodeletOfOneName)
{
  CodeletRegistry registry;
  const CodeletPtr first = codelet("copy");
  registry.add({first, "copies", ""});
  const std::string message = refusal(registry, {codelet("copy"), "copies otherwise", ""});
  EXPECT_NE(std::string::npos, message.find("another codelet is called copy")) << message;
  EXPECT_EQ(first, registry.find("copy"));
  EXPECT_EQ("copies", registry.list()[0].description);
}

TEST(CodeletRegistry, TakesTheSameCodeletAgainWithNewTexts)
{
  CodeletRegistry registry;
  const CodeletPtr copy = codelet("copy");
  registry.add({copy, "copies", ""});
  registry.add({copy, "copies bytes", "0 in, 1 out"});
  ASSERT_EQ(1u, registry.list().size());
  EXPECT_EQ("copies bytes", registry.list()[0].description);
}

TEST(CodeletRegistry, RefusesEntriesThatNobodyCouldUse)
{
  CodeletRegistry registry;
  EXPECT_NE(std::string::npos, refusal(registry, {nullptr, "nothing", ""}).find("null"));
  EXPECT_NE(std::string::npos, refusal(registry, {codelet("copy"), "", ""}).find("copy needs a description"));
  EXPECT_TRUE(registry.list().empty());
}

TEST(CodeletRegistry, FreesTheNameOfWhatIsRemoved)
{
  CodeletRegistry registry;
  const CodeletPtr first = codelet("copy");
  registry.add({first, "copies", ""});
  EXPECT_TRUE(registry.remove("copy"));
  EXPECT_EQ(nullptr, registry.find("copy"));
  const CodeletPtr second = codelet("copy");
  registry.add({second, "copies", ""});
  EXPECT_EQ(second, registry.find("copy"));
  EXPECT_EQ("copy", first->name) << "who has it keeps it";
}

TEST(CodeletRegistry, HoldsTheBuiltInKernelsFromTheBeginning)
{
  const std::vector<RegisteredCodelet> entries = CodeletRegistry::instance().list();
  EXPECT_GE(entries.size(), 6u);
  for (const RegisteredCodelet& entry : entries)
  {
    EXPECT_NO_THROW(entry.codelet->validate()) << entry.codelet->name;
    EXPECT_FALSE(entry.arguments.empty()) << entry.codelet->name;
    EXPECT_EQ(std::string::npos, entry.description.find('\n')) << entry.codelet->name;
  }
  EXPECT_NE(nullptr, CodeletRegistry::instance().find("pyramid_down"));
  kernels::registerBuiltinCodelets(CodeletRegistry::instance());
  EXPECT_EQ(entries.size(), CodeletRegistry::instance().list().size()) << "once more changes nothing";
}

TEST(CodeletRegistry, CanBeUsedByManyThreads)
{
  constexpr int THREADS = 4;
  constexpr int CODELETS = 200;
  CodeletRegistry registry;
  std::vector<std::thread> threads;
  std::vector<int> missing(THREADS, 0);
  for (int thread = 0; thread < THREADS; ++thread)
  {
    threads.emplace_back(
        [&registry, &missing, thread]
        {
          for (int i = 0; i < CODELETS; ++i)
          {
            const std::string name = "c" + std::to_string(thread) + "_" + std::to_string(i);
            registry.add({codelet(name), "does something", ""});
            missing[thread] += registry.find(name) == nullptr;
            missing[thread] += i % 2 == 0 && !registry.remove(name);
          }
        });
  }
  for (std::thread& thread : threads)
  {
    thread.join();
  }
  EXPECT_EQ(std::vector<int>(THREADS, 0), missing);
  EXPECT_EQ(size_t{THREADS * CODELETS / 2}, registry.list().size());
}

}  // namespace
}  // namespace pi_runtime
