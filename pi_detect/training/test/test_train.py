#!/usr/bin/python3
"""Trains, stops, goes on and exports on a made set of pictures: coloured rectangles on grey."""

import contextlib
import csv
import hashlib
import io
import json
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np
from PIL import Image

sys.path[:0] = [str(Path(__file__).resolve().parent), str(Path(__file__).resolve().parents[1])]

try:
    import cv2
    import onnx
    import torch
    import yaml
except ImportError:
    raise unittest.SkipTest("PyTorch, ONNX or OpenCV is not installed (Debian: python3-torch, python3-onnx, "
                            "python3-opencv)")

import export
import tiny_teacher
import train
from label_set import CLASSES

CONFIG = {
    "seed": 1, "epochs": 3, "batch": 4, "learning_rate": 0.005, "weight_decay": 0.01, "warm_up_steps": 2,
    "average_decay": 0.9, "box_weight": 2.0, "distribution_weight": 0.5, "distillation_weight": 0.1,
    "input_sizes": [[0, 160], [2, 192]], "epochs_without_mosaics": 1, "validate_every": 2, "source_weights": {},
    "augment": {"mosaic": 0.2},
    "network": {"bins": 8, "stem": [4, 8], "channels": [8, 12, 16], "blocks": [1, 1, 1], "head_channels": 8}}


def make_set(folder, count):
    """Half of the pictures are for training, with one "person" or one "car" each."""
    rng = np.random.default_rng(7)
    entries = []
    (folder / "images").mkdir(parents=True)
    for i in range(count):
        pixels = np.full((80, 100, 3), 120, np.uint8)
        x, y = int(rng.integers(0, 60)), int(rng.integers(0, 40))
        name, colour = (("person", (250, 20, 20)), ("car", (20, 20, 250)))[i % 2]
        pixels[y:y + 36, x:x + 30] = colour
        Image.fromarray(pixels).save(folder / "images" / f"{i}.png")
        entries.append({"image": f"images/{i}.png", "width": 100, "height": 80, "source": "made", "labels": "human",
                        "split": "train" if i < count // 2 else "val", "human_classes": ["person", "car"],
                        "boxes": [[name, x, y, x + 30, y + 36, 1.0]], "ignore_boxes": []})
    (folder / "labels.json").write_text(json.dumps(entries))


class Training(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)
        self.data = self.folder / "data"
        make_set(self.data, 32)
        tiny_teacher.write(self.folder / "teacher.onnx")

    def train(self, name, epochs):
        work = self.folder / name
        work.mkdir(exist_ok=True)
        with contextlib.redirect_stdout(io.StringIO()):
            train.train({**CONFIG, "epochs": epochs}, self.data, work, self.folder / "teacher.onnx", 1)
        return work

    def log(self, work):
        with open(work / "log.csv", newline="") as file:
            return list(csv.DictReader(file))

    def test_a_run_goes_on_after_its_last_epoch(self):
        work = self.train("run", 2)
        self.assertEqual([row["epoch"] for row in self.log(work)], ["0", "1"])
        self.assertNotEqual(self.log(work)[1]["ap_human_person"], "")
        self.assertEqual(len(json.loads((work / "teacher.json").read_text())), 32)
        self.train("run", 3)
        rows = self.log(work)
        self.assertEqual([row["epoch"] for row in rows], ["0", "1", "2"])
        self.assertEqual([row["input_size"] for row in rows], ["160", "160", "192"])
        self.assertEqual(torch.load(work / "checkpoint.pt")["epoch"], 2)
        self.assertEqual(list(work.glob("*.partial")), [])

    def test_a_second_run_in_the_same_folder_is_refused(self):
        first = train.claim(self.folder)
        number = (self.folder / "pid").read_text().strip()
        with self.assertRaisesRegex(RuntimeError, f"in use by process {number}"):
            train.claim(self.folder)
        first.close()
        train.claim(self.folder).close()

    def test_the_exported_network_answers_alike_in_opencv(self):
        work = self.train("run", 1)
        sys.argv = ["export.py", "--data", str(self.data), "--work", str(work), "--output", str(work / "net.onnx")]
        with contextlib.redirect_stdout(io.StringIO()) as output:
            export.main()
        self.assertIn("largest difference to PyTorch", output.getvalue())
        description = yaml.safe_load((work / "net.yaml").read_text())
        self.assertEqual(description["labels"], dict(enumerate(CLASSES)))
        self.assertEqual(description["weights"],
                         {"file": "net.onnx", "sha256": hashlib.sha256((work / "net.onnx").read_bytes()).hexdigest()})
        operators = {node.op_type for node in onnx.load(str(work / "net.onnx")).graph.node}
        self.assertNotIn("BatchNormalization", operators)
        self.assertNotIn("Identity", operators)
        size = description["input"]["width"]
        network = cv2.dnn.readNet(str(work / "net.onnx"))
        network.setInput(np.zeros((1, 3, size, size), np.float32))
        rows = sum((size // stride) ** 2 for stride in description["output"]["strides"])
        self.assertEqual(network.forward().shape[-2:], (rows, len(CLASSES) + 4 * description["output"]["bins"]))


if __name__ == "__main__":
    unittest.main()
