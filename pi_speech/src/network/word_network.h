#pragma once

#include <pi_speech/filter_bank.h>

#include <Eigen/Core>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

namespace pi_speech
{

/// A file of a network is missing, not of this kind, truncated or damaged; names it and the way out.
struct WordNetworkError : std::runtime_error
{
  using std::runtime_error::runtime_error;
};

/// A small network that says at each moment which word has just ended: causal convolutions over the energies of bands
/// (see pi_speech/training/network). Its file holds the words, the sizes and the weights.
struct WordNetwork
{
  /// ReLU(weights * [inputs at t - (kernel - 1) * dilation, ..., t - dilation, t] + bias).
  struct Convolution
  {
    Eigen::MatrixXf weights;
    Eigen::VectorXf bias;
    int dilation = 1;
  };

  std::vector<std::string> words;   ///< in lower case; one more output stands for anything else
  int kernel = 0;                   ///< inputs of each of the layers
  Convolution stem;                 ///< over frames; its output comes with each second frame
  std::vector<Convolution> layers;  ///< each adds its output to its input
  Eigen::MatrixXf head_weights;
  Eigen::VectorXf head_bias;

  int channels() const { return static_cast<int>(stem.bias.size()); }
  /// @return number of the word, or -1.
  int find(const std::string& word) const;

  /// Reads the file that train_word_network writes: little endian, with a check sum.
  /// @throws WordNetworkError
  static std::shared_ptr<const WordNetwork> load(const std::string& path);
};

/// A WordNetwork that runs along a stream. Allocates nothing after the constructor. Not thread safe.
class WordNetworkStream
{
public:
  static constexpr int FRAMES_PER_STEP = 2;  ///< from one output to the next

  /// @param network  not null; streams may share it.
  explicit WordNetworkStream(std::shared_ptr<const WordNetwork> network);

  const WordNetwork& network() const { return *network_; }
  /// @param energies  of the next frame. @return whether there are new outputs.
  bool add(const BandEnergies& energies);
  /// Probabilities of the words, and last of anything else.
  const Eigen::VectorXf& probabilities() const { return probabilities_; }
  /// Forgets the past, because another stream begins.
  void reset();

private:
  /// The last inputs of a layer, in a ring.
  struct Past
  {
    Eigen::MatrixXf inputs;  ///< one per column
    Eigen::Index newest = 0;
  };
  void runLayers();

  const std::shared_ptr<const WordNetwork> network_;
  BandEnergies smooth_;          ///< mean energies of the last frames
  Eigen::MatrixXf stem_inputs_;  ///< normalised energies, the newest in the last column
  std::vector<Past> past_;       ///< of the layers
  Eigen::VectorXf gathered_;     ///< inputs of one layer
  Eigen::VectorXf state_;
  Eigen::VectorXf outputs_;
  Eigen::VectorXf probabilities_;
  bool first_ = true;
  int frames_ = 0;  ///< since the last output
};

}  // namespace pi_speech
