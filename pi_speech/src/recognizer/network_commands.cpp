#include "recognizer/network_commands.h"

#include <algorithm>
#include <memory>

#include "recognizer/words.h"

namespace pi_speech
{

namespace
{

/// Silence that is put in front of a single piece and behind it: the network knows words best that some sound precedes,
/// and decides a little after a word.
constexpr size_t QUIET = SAMPLE_RATE_HZ * 3 / 10;

bool isPartOfAnother(const std::string& word, const CommandTable& table)
{
  return std::any_of(table.commands.begin(), table.commands.end(),
                     [&word](const Command& command)
                     {
                       const std::vector<std::string> words = splitWords(command.text);
                       return words.size() > 1 && std::find(words.begin(), words.end(), word) != words.end();
                     });
}

}  // namespace

NetworkCommands::NetworkCommands(const RecognizerOptions& options, const CommandTable& table)
{
  if (options.word_network.empty())
  {
    return;
  }
  const std::shared_ptr<const WordNetwork> network = WordNetwork::load(options.word_network);
  std::vector<SpottedWord> words;
  std::vector<SpottedWord> words_of_stream;
  for (size_t i = 0; i < table.commands.size(); ++i)
  {
    const Command& command = table.commands[i];
    if (network->find(command.text) >= 0 && (command.fast || !isPartOfAnother(command.text, table)))
    {
      words.push_back({command.text, options.networkThresholdOf(command), command.fast, command.doubt});
      commands_.push_back(i);
      if (command.fast || options.all_in_running_speech)
      {
        words_of_stream.push_back(words.back());
        in_stream_.push_back(i);
      }
    }
  }
  if (!words_of_stream.empty())
  {
    stream_.emplace(network, words_of_stream);
  }
  if (!words.empty())
  {
    single_.emplace(network, words);
  }
}

void NetworkCommands::process(const int16_t* samples, size_t count, const Sink& sink)
{
  if (stream_)
  {
    stream_->process(samples, count, [&](const WordSpotter::Spotted& found) { sink(toHeard(found)); });
  }
}

void NetworkCommands::restart(int64_t next_sample, const Sink& sink)
{
  if (stream_)
  {
    stream_->restart(next_sample, [&](const WordSpotter::Spotted& found) { sink(toHeard(found)); });
  }
}

NetworkCommands::Heard NetworkCommands::toHeard(const WordSpotter::Spotted& found) const
{
  return {in_stream_[found.word], found.confidence, found.begin, found.end, found.doubtful};
}

std::optional<NetworkCommands::Best> NetworkCommands::listenToPiece(const int16_t* samples, size_t count)
{
  if (!single_ || count == 0)
  {
    return std::nullopt;
  }
  const auto ignore = [](const WordSpotter::Spotted&) {};
  const std::vector<int16_t> quiet(QUIET, 0);
  single_->restart(0, ignore);
  single_->process(quiet.data(), quiet.size(), ignore);
  single_->process(samples, count, ignore);
  single_->process(quiet.data(), quiet.size(), ignore);
  const WordPeaks::Peak& best = single_->best();
  if (best.probability <= 0.0)
  {
    return std::nullopt;
  }
  return Best{commands_[best.word], best.probability};
}

bool NetworkCommands::contains(const std::vector<size_t>& commands, size_t command)
{
  return std::find(commands.begin(), commands.end(), command) != commands.end();
}

}  // namespace pi_speech
