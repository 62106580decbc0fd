#!/usr/bin/python3
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np
from PIL import Image

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import augment
from label_set import PictureStore, Record


def make_record(width, height, box):
    """A black picture with one white box."""
    pixels = np.zeros((height, width, 3), np.uint8)
    x1, y1, x2, y2 = box
    pixels[y1:y2, x1:x2] = 255
    record = Record("box.png", width, height, "made", (), np.asarray([box], np.float32), np.asarray([2]),
                    np.asarray([0.7], np.float32), np.zeros((0, 4), np.float32), np.zeros((0, 5), np.float32))
    return record, pixels


class Augment(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.record, pixels = make_record(200, 120, (60, 30, 130, 90))
        Image.fromarray(pixels).save(Path(self.folder.name) / "box.png")
        self.store = PictureStore(self.folder.name, [self.record], Path(self.folder.name) / "cache.rgb")

    def white_box(self, pixels):
        rows, columns = np.nonzero(pixels[..., 0] > 127)
        return np.asarray([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1])

    def test_boxes_stay_on_their_objects(self):
        options = augment.AugmentOptions(expand=0)
        checked = 0
        for seed in range(40):
            rng = np.random.default_rng(seed)
            sample = augment.zoom(rng, self.store, self.record, 128, options)
            if seed % 2:
                sample = augment.mirror(sample)
            if len(sample.boxes):
                np.testing.assert_allclose(sample.boxes[0], self.white_box(sample.pixels), atol=2.5)
                checked += 1
        self.assertGreater(checked, 25)

    def test_a_mosaic_keeps_every_box_on_its_object(self):
        widths = []
        for seed in range(40):
            sample = augment.mosaic(np.random.default_rng(seed), self.store, [self.record] * 4, 128,
                                    augment.AugmentOptions())
            self.assertEqual(sample.pixels.shape, (128, 128, 3))
            for x1, y1, x2, y2 in np.round(sample.boxes).astype(int):
                self.assertGreater(sample.pixels[y1:y2, x1:x2].mean(), 200)
                widths.append(x2 - x1)
        # The box is 0.35 of the picture: at scales from 0.3 to 1.7, 13 to 76 pixels, less what the tile cuts off.
        self.assertLess(min(widths), 20)
        self.assertGreater(max(widths), 50)

    def test_a_cut_box_becomes_an_ignored_region_and_then_nothing(self):
        canvas = np.zeros((64, 64, 3), np.uint8)
        for left, boxes, ignored in ((80, 1, 0), (110, 0, 1), (127, 0, 0)):
            sample = augment.paste(np.random.default_rng(0), canvas, self.store, self.record,
                                   (left, 0.0, 200.0, 120.0), (0, 0, 64, 64))
            self.assertEqual((len(sample.boxes), len(sample.ignored_boxes)), (boxes, ignored), f"left = {left}")

    def test_a_tiny_box_is_an_ignored_region(self):
        canvas = np.zeros((12, 12, 3), np.uint8)
        sample = augment.paste(np.random.default_rng(0), canvas, self.store, self.record, (0.0, 0.0, 200.0, 120.0),
                               (0, 0, 12, 12))
        self.assertEqual((len(sample.boxes), len(sample.ignored_boxes)), (0, 1))

    def test_mirroring_twice_changes_nothing(self):
        sample = augment.zoom(np.random.default_rng(5), self.store, self.record, 96, augment.AugmentOptions())
        twice = augment.mirror(augment.mirror(sample))
        np.testing.assert_array_equal(twice.pixels, sample.pixels)
        np.testing.assert_allclose(twice.boxes, sample.boxes, atol=1e-4)

    def test_the_same_seed_gives_the_same_sample(self):
        make = lambda: augment.random_sample(np.random.default_rng([1, 2, 3]), self.store, [self.record], lambda rng: 0,
                                             96, augment.AugmentOptions())
        first, second = make(), make()
        np.testing.assert_array_equal(first.pixels, second.pixels)
        np.testing.assert_array_equal(first.boxes, second.boxes)

    def test_a_picture_of_another_size_than_its_label_is_refused(self):
        wrong, _ = make_record(100, 120, (10, 10, 50, 50))
        with self.assertRaisesRegex(ValueError, "box.png is 200x120, labels.json says 100x120"):
            PictureStore(self.folder.name, [wrong], Path(self.folder.name) / "other.rgb")


if __name__ == "__main__":
    unittest.main()
