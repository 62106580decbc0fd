#!/usr/bin/python3
import math
import sys
import unittest
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "src"))

from pi_detect.average_precision import average_precision, evaluate, label_detections

NO_BOXES = np.zeros((0, 4))


class Labels(unittest.TestCase):
    def test_a_second_detection_of_the_same_box_is_an_error(self):
        box = np.asarray([[0, 0, 10, 10]], float)
        detections = np.asarray([[0.4, 0, 0, 10, 10], [0.8, 1, 0, 10, 10]])
        self.assertEqual(label_detections(detections, box, NO_BOXES).tolist(), [0, 1])

    def test_the_next_best_box_is_taken_if_the_best_is_found_already(self):
        boxes = np.asarray([[0, 0, 10, 10], [2, 0, 12, 10]], float)
        detections = np.asarray([[0.9, 0, 0, 10, 10], [0.8, 0.5, 0, 10.5, 10]])
        self.assertEqual(label_detections(detections, boxes, NO_BOXES).tolist(), [1, 1])

    def test_detections_in_ignored_regions_do_not_count(self):
        detections = np.asarray([[0.9, 0, 0, 4, 4], [0.8, 50, 50, 60, 60]])
        self.assertEqual(label_detections(detections, NO_BOXES, np.asarray([[0, 0, 20, 20]])).tolist(), [-1, 0])

    def test_the_overlap_must_reach_the_threshold(self):
        box = np.asarray([[0, 0, 10, 10]], float)
        half = np.asarray([[0.9, 0, 0, 10, 5]])
        self.assertEqual(label_detections(half, box, NO_BOXES, 0.5).tolist(), [1])
        self.assertEqual(label_detections(half, box, NO_BOXES, 0.51).tolist(), [0])


class AveragePrecision(unittest.TestCase):
    def test_perfect_detection_is_one(self):
        self.assertEqual(average_precision([0.3, 0.9], [1, 1], 2), 1.0)

    def test_a_missed_box_costs_its_share(self):
        self.assertAlmostEqual(average_precision([0.9], [1], 4), 0.25)

    def test_known_curve(self):
        # Hit, error, hit of 2 boxes: precision 1 up to recall 0.5, then 2/3.
        self.assertAlmostEqual(average_precision([0.9, 0.8, 0.7], [1, 0, 1], 2), 0.5 + 0.5 * 2 / 3)

    def test_precision_is_made_monotone(self):
        # Error first: the precision at recall 0.5 is the later, higher 2/3.
        self.assertAlmostEqual(average_precision([0.9, 0.8, 0.7], [0, 1, 1], 2), 2 / 3)

    def test_coco_takes_the_mean_precision_at_101_recalls(self):
        # Hit, error, hit of 2 boxes: precision 1 at recalls 0 to 0.5 (51 of them), 2/3 at the 50 beyond.
        self.assertAlmostEqual(average_precision([0.9, 0.8, 0.7], [1, 0, 1], 2, "coco"), (51 + 50 * 2 / 3) / 101)
        # One of four boxes found: recalls 0 to 0.25 are reached, 26 of them.
        self.assertAlmostEqual(average_precision([0.9], [1], 4, "coco"), 26 / 101)
        self.assertEqual(average_precision([0.3, 0.9], [1, 1], 2, "coco"), 1.0)

    def test_coco_agrees_with_its_definition_on_random_detections(self):
        rng = np.random.default_rng(3)
        for count in (1, 7, 60):
            scores, labels = rng.permutation(count) / count, rng.integers(0, 2, count)
            boxes = int(labels.sum()) + 5
            points, hits = [], 0
            for rank, i in enumerate(np.argsort(-scores), 1):
                hits += labels[i]
                points.append((hits / boxes, hits / rank))
            mean = np.mean([max((p for r, p in points if r >= recall), default=0.0)
                            for recall in np.linspace(0, 1, 101)])
            self.assertAlmostEqual(average_precision(scores, labels, boxes, "coco"), mean)

    def test_an_unknown_interpolation_is_refused(self):
        with self.assertRaisesRegex(ValueError, "eleven.*area, coco"):
            average_precision([0.9], [1], 1, "eleven")

    def test_uncounted_detections_change_nothing(self):
        self.assertEqual(average_precision([0.9, 0.8, 0.7], [1, -1, 1], 2), 1.0)

    def test_no_box_gives_no_number_and_no_detection_gives_zero(self):
        self.assertTrue(math.isnan(average_precision([0.9], [0], 0)))
        self.assertTrue(math.isnan(average_precision([0.9], [0], 0, "coco")))
        self.assertEqual(average_precision([], [], 3), 0.0)
        self.assertEqual(average_precision([], [], 3, "coco"), 0.0)

    def test_scores_rank_across_pictures_and_unjudged_classes_are_left_out(self):
        box = np.asarray([[0, 0, 10, 10]], float)
        hit, error = [0, 0.6, 0, 0, 10, 10], [0, 0.9, 50, 50, 60, 60]
        detections = [np.asarray([hit]), np.asarray([error]), np.asarray([error])]
        judged = {0: (box, NO_BOXES)}
        results = evaluate(detections, [judged, {0: (NO_BOXES, NO_BOXES)}, {}], 2)
        self.assertAlmostEqual(results[0][0], 0.5)
        self.assertEqual(results[0][1], 1)
        self.assertTrue(math.isnan(results[1][0]))


if __name__ == "__main__":
    unittest.main()
