#pragma once

#include <chrono>
#include <cstdio>
#include <exception>
#include <functional>
#include <iostream>
#include <map>
#include <stdexcept>
#include <string>
#include <thread>

#include "peers/peer_command.h"
#include "peers/peer_json.h"

/// What a node can be told to do: each verb adds to the answer and says whether it succeeded; it may throw.
template <class Node>
using Verbs = std::map<std::string, bool (Node::*)(const Command&, JsonObject*)>;

/// One line of JSON behind '@', so that the judge tells answers from log output.
inline void answer(const JsonObject& object)
{
  const std::string line = "@" + object.str() + "\n";
  std::fwrite(line.data(), 1, line.size(), stdout);
  std::fflush(stdout);
}

/// Tells the judge that the node with this name is up, then does what it says: until "exit", the end of stdin (the
/// judge died), or until `wanted` is false behind a command.
template <class Node>
void serveCommands(const std::string& name, const Verbs<Node>& verbs, Node* node, const std::function<bool()>& wanted)
{
  answer(JsonObject().text("reply", "ready").boolean("ok", true).text("name", name));
  for (std::string line; wanted() && std::getline(std::cin, line) && line != "exit";)
  {
    try
    {
      const Command command(line);
      const auto verb = verbs.find(command.verb());
      if (verb == verbs.end())
      {
        throw std::invalid_argument("unknown verb \"" + command.verb() + "\"");
      }
      JsonObject reply;
      reply.text("reply", command.verb());
      reply.boolean("ok", (node->*verb->second)(command, &reply));
      answer(reply);
    }
    catch (const std::exception& error)
    {
      answer(JsonObject().text("reply", line).boolean("ok", false).text("error", error.what()));
    }
  }
}

/// Waits for a state of the graph that roscpp signals by no event. @return false if it was not reached in time.
inline bool awaitState(std::chrono::steady_clock::time_point deadline, const std::function<bool()>& reached)
{
  constexpr auto POLL_INTERVAL = std::chrono::milliseconds(5);
  while (!reached())
  {
    if (std::chrono::steady_clock::now() > deadline)
    {
      return false;
    }
    std::this_thread::sleep_for(POLL_INTERVAL);
  }
  return true;
}
