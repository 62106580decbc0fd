#!/usr/bin/python3
import json
import sys
import unittest
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from priors import PriorLayout


class Priors(unittest.TestCase):
    def test_count_is_the_sum_over_the_maps(self):
        for size, cells in ((256, (32, 16, 8, 4, 2)), (288, (36, 18, 9, 5, 3)), (192, (24, 12, 6, 3, 2))):
            layout = PriorLayout(input_size=size)
            self.assertEqual(len(layout.boxes()), layout.priors_per_cell * sum(n * n for n in cells))

    def test_order_is_map_row_column_size_ratio(self):
        layout = PriorLayout(input_size=64, strides=(32,), sizes=(1.0, 2.0), aspect_ratios=(0.25, 4.0))
        boxes = layout.boxes() * 64
        np.testing.assert_allclose(boxes[:4, :2], [[16, 16]] * 4, atol=1e-4)
        np.testing.assert_allclose(boxes[:4, 2:], [[16, 64], [64, 16], [32, 128], [128, 32]], atol=1e-4)
        np.testing.assert_allclose(boxes[4, :2], [48, 16], atol=1e-4)
        np.testing.assert_allclose(boxes[8, :2], [16, 48], atol=1e-4)

    def test_description_survives_json(self):
        layout = PriorLayout(input_size=224, sizes=(1.25,), variances=(0.2, 0.1))
        self.assertEqual(PriorLayout.from_dict(json.loads(json.dumps(layout.to_dict()))), layout)

    def test_an_input_that_the_maps_cannot_share_is_refused(self):
        for size in (0, 250, -32):
            with self.assertRaisesRegex(ValueError, "multiple of 32"):
                PriorLayout(input_size=size)


if __name__ == "__main__":
    unittest.main()
