#!/usr/bin/python3
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np
from PIL import Image

sys.path[:0] = [str(Path(__file__).resolve().parent), str(Path(__file__).resolve().parents[1])]

try:
    import onnx  # noqa: F401
    import torch
except ImportError:
    raise unittest.SkipTest("PyTorch or ONNX is not installed (Debian: python3-torch, python3-onnx)")

import teacher
import tiny_teacher
from cells import cells
from model import STRIDES

SIZE = teacher.SIZE


class SeesRed:
    """Stands in for Teacher: one certain person where red is, in the cell of stride 32 at its centre."""

    def __call__(self, pixels):
        place = cells(SIZE, STRIDES, offset=0.0)
        outputs = torch.full((len(pixels), len(place), 85), -12.0)
        for i, picture in enumerate(pixels.numpy().astype(int)):
            rows, columns = np.nonzero((picture[0] > 180) & (picture[1] < 90))
            if len(rows):
                low, high = np.asarray([columns.min(), rows.min()]), np.asarray([columns.max(), rows.max()]) + 1
                cell = len(place) - (SIZE // 32) ** 2
                outputs[i, cell, :2] = torch.tensor((low + high) / 2 / 32)
                outputs[i, cell, 2:4] = torch.tensor(np.log((high - low) / 32))
                outputs[i, cell, 4:6] = 6.0
        return outputs


class Teacher(unittest.TestCase):
    def test_answers_as_its_network_before_the_sigmoids(self):
        with tempfile.TemporaryDirectory() as folder:
            network = tiny_teacher.write(Path(folder) / "tiny.onnx")
            runs = teacher.Teacher(Path(folder) / "tiny.onnx")
        pixels = torch.randint(0, 256, (2, 3, 96, 96), dtype=torch.uint8, generator=torch.Generator().manual_seed(1))
        with torch.no_grad():
            expected = network(pixels.flip(1).float())
        outputs = runs(pixels)
        outputs[..., 4:] = torch.sigmoid(outputs[..., 4:])
        torch.testing.assert_close(outputs, expected, rtol=1e-4, atol=1e-4)

    def test_looks_at_the_whole_picture_and_at_its_ends(self):
        image = Image.new("RGB", (200, 100))
        self.assertEqual(teacher.views(image), [(0, 0, 200, 100), (0, 0, 130, 100), (70, 0, 200, 100)])
        self.assertEqual(teacher.views(image.transpose(Image.Transpose.ROTATE_90)),
                         [(0, 0, 100, 200), (0, 0, 100, 130), (0, 70, 100, 200)])

    def test_one_object_gives_one_box_in_pixels_of_the_picture(self):
        for box in ((20, 30, 60, 80), (150, 5, 180, 60), (90, 20, 140, 70)):  # the last is cut in both parts
            image = Image.new("RGB", (200, 100), (90, 90, 90))
            image.paste((250, 20, 20), box)
            found = teacher.look(SeesRed(), image)
            self.assertEqual(len(found), 1, box)
            self.assertEqual(found[0, 0], 0)
            np.testing.assert_allclose(found[0, 2:], box, atol=1.0)

    def test_a_picture_without_objects_has_no_box(self):
        self.assertEqual(len(teacher.look(SeesRed(), Image.new("RGB", (100, 120)))), 0)


if __name__ == "__main__":
    unittest.main()
