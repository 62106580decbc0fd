#!/usr/bin/python3
import sys
import unittest
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from cells import cells, non_maximum_suppression, select_detections


class Cells(unittest.TestCase):
    def test_order_is_stride_row_column(self):
        place = cells(64, (16, 32))
        self.assertEqual(place.shape, (4 * 4 + 2 * 2, 3))
        np.testing.assert_allclose(place[:5], [[8, 8, 16], [24, 8, 16], [40, 8, 16], [56, 8, 16], [8, 24, 16]])
        np.testing.assert_allclose(place[16:], [[16, 16, 32], [48, 16, 32], [16, 48, 32], [48, 48, 32]])

    def test_the_offset_moves_the_points_within_their_cells(self):
        np.testing.assert_allclose(cells(32, (16,), offset=0.0)[:, :2], [[0, 0], [16, 0], [0, 16], [16, 16]])


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
        boxes = np.asarray([[0, 0, 1, 1], [0, 0, 1, 1.05], [0, 0, 1, 1.02]], float)
        scores = np.asarray([[0.2, 0.9], [0.6, 0.1], [0.5, 0.3]])
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
