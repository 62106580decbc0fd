// Spoken commands through CommandRecognizer, in both modes, beside the usual recipe of PocketSphinx: its own detection
// of speech, a grammar of the same commands, chunks of 20 ms as they come:
//   bench_speech $PI_EDGE_DATA/speech/commands.tsv [--every 5] [--noise FILES] [--speech FILES]
// All take turns clip by clip, in an order that rotates. A clip goes on for a second and a half with its own
// background. The first command that comes is the answer. Latency: from the end of speech in the clip, which is the
// last frame of 10 ms within 25 dB of its loudest and 6 dB above its quietest tenth, to the chunk with the command and
// the time that this chunk took. Commands before the end of speech count with their negative latency and are told
// apart.

#include <pi_node/command_line.h>
#include <pi_node/durations.h>
#include <pi_speech/audio.h>
#include <pi_speech/command_recognizer.h>
#include <pocketsphinx.h>
#include <sphinxbase/err.h>
#include <sys/wait.h>
#include <unistd.h>
#include "audio/sound_files.h"
#include "clips/noisy_clips.h"
#include "default_models.h"
#include "recognizer/grammar.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iostream>
#include <limits>
#include <map>
#include <memory>
#include <numeric>
#include <optional>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

namespace
{

namespace fs = std::filesystem;
namespace po = boost::program_options;
using namespace pi_speech;

constexpr size_t CHUNK = SAMPLE_RATE_HZ / 50;
constexpr size_t TAIL = 3 * SAMPLE_RATE_HZ / 2;
constexpr int SILENCE_S = 60;
constexpr double SILENCE_DBFS = -65.0;
constexpr int STREAM_S = 60;  ///< of each looped noise and gain
const char STOP[] = "stop";

std::string machineName()
{
  std::ifstream info("/proc/cpuinfo");
  std::string line;
  while (std::getline(info, line))
  {
    if (line.rfind("model name", 0) == 0)
    {
      return line.substr(line.find(':') + 2);
    }
  }
  return "unknown processor";
}

double processorSeconds()
{
  timespec time{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + static_cast<double>(time.tv_nsec) * 1e-9;
}

double quantile(std::vector<double> values, double part)
{
  if (values.empty())
  {
    return std::numeric_limits<double>::quiet_NaN();
  }
  const auto at = values.begin() + static_cast<long>(part * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

/// A command that a contender gave.
struct Answer
{
  std::string text;
  bool fast = false;
};

/// What turns a stream of sound into commands.
class Listener
{
public:
  virtual ~Listener() = default;
  /// What comes was recorded elsewhere.
  virtual void begin() = 0;
  virtual std::vector<Answer> process(const int16_t* samples, size_t count) = 0;
  virtual std::vector<Answer> flush() = 0;
};

/// PocketSphinx as its own programs use it.
class PlainRecipe : public Listener
{
public:
  PlainRecipe(const SphinxModel& model, const CommandTable& table)
  {
    err_set_logfp(nullptr);
    config_.reset(cmd_ln_init(nullptr, ps_args(), 1, "-hmm", model.acoustic_model.c_str(), "-dict",
                              model.dictionary.c_str(), nullptr));
    decoder_.reset(config_ == nullptr ? nullptr : ps_init(config_.get()));
    const std::string grammar = toJsgf(table.texts());
    if (decoder_ == nullptr || ps_set_jsgf_string(decoder_.get(), "commands", grammar.c_str()) != 0 ||
        ps_set_search(decoder_.get(), "commands") != 0)
    {
      throw std::runtime_error("PocketSphinx does not take model " + model.acoustic_model + ", dictionary " +
                               model.dictionary + " and the grammar of the commands");
    }
    ps_start_utt(decoder_.get());
  }

  /// Its mean of the cepstra stays: it learns that over clips.
  void begin() override
  {
    ps_end_utt(decoder_.get());
    ps_start_stream(decoder_.get());
    ps_start_utt(decoder_.get());
    spoken_ = false;
  }

  std::vector<Answer> process(const int16_t* samples, size_t count) override
  {
    ps_process_raw(decoder_.get(), samples, count, 0, 0);
    const bool in_speech = ps_get_in_speech(decoder_.get()) != 0;
    if (in_speech || !spoken_)
    {
      spoken_ = spoken_ || in_speech;
      return {};
    }
    return endUtterance();
  }

  std::vector<Answer> flush() override { return endUtterance(); }

private:
  std::vector<Answer> endUtterance()
  {
    ps_end_utt(decoder_.get());
    int32 score = 0;
    const char* const text = ps_get_hyp(decoder_.get(), &score);
    std::vector<Answer> answers;
    if (text != nullptr && *text != '\0')
    {
      answers.push_back({text, false});
    }
    ps_start_utt(decoder_.get());
    spoken_ = false;
    return answers;
  }

  struct Free
  {
    void operator()(cmd_ln_t* config) const { cmd_ln_free_r(config); }
    void operator()(ps_decoder_t* decoder) const { ps_free(decoder); }
  };
  std::unique_ptr<cmd_ln_t, Free> config_;
  std::unique_ptr<ps_decoder_t, Free> decoder_;
  bool spoken_ = false;
};

class Ours : public Listener
{
public:
  Ours(const RecognizerOptions& options, const CommandTable& table)
    : options_(options), table_(table), recognizer_(std::make_unique<CommandRecognizer>(options, table))
  {
  }
  void begin() override { recognizer_ = std::make_unique<CommandRecognizer>(options_, table_); }
  std::vector<Answer> process(const int16_t* samples, size_t count) override
  {
    recognizer_->process(samples, count, sink_);
    return std::exchange(answers_, {});
  }
  std::vector<Answer> flush() override
  {
    recognizer_->flush(sink_);
    return std::exchange(answers_, {});
  }

private:
  const RecognizerOptions options_;
  const CommandTable table_;
  std::unique_ptr<CommandRecognizer> recognizer_;
  std::vector<Answer> answers_;
  const CommandRecognizer::Sink sink_ = [this](const Recognition& recognition)
  {
    if (recognition.accepted)
    {
      answers_.push_back({recognition.text, recognition.fast});
    }
  };
};

struct Clip
{
  Samples samples;  ///< with its tail
  std::string word;
  size_t speech_end = 0;
};

/// Every n-th clip of each word. The list has a header with the columns file and word.
std::vector<Clip> readClips(const std::string& path, int every)
{
  std::ifstream stream(path);
  std::string line;
  std::vector<Clip> clips;
  std::map<std::string, int> seen;
  while (std::getline(stream, line))
  {
    std::istringstream cells(line);
    std::string file;
    std::string word;
    if (!std::getline(cells, file, '\t') || !std::getline(cells, word, '\t') || file == "file")
    {
      continue;
    }
    if (seen[word]++ % every != 0)
    {
      continue;
    }
    Clip clip;
    clip.samples = readAudioFile((fs::path(path).parent_path() / file).string());
    clip.word = word;
    clip.speech_end = endOfSpeech(clip.samples);
    const Samples tail = continueBackground(clip.samples, TAIL);
    clip.samples.insert(clip.samples.end(), tail.begin(), tail.end());
    clips.push_back(std::move(clip));
  }
  if (clips.empty())
  {
    throw std::runtime_error(path + ": this list names no clip: it must have lines of file, word and so on, with tabs");
  }
  return clips;
}

struct Contender
{
  std::string name;
  std::function<std::unique_ptr<Listener>()> load;
  std::unique_ptr<Listener> listener;
  // of the clips
  size_t right = 0;
  size_t wrong = 0;
  size_t none = 0;
  size_t false_other = 0;
  size_t false_background = 0;
  size_t more = 0;   ///< answers after the first one of a clip
  size_t early = 0;  ///< right ones before the end of speech
  double sound_s = 0.0;
  double processor_s = 0.0;
  std::vector<double> latencies_ms;  ///< of right ones
  std::vector<double> stop_ms;       ///< of right stops
  size_t fast_stops = 0;
};

bool isCommand(const Clip& clip)
{
  return clip.word.rfind('_', 0) != 0;
}

void take(const Clip& clip, Contender* contender)
{
  if (contender->listener == nullptr)
  {
    contender->listener = contender->load();
  }
  contender->listener->begin();
  Listener* const listener = contender->listener.get();
  std::optional<Answer> first;
  double latency_ms = 0.0;
  const double processor = processorSeconds();
  const auto keep = [&](const std::vector<Answer>& answers, size_t at, double work_s)
  {
    for (const Answer& answer : answers)
    {
      contender->more += first ? 1 : 0;
      if (!first)
      {
        first = answer;
        latency_ms = 1e3 * ((static_cast<double>(at) - static_cast<double>(clip.speech_end)) / SAMPLE_RATE_HZ + work_s);
      }
    }
  };
  for (size_t begin = 0; begin < clip.samples.size(); begin += CHUNK)
  {
    const size_t count = std::min(CHUNK, clip.samples.size() - begin);
    const auto start = std::chrono::steady_clock::now();
    const std::vector<Answer> answers = listener->process(clip.samples.data() + begin, count);
    keep(answers, begin + count, pi_node::secondsSince(start));
  }
  const bool in_time = first.has_value();
  keep(listener->flush(), clip.samples.size(), 0.0);
  contender->processor_s += processorSeconds() - processor;
  contender->sound_s += static_cast<double>(clip.samples.size()) / SAMPLE_RATE_HZ;
  if (!isCommand(clip))
  {
    (clip.word == "_silence_" ? contender->false_background : contender->false_other) += first ? 1 : 0;
    return;
  }
  if (!first)
  {
    ++contender->none;
    return;
  }
  if (first->text != clip.word)
  {
    ++contender->wrong;
    return;
  }
  ++contender->right;
  if (!in_time)
  {
    return;  // no end was found in time: it would have gone on
  }
  contender->latencies_ms.push_back(latency_ms);
  contender->early += latency_ms < 0.0 ? 1 : 0;
  if (clip.word == STOP)
  {
    contender->stop_ms.push_back(latency_ms);
    contender->fast_stops += first->fast ? 1 : 0;
  }
}

/// Commands in a stream, and the processor's time.
struct StreamResult
{
  size_t commands = 0;
  size_t stops = 0;
  double processor_s = 0.0;
};

StreamResult listen(Listener* listener, const Samples& samples)
{
  StreamResult result;
  const double processor = processorSeconds();
  const auto count = [&](const std::vector<Answer>& answers)
  {
    for (const Answer& answer : answers)
    {
      ++result.commands;
      result.stops += answer.text == STOP ? 1 : 0;
    }
  };
  for (size_t begin = 0; begin < samples.size(); begin += CHUNK)
  {
    count(listener->process(samples.data() + begin, std::min(CHUNK, samples.size() - begin)));
  }
  count(listener->flush());
  result.processor_s = processorSeconds() - processor;
  return result;
}

struct Stream
{
  std::string name;
  Samples samples;
};

/// Looped, at three loudnesses.
void addNoise(const std::string& path, std::vector<Stream>* streams)
{
  const Samples noise = readAudioFile(path);
  Stream stream{fs::path(path).filename().string() + ", looped, -10 0 +10 dB", {}};
  for (const double gain_db : {-10.0, 0.0, 10.0})
  {
    const double gain = std::pow(10.0, gain_db / 20.0);
    for (size_t i = 0; i < static_cast<size_t>(STREAM_S) * SAMPLE_RATE_HZ; ++i)
    {
      stream.samples.push_back(
          static_cast<int16_t>(std::lround(std::clamp(gain * noise[i % noise.size()], -32768.0, 32767.0))));
    }
  }
  streams->push_back(std::move(stream));
}

std::vector<Stream> readStreams(const std::vector<Clip>& clips, const std::vector<std::string>& noises,
                                const std::vector<std::string>& speech)
{
  std::vector<Stream> streams;
  for (const std::string& path : noises.empty() ? noises : listSoundFiles(noises))
  {
    addNoise(path, &streams);
  }
  Stream other{"clips of other words, one after the other", {}};
  for (const Clip& clip : clips)
  {
    if (clip.word == "_unknown_")
    {
      other.samples.insert(other.samples.end(), clip.samples.begin(), clip.samples.end());
    }
  }
  if (!other.samples.empty())
  {
    streams.push_back(std::move(other));
  }
  Stream read{"read aloud", {}};
  for (const std::string& path : speech.empty() ? speech : listSoundFiles(speech))
  {
    const Samples samples = readAudioFile(path);
    read.samples.insert(read.samples.end(), samples.begin(), samples.end());
  }
  if (!read.samples.empty())
  {
    streams.push_back(std::move(read));
  }
  return streams;
}

/// Most memory that this process held [MB].
double peakMb()
{
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);)
  {
    if (line.rfind("VmHWM:", 0) == 0)
    {
      return std::strtod(line.c_str() + 6, nullptr) / 1024.0;
    }
  }
  return std::numeric_limits<double>::quiet_NaN();
}

struct Cost
{
  double load_s = 0.0;
  double resident_mb = 0.0;
};

/// Loads and takes a few seconds of sound in a child process, so that nothing of the others is counted.
/// @param load  empty: the process alone.
Cost costOf(const std::function<std::unique_ptr<Listener>()>& load, const Samples& sound)
{
  int ends[2] = {};
  if (pipe(ends) != 0)
  {
    throw std::runtime_error("no pipe can be made");
  }
  std::cout.flush();
  std::fflush(nullptr);
  const pid_t child = fork();
  if (child == 0)
  {
    Cost cost;
    try
    {
      const auto start = std::chrono::steady_clock::now();
      const std::unique_ptr<Listener> listener = load ? load() : nullptr;
      cost.load_s = pi_node::secondsSince(start);
      if (listener != nullptr)
      {
        listen(listener.get(), sound);
      }
      cost.resident_mb = peakMb();
    }
    catch (const std::exception& error)
    {
      std::cerr << "bench_speech: " << error.what() << "\n";
      _exit(EXIT_FAILURE);
    }
    _exit(write(ends[1], &cost, sizeof cost) == static_cast<ssize_t>(sizeof cost) ? EXIT_SUCCESS : EXIT_FAILURE);
  }
  close(ends[1]);
  Cost cost;
  const bool got = child > 0 && read(ends[0], &cost, sizeof cost) == static_cast<ssize_t>(sizeof cost);
  close(ends[0]);
  int status = 0;
  if (child > 0)
  {
    waitpid(child, &status, 0);
  }
  if (!got)
  {
    throw std::runtime_error("the child process that measures memory ended without a result");
  }
  return cost;
}

double percent(size_t part, size_t all)
{
  return all == 0 ? std::numeric_limits<double>::quiet_NaN()
                  : 100.0 * static_cast<double>(part) / static_cast<double>(all);
}

struct Arguments
{
  std::string list;
  std::string commands;
  std::vector<std::string> noises;
  std::vector<std::string> speech;
  RecognizerOptions recognizer;
  int every = 5;
};

void printClips(const std::vector<Contender>& contenders, const std::vector<Clip>& clips)
{
  const auto count = [&](const std::function<bool(const Clip&)>& is)
  { return static_cast<size_t>(std::count_if(clips.begin(), clips.end(), is)); };
  const size_t commands = count(isCommand);
  const size_t background = count([](const Clip& clip) { return clip.word == "_silence_"; });
  const size_t other = clips.size() - commands - background;
  std::printf("%zu commands, %zu of other speech, %zu of background\n\n", commands, other, background);
  std::printf("%-24s %6s %6s %6s  %6s %6s  %6s  %8s %7s %7s  %9s\n", "", "right", "wrong", "none", "other", "backgr",
              "second", "latency", "p95", "early", "processor");
  std::printf("%-24s %6s %6s %6s  %6s %6s  %6s  %8s %7s %7s  %9s\n", "", "[%]", "[%]", "[%]", "[%]", "[%]", "[%]",
              "[ms]", "[ms]", "[%]", "[ms/s]");
  for (const Contender& c : contenders)
  {
    std::printf("%-24s %6.1f %6.1f %6.1f  %6.1f %6.1f  %6.1f  %8.0f %7.0f %7.1f  %9.1f\n", c.name.c_str(),
                percent(c.right, commands), percent(c.wrong, commands), percent(c.none, commands),
                percent(c.false_other, other), percent(c.false_background, background), percent(c.more, clips.size()),
                quantile(c.latencies_ms, 0.5), quantile(c.latencies_ms, 0.95), percent(c.early, c.latencies_ms.size()),
                1e3 * c.processor_s / c.sound_s);
  }
  std::printf("\n%-24s %12s %12s %6s %6s\n", STOP, "latency [ms]", "p95 [ms]", "fast", "right");
  for (const Contender& c : contenders)
  {
    std::printf("%-24s %12.0f %12.0f %6zu %6zu\n", c.name.c_str(), quantile(c.stop_ms, 0.5), quantile(c.stop_ms, 0.95),
                c.fast_stops, c.stop_ms.size());
  }
}

void printStreams(const std::vector<Contender>& contenders, const std::vector<Stream>& streams)
{
  std::printf("\ncommands per 10 minutes of streams without any, of which \"%s\"\n", STOP);
  for (const Stream& stream : streams)
  {
    const double seconds = static_cast<double>(stream.samples.size()) / SAMPLE_RATE_HZ;
    std::printf("%s, %.0f s\n", stream.name.c_str(), seconds);
    for (const Contender& contender : contenders)
    {
      contender.listener->begin();
      const StreamResult result = listen(contender.listener.get(), stream.samples);
      std::printf("  %-24s %6.1f %6.1f   processor %.1f ms/s\n", contender.name.c_str(),
                  600.0 / seconds * static_cast<double>(result.commands),
                  600.0 / seconds * static_cast<double>(result.stops), 1e3 * result.processor_s / seconds);
    }
  }
}

void run(const Arguments& line)
{
  const CommandTable table = CommandTable::load(line.commands);
  std::vector<Contender> contenders;
  const auto add = [&](const std::string& name, RecognitionMode mode)
  {
    RecognizerOptions options = line.recognizer;
    options.mode = mode;
    Contender contender;
    contender.name = name;
    contender.load = [options, &table] { return std::make_unique<Ours>(options, table); };
    contenders.push_back(std::move(contender));
  };
  add("CommandRecognizer safe", RecognitionMode::SAFE);
  add("CommandRecognizer closed", RecognitionMode::CLOSED);
  Contender plain;
  plain.name = "plain PocketSphinx";
  plain.load = [&line, &table] { return std::make_unique<PlainRecipe>(line.recognizer.sphinx, table); };
  contenders.push_back(std::move(plain));

  std::printf("%s, chunks of 20 ms, commands of %s, every %d-th clip\n\n", machineName().c_str(),
              fs::path(line.commands).filename().c_str(), line.every);
  // Memory first: children begin with what the process has by then.
  NoiseSource pink("pink", 1);
  std::vector<float> noise = pink.next(static_cast<size_t>(SILENCE_S) * SAMPLE_RATE_HZ);
  const double power =
      std::inner_product(noise.begin(), noise.end(), noise.begin(), 0.0) / static_cast<double>(noise.size());
  const double gain = 32768.0 * std::pow(10.0, SILENCE_DBFS / 20.0) / std::sqrt(power);
  Samples silence(noise.size());
  std::transform(noise.begin(), noise.end(), silence.begin(),
                 [gain](float value) { return static_cast<int16_t>(std::lround(gain * value)); });
  noise = {};
  const Samples some(silence.begin(), silence.begin() + 5 * SAMPLE_RATE_HZ);
  const Cost alone = costOf({}, some);
  std::printf("%-24s %10s %12s %22s\n", "", "load [ms]", "memory [MB]", "processor in silence");
  for (const Contender& contender : contenders)
  {
    std::vector<double> loads;
    double memory_mb = 0.0;
    for (int i = 0; i < 4; ++i)  // the first one reads the files
    {
      const Cost cost = costOf(contender.load, some);
      memory_mb = std::max(memory_mb, cost.resident_mb);
      if (i > 0)
      {
        loads.push_back(1e3 * cost.load_s);
      }
    }
    const StreamResult quiet = listen(contender.load().get(), silence);
    std::printf("%-24s %10.0f %12.0f %20.2f %%\n", contender.name.c_str(), quantile(loads, 0.5), memory_mb,
                100.0 * quiet.processor_s / SILENCE_S);
  }
  std::printf("(the process alone holds %.0f MB; silence: %d s of pink noise at %.0f dBFS)\n\n", alone.resident_mb,
              SILENCE_S, SILENCE_DBFS);
  std::fflush(stdout);

  const std::vector<Clip> clips = readClips(line.list, line.every);
  size_t turn = 0;
  for (const Clip& clip : clips)
  {
    ++turn;
    for (size_t i = 0; i < contenders.size(); ++i)
    {
      take(clip, &contenders[(i + turn) % contenders.size()]);
    }
  }
  printClips(contenders, clips);
  std::fflush(stdout);
  printStreams(contenders, readStreams(clips, line.noises, line.speech));
}

bool parse(int argc, char** argv, Arguments* line)
{
  RecognizerOptions& recognizer = line->recognizer;
  recognizer = withDefaultModels();
  recognizer.sphinx.check_model = false;  // the time of loading is that of the models
  line->commands = packageFile("commands.yaml");
  pi_node::CommandLine options("bench_speech [options] LIST.tsv (columns file, word)");
  options.addValue("commands", &line->commands, "table of commands, YAML");
  options.addValue("every", &line->every, "take every n-th clip of each word");
  options.add("noise", po::value(&line->noises)->multitoken(),
              "sound files or folders, looped: streams without commands");
  options.add("speech", po::value(&line->speech)->multitoken(), "sound files or folders: streams of talk");
  options.addValue("threshold", &recognizer.threshold, "least confidence, in (0, 1)");
  options.addValue("word-network", &recognizer.word_network, "network that hears words in the stream; none: without");
  options.addValue("confidence", &recognizer.confidence, "weights of the confidence");
  options.addValue("garbage-words", &recognizer.garbage_words, "of other speech");
  options.addPositional("list", &line->list, "no list of clips is named");
  if (!options.parse(argc, argv))
  {
    return false;
  }
  if (line->every < 1)
  {
    throw po::error("--every " + std::to_string(line->every) + ", must be at least 1");
  }
  if (recognizer.word_network == "none")
  {
    recognizer.word_network.clear();
  }
  recognizer.validate();
  return true;
}

}  // namespace

int main(int argc, char** argv)
{
  Arguments line;
  return pi_node::runTool(
      "bench_speech", [&] { return parse(argc, argv, &line); },
      [&]
      {
        run(line);
        return EXIT_SUCCESS;
      });
}
