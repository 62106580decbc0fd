// recognize_files --output OUT.tsv CLIPS: what CommandRecognizer makes of sound files, as a table for
// evaluate_commands. Needs no ROS master.

#include <pi_node/command_line.h>
#include <pi_node/durations.h>
#include <pi_node/output_file.h>
#include <pi_node/progress.h>
#include <pi_node/stop_signal.h>
#include <pi_speech/command_recognizer.h>
#include "audio/sound_files.h"
#include "clips/noisy_clips.h"
#include "default_models.h"

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iomanip>
#include <iostream>
#include <limits>
#include <memory>
#include <optional>
#include <sstream>
#include <tuple>

namespace
{

namespace fs = std::filesystem;
namespace po = boost::program_options;
using namespace pi_speech;

constexpr size_t CHUNK = SAMPLE_RATE_HZ / 50;
constexpr double NONE = std::numeric_limits<double>::quiet_NaN();

struct Arguments
{
  std::string commands;
  std::string mode = "safe";
  std::string output;
  std::string evidence;
  std::vector<std::string> inputs;
  RecognizerOptions recognizer;
  bool stream = false;
  bool quiet = false;
  double tail_s = 0.0;
  std::string noise;  ///< empty: none
  double snr_db = 0.0;
  uint32_t seed = 1;
};

/// A sound file and what a list says about it.
struct Clip
{
  std::string name;  ///< as in the list
  std::string path;
  std::vector<std::string> columns;  ///< further ones of the list
};

struct ClipList
{
  std::vector<std::string> columns;  ///< names of the further ones
  std::vector<Clip> clips;
};

std::vector<std::string> split(const std::string& line)
{
  std::vector<std::string> cells;
  std::istringstream stream(line + "\t");
  for (std::string cell; std::getline(stream, cell, '\t');)
  {
    cells.push_back(cell);
  }
  return cells;
}

/// Names of further columns where the list has no header.
std::vector<std::string> usualNames(size_t count)
{
  std::vector<std::string> names;
  for (size_t i = 0; i < count; ++i)
  {
    names.push_back(i == 0 ? "word" : i == 1 ? "speaker" : "column" + std::to_string(i + 2));
  }
  return names;
}

void readList(const std::string& path, ClipList* list)
{
  std::ifstream stream(path);
  if (!stream)
  {
    throw std::runtime_error(path + ": this list cannot be read: is it there, and is it yours?");
  }
  std::optional<std::vector<std::string>> columns;
  std::string line;
  size_t clips = 0;
  for (size_t number = 1; std::getline(stream, line); ++number)
  {
    if (!line.empty() && line.back() == '\r')
    {
      line.pop_back();
    }
    if (line.empty() || line.front() == '#')
    {
      continue;
    }
    std::vector<std::string> cells = split(line);
    const std::string file = cells.front();
    cells.erase(cells.begin());
    if (!columns)
    {
      const bool header = file == "file";
      columns = header ? cells : usualNames(cells.size());
      if (!list->clips.empty() && *columns != list->columns)
      {
        throw std::runtime_error(path + ": this list has other columns than the inputs before it; recognise it alone");
      }
      list->columns = *columns;
      if (header)
      {
        continue;
      }
    }
    if (cells.size() != columns->size() || file.empty())
    {
      throw std::runtime_error(path + ":" + std::to_string(number) + ": " + std::to_string(cells.size() + 1) +
                               " columns, must be " + std::to_string(columns->size() + 1) +
                               " with tabs between them, the first one a file");
    }
    list->clips.push_back({file, (fs::path(path).parent_path() / file).string(), cells});
    ++clips;
  }
  if (clips == 0)
  {
    throw std::runtime_error(path + ": this list names no file, must have one per line");
  }
}

ClipList readInputs(const std::vector<std::string>& inputs)
{
  ClipList list;
  for (const std::string& input : inputs)
  {
    if (fs::path(input).extension() == ".tsv")
    {
      readList(input, &list);
      continue;
    }
    if (!list.columns.empty())
    {
      throw std::runtime_error(input + ": has no columns as the list before it has; recognise it alone");
    }
    for (const std::string& file : listSoundFiles({input}))
    {
      list.clips.push_back({file, file, {}});
    }
  }
  return list;
}

/// A table with tabs between its columns.
class TableFile
{
public:
  explicit TableFile(const std::string& path) : file_(path) {}

  /// @throws std::runtime_error if a cell, such as the name of a file, cannot stand in a table.
  void add(const std::vector<std::string>& cells)
  {
    for (const std::string& cell : cells)
    {
      if (cell.find_first_of("\t\r\n") != std::string::npos)
      {
        throw std::runtime_error("a name with a tab or line break cannot stand in a table; rename the file");
      }
    }
    for (size_t i = 0; i < cells.size(); ++i)
    {
      file_.stream() << (i == 0 ? "" : "\t") << cells[i];
    }
    file_.stream() << "\n";
  }
  void complete() { file_.complete(); }

private:
  pi_node::OutputFile file_;
};

std::string number(double value, int digits)
{
  std::ostringstream text;
  text << std::fixed << std::setprecision(digits) << value;
  return text.str();
}

/// Unlike number() it loses nothing that a fit could see.
std::string precise(double value)
{
  std::ostringstream text;
  text << std::setprecision(9) << value;
  return text.str();
}

/// An utterance of a clip.
struct Found
{
  Recognition recognition;
  bool in_stream = true;  ///< decided by the pause behind it; else by the end of the clip, and has no latency
  bool has_times = true;
};

double latencyMs(const Found& found)
{
  const Recognition& r = found.recognition;
  return found.in_stream ? 1e3 * (static_cast<double>(r.decided_at - r.speech_end) / SAMPLE_RATE_HZ + r.work_s) : NONE;
}

const std::vector<std::string> COLUMNS = {"file",       "text",           "confidence",   "accepted", "reason",
                                          "latency_ms", "speech_begin_s", "speech_end_s", "snr_db",   "work_ms"};

std::vector<std::string> rowOf(const Clip& clip, const Found& found)
{
  const Recognition& r = found.recognition;
  const auto seconds = [&](int64_t at)
  { return number(found.has_times ? static_cast<double>(at) / SAMPLE_RATE_HZ : NONE, 3); };
  std::vector<std::string> row = {clip.name,
                                  r.text,
                                  number(r.confidence, 5),
                                  r.accepted ? "yes" : "no",
                                  r.reason,
                                  number(latencyMs(found), 1),
                                  seconds(r.speech_begin),
                                  seconds(r.speech_end),
                                  number(found.has_times ? r.snr_db : NONE, 1),
                                  number(1e3 * r.work_s, 2)};
  row.insert(row.end(), clip.columns.begin(), clip.columns.end());
  return row;
}

/// The utterance that stands for the clip: of those accepted, else of those that have a command, else of all, the one
/// of the highest confidence.
const Found& bestOf(const std::vector<Found>& all)
{
  const auto rank = [](const Found& found)
  {
    const Recognition& r = found.recognition;
    return std::make_tuple(r.accepted, !r.text.empty(), r.confidence);
  };
  return *std::max_element(all.begin(), all.end(), [&](const Found& a, const Found& b) { return rank(a) < rank(b); });
}

Samples prepare(const Clip& clip, const Arguments& line, NoiseSource* noise)
{
  Samples samples = readAudioFile(clip.path);
  const Samples tail = continueBackground(samples, static_cast<size_t>(line.tail_s * SAMPLE_RATE_HZ));
  const size_t recorded = samples.size();
  samples.insert(samples.end(), tail.begin(), tail.end());
  return noise == nullptr ? samples : mixNoise(samples, noise->next(samples.size()), line.snr_db, recorded);
}

/// @return the clip's utterances; empty if StopSignal came.
std::vector<Found> recognize(CommandRecognizer* recognizer, const Samples& samples, const Arguments& line)
{
  std::vector<Found> all;
  bool in_stream = true;
  const auto sink = [&](const Recognition& recognition) { all.push_back({recognition, in_stream, true}); };
  for (size_t begin = 0; begin < samples.size() && !pi_node::StopSignal::came(); begin += CHUNK)
  {
    recognizer->process(samples.data() + begin, std::min(CHUNK, samples.size() - begin), sink);
  }
  in_stream = false;
  recognizer->flush(sink);
  if (all.empty() && !line.stream)
  {
    if (line.recognizer.mode == RecognitionMode::CLOSED)
    {
      all.push_back({recognizer->recognize(samples.data(), samples.size()), false, false});
    }
    else
    {
      Recognition none;
      none.reason = "no speech";
      all.push_back({none, false, false});
    }
  }
  return all;
}

double quantile(std::vector<double> values, double part)
{
  if (values.empty())
  {
    return NONE;
  }
  const auto at = values.begin() + static_cast<long>(part * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

/// What the summary says.
struct Totals
{
  size_t clips = 0;
  size_t unreadable = 0;
  size_t utterances = 0;
  size_t accepted = 0;
  double sound_s = 0.0;
  double work_s = 0.0;
  std::vector<double> latencies_ms;  ///< of what was accepted
};

void addEvidence(const Clip& clip, const std::vector<Found>& all, TableFile* file)
{
  for (const Found& found : all)
  {
    std::vector<std::string> row = {clip.name};
    row.insert(row.end(), clip.columns.begin(), clip.columns.end());
    row.push_back(found.recognition.reason);
    row.push_back(found.recognition.text);
    for (const double value : ConfidenceModel::features(found.recognition.evidence))
    {
      row.push_back(precise(value));
    }
    file->add(row);
  }
}

void recognizeClip(const Clip& clip, const Arguments& line, CommandRecognizer* recognizer, NoiseSource* noise,
                   TableFile* output, TableFile* evidence, Totals* totals)
{
  const Samples samples = prepare(clip, line, noise);
  recognizer->reset();  // each clip was recorded elsewhere
  const auto start = std::chrono::steady_clock::now();
  const std::vector<Found> all = recognize(recognizer, samples, line);
  totals->work_s += pi_node::secondsSince(start);
  totals->sound_s += static_cast<double>(samples.size()) / SAMPLE_RATE_HZ;
  ++totals->clips;
  if (pi_node::StopSignal::came())
  {
    return;
  }
  const std::vector<Found> told = line.stream ? all : std::vector<Found>{bestOf(all)};
  for (const Found& found : told)
  {
    output->add(rowOf(clip, found));
    ++totals->utterances;
    if (found.recognition.accepted)
    {
      ++totals->accepted;
      if (found.in_stream)
      {
        totals->latencies_ms.push_back(latencyMs(found));
      }
    }
  }
  if (evidence != nullptr)
  {
    addEvidence(clip, all, evidence);
  }
}

/// @return exit status.
int run(const Arguments& line)
{
  const ClipList list = readInputs(line.inputs);
  const CommandTable table = CommandTable::load(line.commands);
  std::optional<NoiseSource> noise;
  if (!line.noise.empty())
  {
    noise.emplace(line.noise, line.seed);
  }
  CommandRecognizer recognizer(line.recognizer, table);
  std::cerr << table.commands.size() << " commands, " << toString(line.recognizer.mode) << ", "
            << recognizer.spottedCommands().size() << " of them heard in running speech\n";
  TableFile output(line.output);
  std::vector<std::string> header = COLUMNS;
  header.insert(header.end(), list.columns.begin(), list.columns.end());
  output.add(header);
  std::optional<TableFile> evidence;
  if (!line.evidence.empty())
  {
    evidence.emplace(line.evidence);
    header = {"file"};
    header.insert(header.end(), list.columns.begin(), list.columns.end());
    header.insert(header.end(), {"reason", "candidate"});
    const std::vector<std::string>& names = ConfidenceModel::featureNames();
    header.insert(header.end(), names.begin(), names.end());
    evidence->add(header);
  }
  Totals totals;
  {
    pi_node::Progress progress("clips", line.quiet);
    for (const Clip& clip : list.clips)
    {
      if (pi_node::StopSignal::came())
      {
        break;
      }
      try
      {
        recognizeClip(clip, line, &recognizer, noise ? &*noise : nullptr, &output, evidence ? &*evidence : nullptr,
                      &totals);
      }
      catch (const std::exception& error)
      {
        std::cerr << "recognize_files: " << clip.name << ": " << error.what() << "; left out\n";
        ++totals.unreadable;
      }
      progress.show(totals.clips + totals.unreadable, list.clips.size());
    }
  }
  if (pi_node::StopSignal::came())
  {
    std::cerr << "stopped; " << line.output << " was not written\n";
    return pi_node::StopSignal::exitStatus();
  }
  if (totals.clips == 0)
  {
    throw std::runtime_error("none of " + std::to_string(list.clips.size()) + " clips can be recognised");
  }
  output.complete();
  if (evidence)
  {
    evidence->complete();
  }
  std::cerr << totals.clips << " clips";
  if (line.stream)
  {
    std::cerr << ", " << totals.utterances << " utterances";
  }
  std::cerr << ", " << totals.accepted << " accepted; real-time factor "
            << number(totals.work_s / std::max(totals.sound_s, 1e-9), 3);
  if (!totals.latencies_ms.empty())
  {
    std::cerr << "; latency median " << number(quantile(totals.latencies_ms, 0.5), 0) << " ms, p95 "
              << number(quantile(totals.latencies_ms, 0.95), 0) << " ms";
  }
  std::cerr << "; " << line.output << "\n";
  return totals.unreadable == 0 ? EXIT_SUCCESS : EXIT_FAILURE;
}

bool parse(int argc, char** argv, Arguments* line)
{
  RecognizerOptions& recognizer = line->recognizer;
  recognizer = withDefaultModels();
  SphinxModel& sphinx = recognizer.sphinx;
  line->commands = packageFile("commands.yaml");
  pi_node::CommandLine options("recognize_files --output OUT.tsv [options] LIST.tsv|SOUND_FILE|FOLDER...");
  options.addValue("commands", &line->commands, "table of commands, YAML");
  options.add("output", po::value(&line->output)->required(),
              "table: file, text, confidence, accepted, reason, latency_ms, ..., and the further columns of LIST.tsv");
  options.add("evidence", po::value(&line->evidence),
              "table of what each confidence comes from, for calibrate_confidence");
  options.addValue("mode", &line->mode, "safe: other words are rejected; closed: each clip is a command");
  options.addValue("threshold", &recognizer.threshold, "least confidence, in (0, 1)");
  options.addValue("word-network", &recognizer.word_network, "network that hears words in the stream; none: without");
  options.addFlag("running-speech", &recognizer.all_in_running_speech,
                  "hear all words of the network inside sentences");
  options.addValue("confidence", &recognizer.confidence, "weights of the confidence");
  options.addValue("garbage-words", &recognizer.garbage_words, "words that stand for other speech");
  options.addValue("acoustic-model", &sphinx.acoustic_model, "folder");
  options.addValue("adaptation", &sphinx.adaptation, "folder of what replaces parts of it; none: without");
  options.addValue("dictionary", &sphinx.dictionary, "how words are spoken");
  options.addFlag("stream", &line->stream, "long recordings: a line for each utterance, not for each clip");
  options.addValue(
      "tail", &line->tail_s,
      "continue each clip by its own background [s], in [0, 60]: what ends with the clip has no latency else");
  options.add("noise", po::value(&line->noise), "white, pink or a sound file: noise behind the clips");
  options.add("snr", po::value(&line->snr_db),
              "power of the clip's speech over that of the noise [dB]; goes with --noise");
  options.addValue("seed", &line->seed, "of the noise");
  options.addFlag("quiet", &line->quiet, "no progress");
  options.addPositional("inputs", &line->inputs, "no list, sound file or folder is named; see --help");
  if (!options.parse(argc, argv))
  {
    return false;
  }
  if (options.given("noise") != options.given("snr"))
  {
    throw po::error("--noise and --snr go together");
  }
  if (!(line->snr_db >= -60.0 && line->snr_db <= 100.0))
  {
    throw po::error("--snr " + number(line->snr_db, 1) + ", must be in [-60, 100]");
  }
  if (!(line->tail_s >= 0.0 && line->tail_s <= 60.0))
  {
    throw po::error("--tail " + number(line->tail_s, 1) + ", must be in [0, 60]");
  }
  if (line->commands.empty())
  {
    throw po::error("--commands: no table of commands is named, and the package's own one is not found");
  }
  if (!line->evidence.empty() && recognizer.confidence.empty())
  {
    throw po::error("--evidence needs a file of weights, --confidence: any will do, they have no part in the evidence");
  }
  if (recognizer.word_network == "none")
  {
    recognizer.word_network.clear();
  }
  if (sphinx.adaptation == "none")
  {
    sphinx.adaptation.clear();
  }
  if (line->mode != toString(RecognitionMode::SAFE) && line->mode != toString(RecognitionMode::CLOSED))
  {
    throw std::invalid_argument("mode = \"" + line->mode + "\", must be safe or closed");
  }
  recognizer.mode = line->mode == toString(RecognitionMode::SAFE) ? RecognitionMode::SAFE : RecognitionMode::CLOSED;
  recognizer.validate();
  return true;
}

}  // namespace

int main(int argc, char** argv)
{
  Arguments line;
  return pi_node::runTool(
      "recognize_files", [&] { return parse(argc, argv, &line); },
      [&]
      {
        pi_node::StopSignal::install();
        return run(line);
      });
}
