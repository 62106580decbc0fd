#pragma once

#include <pi_detect/detection.h>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace pi_detect
{

/// A box with the identity of what is in it.
struct IdentifiedBox
{
  int64_t id = 0;
  Box box;
};

/// What a tracker made of some pictures.
struct MotMetrics
{
  int pictures = 0;
  int truth_boxes = 0;
  int track_boxes = 0;  ///< without those left out for an ignored region
  int matches = 0;
  int misses = 0;           ///< true boxes without a track
  int false_positives = 0;  ///< tracks without a true box, outside of ignored regions
  int switches = 0;         ///< true objects that are matched to another track than the last time
  int fragments = 0;        ///< interruptions: true objects matched again after pictures without a match
  double mota = 0.0;        ///< 1 - (misses + false positives + switches) / true boxes; 1 is perfect, may be negative
  double motp = 0.0;        ///< mean overlap of the matches, 0 to 1 (1 is perfect; the paper states a distance)
  double idf1 = 0.0;        ///< 2 IDTP / (true boxes + track boxes), 0 to 1
  double precision = 0.0;   ///< matches / tracks that count
  double recall = 0.0;      ///< matches / true boxes
};

/// Measures a tracker by CLEAR MOT (Bernardin and Stiefelhagen 2008) and IDF1 (Ristani et al. 2016). In each picture a
/// true object keeps the track of the picture before while they overlap enough; the rest is assigned by least sum of
/// (1 - overlap). Not thread safe.
class MotEvaluation
{
public:
  /// @param min_overlap  of a true box and a track to be the same, above 0, up to 1.
  /// @throws std::invalid_argument if it is outside of that.
  explicit MotEvaluation(double min_overlap = 0.5);
  ~MotEvaluation();
  MotEvaluation(const MotEvaluation&) = delete;
  MotEvaluation& operator=(const MotEvaluation&) = delete;

  /// Adds the next picture. A track that is not matched and has more than half of its area in one ignored region does
  /// not count. @throws std::invalid_argument if an id occurs twice among truth or tracks.
  void add(const std::vector<IdentifiedBox>& truth, const std::vector<IdentifiedBox>& tracks,
           const std::vector<Box>& ignored = {});

  MotMetrics metrics() const;

private:
  class Implementation;
  std::unique_ptr<Implementation> implementation_;
};

/// What is truly seen in some consecutive pictures of a recording.
struct TruthTracks
{
  struct Picture
  {
    std::vector<IdentifiedBox> boxes;
    std::vector<Box> ignored;
  };
  int first_frame = 0;            ///< number of the first picture, from 0
  std::vector<Picture> pictures;  ///< one per frame

  /// Reads "frame,id,x1,y1,x2,y2" lines, in any order: key frames of each id, between which boxes are interpolated.
  /// Id 0 is an ignored region. "# frames FIRST LAST" names the range, other lines with # are comments.
  /// @throws std::runtime_error naming file, line and what is wrong with it.
  static TruthTracks load(const std::string& path);
};

}  // namespace pi_detect
