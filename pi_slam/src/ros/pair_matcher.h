#pragma once

#include <cstdint>
#include <deque>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

namespace pi_slam
{

/// Two pictures taken at the same time.
struct PicturePair
{
  int64_t stamp_ns = 0;  ///< of the left picture if there is one
  cv::Mat left;          ///< empty: missing
  cv::Mat right;
};

/// Brings pictures of two cameras together by their stamps, as they arrive and in order of time. A picture whose
/// partner is missing goes on alone once the partner can no longer come or the waiting time is over.
/// Not thread safe.
class PairMatcher
{
public:
  /// @param tolerance_s  between the stamps of a pair [s].
  /// @param wait_s       of newer pictures after which a partner is not waited for any longer [s].
  PairMatcher(double tolerance_s, double wait_s);

  /// @param camera  LEFT or RIGHT.
  /// @param pairs   gets the pairs that are complete now, oldest first.
  void add(int camera, int64_t stamp_ns, const cv::Mat& picture, std::vector<PicturePair>* pairs);

  /// Forgets the pictures that wait.
  void clear();

  uint64_t late() const { return late_; }      ///< pictures not used, as newer ones have gone on already
  uint64_t single() const { return single_; }  ///< pictures that went on alone

  /// By how much the stamps of two neighbouring pictures missed the tolerance since the last call [s]: cameras that are
  /// not triggered together. Stamps a frame or more apart are those of different pairs, whose partners were lost.
  std::optional<double> takeMismatch();

private:
  struct Picture
  {
    int64_t stamp_ns;
    cv::Mat picture;
  };
  void passOn(int camera, std::vector<PicturePair>* pairs);

  const int64_t tolerance_ns_;
  const int64_t wait_ns_;
  std::deque<Picture> waiting_[2];
  int64_t passed_ns_ = INT64_MIN;  ///< newest stamp that has gone on
  int64_t newest_ns_ = INT64_MIN;
  int64_t last_ns_[2] = {INT64_MIN, INT64_MIN};  ///< of each camera
  int64_t period_ns_ = INT64_MAX;                ///< shortest between two pictures of a camera
  uint64_t late_ = 0;
  uint64_t single_ = 0;
  std::optional<double> mismatch_s_;
};

}  // namespace pi_slam
