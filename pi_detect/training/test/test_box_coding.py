#!/usr/bin/python3
import sys
import unittest
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from box_coding import (BACKGROUND, IGNORED, decode, encode, match, non_maximum_suppression, select_detections,
                        to_centres, to_corners)

VARIANCES = (0.1, 0.2)


def random_corners(rng, count):
    low = rng.uniform(0, 0.8, (count, 2))
    return np.concatenate([low, low + rng.uniform(0.05, 0.5, (count, 2))], 1)


class BoxCoding(unittest.TestCase):
    def test_corner_and_centre_boxes_convert_both_ways(self):
        boxes = random_corners(np.random.default_rng(1), 50)
        np.testing.assert_allclose(to_corners(to_centres(boxes)), boxes, atol=1e-12)

    def test_codes_follow_the_formula_of_the_paper(self):
        prior = np.asarray([[0.5, 0.5, 0.2, 0.4]])
        box = to_corners(np.asarray([[0.52, 0.46, 0.4, 0.4]]))
        expected = [[0.02 / 0.2 / 0.1, -0.04 / 0.4 / 0.1, np.log(2.0) / 0.2, 0.0]]
        np.testing.assert_allclose(encode(box, prior, VARIANCES), expected, atol=1e-5)

    def test_decode_inverts_encode(self):
        rng = np.random.default_rng(2)
        boxes, priors = random_corners(rng, 100), to_centres(random_corners(rng, 100))
        np.testing.assert_allclose(decode(encode(boxes, priors, VARIANCES), priors, VARIANCES), boxes, atol=1e-5)

    def test_zero_code_is_the_prior(self):
        priors = to_centres(random_corners(np.random.default_rng(3), 10))
        np.testing.assert_allclose(decode(np.zeros((2, 10, 4)), priors, VARIANCES)[1], to_corners(priors))


class Matching(unittest.TestCase):
    def setUp(self):
        x = np.arange(10) * 1.0
        self.priors = np.stack([x, np.zeros(10), x + 1, np.ones(10)], 1)

    def test_a_picture_without_boxes_is_background(self):
        labels, indices = match(self.priors, np.zeros((0, 4)), np.zeros(0, int), np.zeros((0, 4)))
        self.assertTrue((labels == BACKGROUND).all())
        self.assertTrue((indices == -1).all())

    def test_the_overlapping_prior_takes_class_and_box(self):
        boxes = np.asarray([[7.1, 0, 8.1, 1], [2, 0, 3, 1]])
        labels, indices = match(self.priors, boxes, np.asarray([4, 0]), np.zeros((0, 4)))
        self.assertEqual((labels[7], indices[7]), (4, 0))
        self.assertEqual((labels[2], indices[2]), (0, 1))
        self.assertEqual((labels >= 0).sum(), 2)

    def test_priors_between_the_thresholds_are_ignored(self):
        labels, _ = match(self.priors, np.asarray([[2.4, 0, 3.4, 1]]), np.asarray([1]), np.zeros((0, 4)), forced=1)
        self.assertEqual(labels[2], 1)  # IoU 0.6 / 1.4 = 0.43, forced as the best
        labels, _ = match(self.priors, np.asarray([[2.0, 0, 3.9, 1]]), np.asarray([1]), np.zeros((0, 4)), forced=1)
        self.assertEqual(labels[2], 1)
        self.assertEqual(labels[3], IGNORED)  # IoU 0.9 / 2.0 = 0.45

    def test_a_small_box_trains_several_priors(self):
        labels, _ = match(self.priors, np.asarray([[2.5, 0, 3.5, 1]]), np.asarray([1]), np.zeros((0, 4)), forced=2)
        self.assertEqual(np.flatnonzero(labels == 1).tolist(), [2, 3])  # IoU 1/3 each

    def test_a_box_far_smaller_than_every_prior_trains_none(self):
        labels, _ = match(self.priors, np.asarray([[2.4, 0.4, 2.6, 0.6]]), np.asarray([1]), np.zeros((0, 4)))
        self.assertTrue((labels == BACKGROUND).all())

    def test_every_box_keeps_its_best_prior_against_a_better_neighbour(self):
        boxes = np.asarray([[2, 0, 3, 1], [2, 0, 3, 0.6]])
        labels, indices = match(self.priors, boxes, np.asarray([0, 5]), np.zeros((0, 4)))
        self.assertEqual((labels[2], indices[2]), (5, 1))

    def test_ignored_regions_are_no_background_but_may_hold_a_box(self):
        labels, _ = match(self.priors, np.asarray([[1, 0, 2, 1]]), np.asarray([3]), np.asarray([[0, 0, 4.4, 1]]))
        self.assertEqual(labels.tolist()[:6], [IGNORED, 3, IGNORED, IGNORED, BACKGROUND, BACKGROUND])


class Suppression(unittest.TestCase):
    def test_the_best_of_each_cluster_remains_in_order_of_score(self):
        boxes = np.asarray([[0, 0, 10, 10], [1, 0, 11, 10], [20, 0, 30, 10], [21, 0, 31, 10]], float)
        kept = non_maximum_suppression(boxes, np.asarray([0.5, 0.9, 0.95, 0.3]), 0.5)
        self.assertEqual(kept.tolist(), [2, 1])

    def test_a_suppressed_box_suppresses_nobody(self):
        boxes = np.asarray([[0, 0, 10, 1], [4, 0, 14, 1], [8, 0, 18, 1]], float)
        self.assertEqual(non_maximum_suppression(boxes, np.asarray([0.9, 0.8, 0.7]), 0.3).tolist(), [0, 2])

    def test_nothing_in_nothing_out(self):
        self.assertEqual(len(non_maximum_suppression(np.zeros((0, 4)), np.zeros(0), 0.5)), 0)
        self.assertEqual(select_detections(np.zeros((3, 4)), np.zeros((3, 2))).shape, (0, 6))

    def test_classes_are_suppressed_apart_and_sorted_together(self):
        boxes = np.asarray([[0, 0, 1, 1], [0, 0, 1, 1.05]], float)
        scores = np.asarray([[0.2, 0.9], [0.6, 0.1]])
        rows = select_detections(boxes, scores)
        np.testing.assert_allclose(rows[:, :2], [[1, 0.9], [0, 0.6]])
        np.testing.assert_allclose(rows[1, 2:], boxes[1])

    def test_the_total_is_bounded_by_the_best(self):
        x = np.arange(20.0)
        boxes = np.stack([x, x * 0, x + 0.9, x * 0 + 1], 1)
        rows = select_detections(boxes, np.linspace(0.1, 0.9, 20)[:, None], total=5)
        np.testing.assert_allclose(rows[:, 1], np.linspace(0.1, 0.9, 20)[::-1][:5])


if __name__ == "__main__":
    unittest.main()
