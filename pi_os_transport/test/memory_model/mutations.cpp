#include "mutations.h"

#include <gtest/gtest.h>

#include <cstdio>
#include <set>

namespace weak_memory
{

void expectAllHold(const std::vector<NamedProgram>& programs)
{
  for (const NamedProgram& one : programs)
  {
    const Model::Result result = Model::instance().run(one.program);
    EXPECT_EQ("", result.failure) << one.name;
    EXPECT_GT(result.executions, 10U) << one.name << ": hardly anything was tried";
    std::printf("%8lu executions, %8lu states: %s\n", static_cast<unsigned long>(result.executions),
                static_cast<unsigned long>(result.states), one.name);
  }
}

void expectEveryOrderNeeded(const std::vector<NamedProgram>& programs,
                            const std::map<std::string, const char*>& stronger_than_needed, uint32_t at_least)
{
  for (const NamedProgram& one : programs)
  {
    ASSERT_EQ("", Model::instance().run(one.program).failure) << one.name;
  }
  uint32_t found_count = 0;
  std::set<std::string> held;
  const std::map<Site, uint64_t> sites = Model::instance().sites();
  for (const auto& [site, count] : sites)
  {
    for (const std::memory_order order : weakerThan(site))
    {
      const Mutation mutation{site, order};
      std::string found;
      for (size_t i = 0; i < programs.size() && found.empty(); ++i)
      {
        const std::string failure = Model::instance().run(programs[i].program, &mutation).failure;
        found = failure.substr(0, failure.find('\n'));
      }
      std::printf("%-56s %s\n", mutation.toString().c_str(), found.empty() ? "holds all the same" : found.c_str());
      found_count += found.empty() ? 0 : 1;
      if (found.empty())
      {
        held.insert(mutation.toString());
      }
    }
  }
  std::set<std::string> expected;
  for (const auto& [mutation, why] : stronger_than_needed)
  {
    expected.insert(mutation);
  }
  EXPECT_EQ(expected, held) << "an order is not needed, or is needed and was not before: add the reason, or take it "
                               "off the list";
  EXPECT_GE(found_count, at_least) << "hardly any mutation was found: the programs are blind";
}

}  // namespace weak_memory
