#include "hmm/forward_backward.h"

#include "hmm/word_models.h"

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <stdexcept>

namespace pi_speech
{

namespace
{

// The file: MAGIC, VERSION, length and check sum of what follows, then the fields in the order of WordModels. Numbers
// are little endian: int32 and IEEE 754 single precision.
constexpr char MAGIC[8] = {'P', 'I', 'W', 'O', 'R', 'D', 'S', '\n'};
constexpr uint32_t VERSION = 1;
constexpr int MOST_WORDS = 10000;
constexpr int MOST_STATES = 100000;
constexpr int MOST_WORD_BYTES = 1000;
constexpr size_t HEADER_BYTES = sizeof MAGIC + sizeof(uint32_t) + 2 * sizeof(uint64_t);

/// FNV-1a.
uint64_t checkSum(const std::string& bytes)
{
  uint64_t hash = 14695981039346656037ULL;
  for (const char byte : bytes)
  {
    hash = (hash ^ static_cast<unsigned char>(byte)) * 1099511628211ULL;
  }
  return hash;
}

template <typename Number>
void put(std::string* bytes, Number number)
{
  bytes->append(reinterpret_cast<const char*>(&number), sizeof number);
}

template <typename Matrix>
void putMatrix(std::string* bytes, const Matrix& matrix)
{
  bytes->append(reinterpret_cast<const char*>(matrix.data()), sizeof(float) * static_cast<size_t>(matrix.size()));
}

void putMixtures(std::string* bytes, const DiagonalMixtures& mixtures)
{
  put<int32_t>(bytes, mixtures.states);
  put<int32_t>(bytes, mixtures.components);
  putMatrix(bytes, mixtures.means);
  putMatrix(bytes, mixtures.log_variances);
  putMatrix(bytes, mixtures.log_weights);
}

/// Takes fields from the front.
class FieldReader
{
public:
  explicit FieldReader(const std::string& bytes) : bytes_(bytes) {}

  template <typename Number>
  Number number()
  {
    Number result;
    take(&result, sizeof result);
    return result;
  }

  int count(int most)
  {
    const auto value = number<int32_t>();
    if (value < 1 || value > most)
    {
      throw std::invalid_argument("a count in it is " + std::to_string(value) + ", must be in [1, " +
                                  std::to_string(most) + "]");
    }
    return value;
  }

  std::string text()
  {
    std::string result(static_cast<size_t>(count(MOST_WORD_BYTES)), '\0');
    take(result.data(), result.size());
    return result;
  }

  DiagonalMixtures mixtures()
  {
    const int states = count(MOST_STATES);
    const int components = count(1024);
    if (static_cast<uint64_t>(states) * static_cast<uint64_t>(components) * FEATURES * sizeof(float) > bytes_.size())
    {
      throw std::invalid_argument("it is too short for its " + std::to_string(states) + " states");
    }
    DiagonalMixtures result(states, components);
    takeMatrix(&result.means);
    takeMatrix(&result.log_variances);
    takeMatrix(&result.log_weights);
    return result;
  }

  void requireEnd() const
  {
    if (at_ != bytes_.size())
    {
      throw std::invalid_argument("it is longer than its content");
    }
  }

private:
  void take(void* to, size_t size)
  {
    if (bytes_.size() - at_ < size)
    {
      throw std::invalid_argument("it ends too early");
    }
    std::memcpy(to, bytes_.data() + at_, size);
    at_ += size;
  }

  template <typename Matrix>
  void takeMatrix(Matrix* matrix)
  {
    take(matrix->data(), sizeof(float) * static_cast<size_t>(matrix->size()));
  }

  const std::string& bytes_;
  size_t at_ = 0;
};

}  // namespace

int WordModels::find(const std::string& word) const
{
  const auto found = std::find(words.begin(), words.end(), word);
  return found == words.end() ? -1 : static_cast<int>(found - words.begin());
}

void WordModels::validate() const
{
  if (words.empty() || states_per_word < 1 ||
      word_mixtures.states != static_cast<int>(words.size()) * states_per_word || word_biases.size() != words.size() ||
      background.states != 1)
  {
    throw std::invalid_argument("the numbers of words, states and biases do not fit each other");
  }
  for (const std::string& word : words)
  {
    if (word.empty() || word.size() > static_cast<size_t>(MOST_WORD_BYTES))
    {
      throw std::invalid_argument("a word has " + std::to_string(word.size()) + " bytes, must be in [1, " +
                                  std::to_string(MOST_WORD_BYTES) + "]");
    }
  }
  const bool biases_are_finite =
      std::all_of(word_biases.begin(), word_biases.end(), [](float bias) { return std::isfinite(bias); });
  if (!std::isfinite(scale) || scale <= 0.0F || !biases_are_finite || !std::isfinite(filler_bias) ||
      !std::isfinite(background_bias))
  {
    throw std::invalid_argument("the scale or a bias is not finite, or the scale is not positive");
  }
  word_mixtures.validate();
  filler.validate();
  background.validate();
}

WordModels WordModels::load(const std::string& path)
{
  const std::string way_out = "; install the package again, or train the models by train_word_models";
  std::ifstream stream(path, std::ios::binary);
  if (!stream || !std::filesystem::is_regular_file(path))
  {
    throw std::runtime_error(
        path + ": the word models cannot be read: " + (stream ? "it is no file" : std::strerror(errno)) + way_out);
  }
  std::string header(HEADER_BYTES, '\0');
  stream.read(header.data(), static_cast<std::streamsize>(header.size()));
  if (!stream || std::memcmp(header.data(), MAGIC, sizeof MAGIC) != 0)
  {
    throw std::runtime_error(path + ": this is no file of word models" + way_out);
  }
  uint32_t version = 0;
  uint64_t length = 0;
  uint64_t sum = 0;
  std::memcpy(&version, header.data() + sizeof MAGIC, sizeof version);
  std::memcpy(&length, header.data() + sizeof MAGIC + sizeof version, sizeof length);
  std::memcpy(&sum, header.data() + sizeof MAGIC + sizeof version + sizeof length, sizeof sum);
  if (version != VERSION)
  {
    throw std::runtime_error(path + ": the word models have version " + std::to_string(version) + ", must be " +
                             std::to_string(VERSION) + way_out);
  }
  const std::string bytes{std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
  if (bytes.size() != length || checkSum(bytes) != sum)
  {
    throw std::runtime_error(path + ": the word models are damaged: " + std::to_string(bytes.size()) + " bytes of " +
                             std::to_string(length) + ", or a wrong check sum" + way_out);
  }
  try
  {
    FieldReader reader(bytes);
    WordModels models;
    const int words = reader.count(MOST_WORDS);
    for (int w = 0; w < words; ++w)
    {
      models.words.push_back(reader.text());
    }
    models.states_per_word = reader.count(MOST_STATES);
    models.word_mixtures = reader.mixtures();
    models.filler = reader.mixtures();
    models.background = reader.mixtures();
    models.scale = reader.number<float>();
    for (int w = 0; w < words; ++w)
    {
      models.word_biases.push_back(reader.number<float>());
    }
    models.filler_bias = reader.number<float>();
    models.background_bias = reader.number<float>();
    reader.requireEnd();
    models.validate();
    return models;
  }
  catch (const std::invalid_argument& error)
  {
    throw std::runtime_error(path + ": the word models are damaged: " + error.what() + way_out);
  }
}

void WordModels::save(const std::string& path) const
{
  validate();
  std::string bytes;
  put<int32_t>(&bytes, static_cast<int32_t>(words.size()));
  for (const std::string& word : words)
  {
    put<int32_t>(&bytes, static_cast<int32_t>(word.size()));
    bytes += word;
  }
  put<int32_t>(&bytes, states_per_word);
  putMixtures(&bytes, word_mixtures);
  putMixtures(&bytes, filler);
  putMixtures(&bytes, background);
  put(&bytes, scale);
  for (const float bias : word_biases)
  {
    put(&bytes, bias);
  }
  put(&bytes, filler_bias);
  put(&bytes, background_bias);

  std::string header(MAGIC, sizeof MAGIC);
  put(&header, VERSION);
  put<uint64_t>(&header, bytes.size());
  put(&header, checkSum(bytes));
  const std::string partial = path + ".partial";
  std::ofstream stream(partial, std::ios::binary);
  stream << header << bytes;
  stream.close();
  std::error_code error;
  if (stream)
  {
    std::filesystem::rename(partial, path, error);
  }
  if (!stream || error)
  {
    std::error_code ignored;
    std::filesystem::remove(partial, ignored);
    throw std::runtime_error(path + ": the word models cannot be written" +
                             (error ? " (" + error.message() + ")" : "") +
                             ": does the folder exist, is it yours, is the disk full?");
  }
}

WordScorer::WordScorer(const WordModels& models)
  : models_(models)
  , word_scorer_(models.word_mixtures)
  , filler_scorer_(models.filler)
  , background_scorer_(models.background)
{
  models.validate();
}

WordScorer::Scores WordScorer::score(const FeatureMatrix& features, const std::vector<WordSequence>& sequences) const
{
  const RowMatrix states = word_scorer_.score(features);
  const RowMatrix filler = filler_scorer_.score(features);
  const RowMatrix background = background_scorer_.score(features);
  RowMatrix emissions(features.rows(), states.cols() + 1);
  emissions << states, background;

  Scores result;
  for (const WordSequence& sequence : sequences)
  {
    std::vector<int> columns{static_cast<int>(states.cols())};
    float bias = 0.0F;
    for (const int word : sequence)
    {
      for (int s = 0; s < models_.states_per_word; ++s)
      {
        columns.push_back(word * models_.states_per_word + s);
      }
      columns.push_back(static_cast<int>(states.cols()));
      bias += models_.word_biases.at(static_cast<size_t>(word));
    }
    result.sequences.push_back(models_.scale * chainScore(emissions, columns, nullptr) + bias);
  }
  result.filler = models_.scale * fillerScore(filler, background, nullptr, nullptr) + models_.filler_bias;
  result.background = models_.scale * backgroundScore(background) + models_.background_bias;
  return result;
}

}  // namespace pi_speech
