#include "network/word_network.h"

#include <pi_node/fnv1a.h>

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

// The file: MAGIC, VERSION, length and check sum of what follows, then the fields as training/network/network.py writes
// them. Numbers are little endian: int32 and IEEE 754 single precision.
constexpr char MAGIC[8] = {'P', 'I', 'W', 'N', 'E', 'T', '1', '\n'};
constexpr uint32_t VERSION = 1;
constexpr size_t HEADER_BYTES = sizeof MAGIC + sizeof(uint32_t) + 2 * sizeof(uint64_t);
constexpr int MOST_WORDS = 1000;
constexpr int MOST_WORD_BYTES = 100;
constexpr int MOST_CHANNELS = 1024;
constexpr int MOST_KERNEL = 64;
constexpr int MOST_LAYERS = 64;
constexpr int MOST_DILATION = 1024;

// Per-channel energy normalisation with the constants of Wang et al. 2017, as in training/network/front_end.py.
constexpr float SMOOTHING = 0.025F;
constexpr float GAIN_EXPONENT = 0.98F;
constexpr float OFFSET = 2.0F;

/// Takes fields from the front.
class FieldReader
{
public:
  explicit FieldReader(const std::string& bytes) : bytes_(bytes) {}

  int count(int most)
  {
    int32_t value = 0;
    take(&value, sizeof value);
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

  Eigen::MatrixXf matrix(Eigen::Index rows, Eigen::Index columns)
  {
    if (static_cast<uint64_t>(rows) * static_cast<uint64_t>(columns) * sizeof(float) > bytes_.size() - at_)
    {
      throw std::invalid_argument("it ends too early");
    }
    Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> result(rows, columns);
    take(result.data(), sizeof(float) * static_cast<size_t>(result.size()));
    if (!result.allFinite())
    {
      throw std::invalid_argument("a weight in it is not finite");
    }
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

  const std::string& bytes_;
  size_t at_ = 0;
};

WordNetwork parse(const std::string& bytes)
{
  FieldReader reader(bytes);
  WordNetwork network;
  const int words = reader.count(MOST_WORDS);
  for (int w = 0; w < words; ++w)
  {
    network.words.push_back(reader.text());
  }
  const int bands = reader.count(BANDS);
  if (bands != BANDS)
  {
    throw std::invalid_argument("it hears " + std::to_string(bands) + " bands, must be " + std::to_string(BANDS));
  }
  const int channels = reader.count(MOST_CHANNELS);
  const int stem_kernel = reader.count(MOST_KERNEL);
  network.kernel = reader.count(MOST_KERNEL);
  network.layers.resize(static_cast<size_t>(reader.count(MOST_LAYERS)));
  for (WordNetwork::Convolution& layer : network.layers)
  {
    layer.dilation = reader.count(MOST_DILATION);
  }
  network.stem.weights = reader.matrix(channels, stem_kernel * BANDS);
  network.stem.bias = reader.matrix(channels, 1);
  for (WordNetwork::Convolution& layer : network.layers)
  {
    layer.weights = reader.matrix(channels, network.kernel * channels);
    layer.bias = reader.matrix(channels, 1);
  }
  network.head_weights = reader.matrix(words + 1, channels);
  network.head_bias = reader.matrix(words + 1, 1);
  reader.requireEnd();
  return network;
}

}  // namespace

int WordNetwork::find(const std::string& word) const
{
  const auto found = std::find(words.begin(), words.end(), word);
  return found == words.end() ? -1 : static_cast<int>(found - words.begin());
}

std::shared_ptr<const WordNetwork> WordNetwork::load(const std::string& path)
{
  const std::string way_out = "; install the package again, or train the network by train_word_network";
  std::ifstream stream(path, std::ios::binary);
  if (!stream || !std::filesystem::is_regular_file(path))
  {
    throw WordNetworkError(
        path + ": the word network cannot be read: " + (stream ? "it is no file" : std::strerror(errno)) + way_out);
  }
  std::string header(HEADER_BYTES, '\0');
  stream.read(header.data(), static_cast<std::streamsize>(header.size()));
  if (!stream || std::memcmp(header.data(), MAGIC, sizeof MAGIC) != 0)
  {
    throw WordNetworkError(path + ": this is no file of a word network" + way_out);
  }
  uint32_t version = 0;
  uint64_t length = 0;
  uint64_t sum = 0;
  std::memcpy(&version, header.data() + sizeof MAGIC, sizeof version);
  std::memcpy(&length, header.data() + sizeof MAGIC + sizeof version, sizeof length);
  std::memcpy(&sum, header.data() + sizeof MAGIC + sizeof version + sizeof length, sizeof sum);
  if (version != VERSION)
  {
    throw WordNetworkError(path + ": the word network has version " + std::to_string(version) + ", must be " +
                           std::to_string(VERSION) + way_out);
  }
  const std::string bytes{std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
  if (bytes.size() != length || pi_node::fnv1a(bytes) != sum)
  {
    throw WordNetworkError(path + ": the word network is damaged: " + std::to_string(bytes.size()) + " bytes of " +
                           std::to_string(length) + ", or a wrong check sum" + way_out);
  }
  try
  {
    return std::make_shared<const WordNetwork>(parse(bytes));
  }
  catch (const std::invalid_argument& error)
  {
    throw WordNetworkError(path + ": the word network is damaged: " + error.what() + way_out);
  }
}

WordNetworkStream::WordNetworkStream(std::shared_ptr<const WordNetwork> network) : network_(std::move(network))
{
  const Eigen::Index channels = network_->channels();
  stem_inputs_.resize(BANDS, network_->stem.weights.cols() / BANDS);
  for (const WordNetwork::Convolution& layer : network_->layers)
  {
    past_.push_back({Eigen::MatrixXf(channels, (network_->kernel - 1) * layer.dilation + 1), 0});
  }
  gathered_.resize(network_->kernel * channels);
  state_.resize(channels);
  outputs_.resize(channels);
  probabilities_.resize(network_->head_bias.size());
  reset();
}

void WordNetworkStream::reset()
{
  first_ = true;
  frames_ = 0;
  stem_inputs_.setZero();
  for (Past& past : past_)
  {
    past.inputs.setZero();
  }
  probabilities_.setZero();
}

bool WordNetworkStream::add(const BandEnergies& energies)
{
  const BandEnergies linear = energies.array().exp();
  if (first_)
  {
    smooth_ = linear;
    first_ = false;
  }
  smooth_ += SMOOTHING * (linear - smooth_);
  for (Eigen::Index k = 1; k < stem_inputs_.cols(); ++k)
  {
    stem_inputs_.col(k - 1) = stem_inputs_.col(k);
  }
  stem_inputs_.rightCols<1>() =
      (linear.array() * (-GAIN_EXPONENT * smooth_.array().log()).exp() + OFFSET).sqrt() - std::sqrt(OFFSET);
  if (++frames_ < FRAMES_PER_STEP)
  {
    return false;
  }
  frames_ = 0;
  runLayers();
  return true;
}

void WordNetworkStream::runLayers()
{
  const Eigen::Index channels = network_->channels();
  state_.noalias() =
      network_->stem.weights * Eigen::Map<const Eigen::VectorXf>(stem_inputs_.data(), stem_inputs_.size());
  state_ = (state_ + network_->stem.bias).cwiseMax(0.0F);
  for (size_t i = 0; i < past_.size(); ++i)
  {
    const WordNetwork::Convolution& layer = network_->layers[i];
    Past& past = past_[i];
    const Eigen::Index size = past.inputs.cols();
    past.newest = (past.newest + 1) % size;
    past.inputs.col(past.newest) = state_;
    for (int k = 0; k < network_->kernel; ++k)
    {
      const Eigen::Index age = static_cast<Eigen::Index>(network_->kernel - 1 - k) * layer.dilation;
      gathered_.segment(k * channels, channels) = past.inputs.col((past.newest + size - age) % size);
    }
    outputs_.noalias() = layer.weights * gathered_;
    state_ += (outputs_ + layer.bias).cwiseMax(0.0F);
  }
  probabilities_.noalias() = network_->head_weights * state_;
  probabilities_ += network_->head_bias;
  probabilities_ = (probabilities_.array() - probabilities_.maxCoeff()).exp();
  probabilities_ /= probabilities_.sum();
}

}  // namespace pi_speech
