#!/usr/bin/python3
import sys
import unittest
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "src"))

from pi_detect.boxes import iou


class Overlap(unittest.TestCase):
    def test_known_overlaps(self):
        a = np.asarray([[0, 0, 2, 2], [10, 10, 12, 12]], float)
        b = np.asarray([[1, 0, 3, 2], [0, 0, 2, 2], [2, 0, 4, 2]], float)
        np.testing.assert_allclose(iou(a, b), [[1 / 3, 1, 0], [0, 0, 0]])

    def test_a_box_without_area_overlaps_nothing(self):
        flat = np.asarray([[1, 1, 1, 5]], float)
        self.assertEqual(iou(flat, flat)[0, 0], 0)
        self.assertEqual(iou(flat, np.asarray([[0, 0, 9, 9]], float))[0, 0], 0)


if __name__ == "__main__":
    unittest.main()
