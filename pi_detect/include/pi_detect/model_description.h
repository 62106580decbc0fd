#pragma once

#include <pi_detect/detection.h>

#include <array>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>

namespace pi_detect
{

/// An error in a model's description or files, or of OpenCV when it loads them. Names file, value and way out.
class ModelError : public std::runtime_error
{
  using std::runtime_error::runtime_error;
};

/// A file of a model.
struct ModelFile
{
  std::string path;    ///< absolute; empty: there is none
  std::string sha256;  ///< 64 hexadecimal digits; empty: not checked
};

/// How a picture fills the network's input.
enum class InputFit
{
  STRETCH,             ///< to width x height
  LETTERBOX,           ///< keeps its aspect ratio, centred between bars
  LETTERBOX_TOP_LEFT,  ///< keeps its aspect ratio, bars at the right or below
};

/// How a picture becomes the network's input: planes of (value - mean) * scale.
struct NetworkInput
{
  int width = 300;                                ///< [px]
  int height = 300;                               ///< [px]
  std::array<float, 3> mean{{0.0F, 0.0F, 0.0F}};  ///< of the planes, in their order
  std::array<float, 3> scale{{1.0F, 1.0F, 1.0F}};
  bool rgb = true;  ///< order of the planes; false: BGR
  InputFit fit = InputFit::STRETCH;
  int bar_level = 114;  ///< grey level of the bars
};

/// Format of the network's outputs.
enum class OutputKind
{
  DETECTIONS,  ///< rows [image, class, score, x1, y1, x2, y2] of a DetectionOutput layer, corners in parts of the input
  GRID,        ///< per cell: centre, logarithm of the size, objectness, scores (YOLOX)
  DISTRIBUTION,  ///< per cell: scores, and a distribution of the distance to each side of the box (NanoDet, PicoDet)
};
const char* toString(OutputKind kind);  ///< "detections", "grid", "distribution"

/// Outputs of kinds GRID and DISTRIBUTION: at most one box per cell, that of its best class. Each stride has a feature
/// map with cells of stride x stride [px of the input]. Cells are in the order: stride, row, column.
///
/// GRID is one output of cells x (5 + classes): x, y, width, height, objectness, scores. A box has its centre at
/// ((column + offset + x) * stride, (row + offset + y) * stride) and the size exp(width) * stride, exp(height) *
/// stride; a score counts times the objectness (Ge et al. 2021, YOLOX).
///
/// DISTRIBUTION has scores (classes per cell) and distances (4 x bins per cell: left, top, right, bottom), as two
/// outputs per stride or as one output for all cells, with the scores first. A distance is sum(k * softmax(bins)_k) *
/// stride from the point ((column + offset) * stride, (row + offset) * stride) (Li et al. 2020, Generalized Focal
/// Loss).
struct CellOutputs
{
  std::vector<int> strides{8, 16, 32};
  float offset = 0.0F;   ///< [cells]; usual: 0 for GRID, 0.5 for DISTRIBUTION
  int bins = 8;          ///< of DISTRIBUTION
  bool sigmoid = false;  ///< objectness and scores are logits; false: the network has applied the sigmoid
  int classes = 0;
  float overlap_threshold = 0.5F;  ///< of suppression per class
  int top_k = 1000;                ///< candidates of all classes
  int keep_top_k = 100;            ///< detections at most
};

/// A network that finds objects, for OpenCV, as a YAML file describes it; config/models/ shows every field.
struct ModelDescription
{
  std::string name;   ///< letters, digits, _ and -: part of the codelet's name
  std::string path;   ///< of the YAML file
  ModelFile weights;  ///< .caffemodel, .pb, .onnx, or a .prototxt of a network without learned weights; of several that
                      ///< the description allows, the first that is there
  ModelFile config;   ///< .prototxt or .pbtxt, where the format has one
  NetworkInput input;
  OutputKind output_kind = OutputKind::DETECTIONS;
  CellOutputs cells;
  /// Class id (but for DETECTIONS: column of the scores) to name; detections of other ids are dropped.
  std::map<int, std::string> labels;
  float score_threshold = 0.5F;         ///< for users who set none
  TrackerScores tracker;                ///< likewise
  float class_agnostic_overlap = 0.0F;  ///< likewise; 0: no suppression across classes
  std::string fallback;                 ///< name of the network in its place without weights; empty: none
  std::string origin;                   ///< source of the model, for people
  std::string licence;

  /// Reads and validates a YAML file. Relative paths in it start at its folder, or where nothing is there, at one of
  /// weightsFolders(); "${NAME}" stands for a variable of the environment. Does not open the network's files.
  /// @throws ModelError naming file, field, value and bound.
  static ModelDescription load(const std::string& path);

  /// @throws ModelError naming field, value and bound.
  void validate() const;
  /// The id of a class name, or -1.
  int idOf(const std::string& label) const;
};

/// SHA-256 of a file's content, as 64 hexadecimal digits. @throws ModelError if it cannot be read.
std::string sha256OfFile(const std::string& path);

}  // namespace pi_detect
