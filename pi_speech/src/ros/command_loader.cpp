#include "ros/command_loader.h"

#include <ros/console.h>

#include <boost/algorithm/string/join.hpp>
#include <exception>
#include <memory>
#include <utility>

#include "network/word_network.h"
#include "recognizer/words.h"

namespace pi_speech
{
namespace
{

CommandTable tableOf(const std::vector<std::string>& texts)
{
  CommandTable table;
  for (const std::string& text : texts)
  {
    table.commands.emplace_back().text = normalised(text);
  }
  table.validate();
  return table;
}

/// Leaves all to PocketSphinx if the network cannot be read.
/// @param no_network  what is wrong with it; empty: nothing.
std::unique_ptr<CommandRecognizer> makeRecognizer(RecognizerOptions options, const CommandTable& table,
                                                  std::string* no_network)
{
  no_network->clear();
  try
  {
    return std::make_unique<CommandRecognizer>(options, table);
  }
  catch (const WordNetworkError& error)
  {
    options.word_network.clear();
    *no_network = std::string(error.what()) +
                  "; PocketSphinx decides alone, and hears nothing inside sentences, until set_commands is called and "
                  "all is right";
    return std::make_unique<CommandRecognizer>(options, table);
  }
}

}  // namespace

CommandLoader::CommandLoader(ros::NodeHandle private_node, const RecognizerRosOptions& options,
                             const std::string& package, RecognizerWorker* worker)
  : thread_("speech_loader")
  , private_node_(thread_.handle(std::move(private_node)))
  , options_(options)
  , package_(package)
  , worker_(worker)
{
  asked_for_.file = options_.commandsFile(package_);
  worker_->beginLoading(asked_for_.name());
  service_ = private_node_.advertiseService("set_commands", &CommandLoader::setCommands, this);
  thread_.post(
      [this]
      {
        std::string message;
        load(asked_for_, &message);
      });
}

void CommandLoader::stop()
{
  thread_.stop();
  service_.shutdown();
}

std::string CommandLoader::Source::name() const
{
  return file.empty() ? "a list of " + std::to_string(texts.size()) + " commands" : file;
}

bool CommandLoader::load(const Source& source, std::string* message)
{
  worker_->beginLoading(source.name());
  try
  {
    const CommandTable table = source.file.empty() ? tableOf(source.texts) : CommandTable::load(source.file);
    std::string no_network;
    auto recognizer = makeRecognizer(options_.recognizerOptions(package_), table, &no_network);
    const std::string understood = boost::algorithm::join(recognizer->table().texts(), ", ");
    const std::string spotted = boost::algorithm::join(recognizer->spottedCommands(), ", ");
    *message = "understands " + understood + " (in running speech: " + (spotted.empty() ? "none" : spotted) + ")";
    ROS_INFO_STREAM_NAMED("recognizer", *message);
    if (!recognizer->guessedWords().empty())
    {
      const std::string guessed = "no dictionary has these, they are spoken by rules: " +
                                  boost::algorithm::join(recognizer->guessedWords(), "; ") +
                                  "; try them with try_command, or add them to sphinx/dictionary";
      ROS_WARN_STREAM_NAMED("recognizer", guessed);
      *message += "; " + guessed;
    }
    if (!no_network.empty())
    {
      ROS_ERROR_STREAM_NAMED("recognizer", no_network);
      *message += "; " + no_network;
    }
    worker_->use(std::move(recognizer), understood, no_network);
    return true;
  }
  catch (const std::exception& error)
  {
    const std::string problem = error.what();
    const std::string understood = worker_->failLoading(problem);
    *message = problem + (understood.empty() ? "; nothing is understood until set_commands is called and all is right"
                                             : "; these stay in use: " + understood);
    ROS_ERROR_STREAM_NAMED("recognizer", *message);
    return false;
  }
}

bool CommandLoader::setCommands(SetCommands::Request& request, SetCommands::Response& response)
{
  if (!request.file.empty() && !request.commands.empty())
  {
    response.message = "file and commands are both given, must be one of them";
    return true;
  }
  if (!request.file.empty() && request.file.front() != '/')
  {
    response.message =
        "file = \"" + request.file + "\", must be an absolute path: the node's working folder is not the caller's";
    return true;
  }
  if (!request.file.empty() || !request.commands.empty())
  {
    asked_for_ = Source{request.file, request.commands};
  }
  response.success = load(asked_for_, &response.message);
  return true;
}

}  // namespace pi_speech
