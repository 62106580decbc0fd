#!/usr/bin/python3
import sys
import tempfile
import unittest
from pathlib import Path

import yaml

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import model_description


class ModelDescription(unittest.TestCase):
    def test_says_what_the_decoder_needs(self):
        with tempfile.TemporaryDirectory() as folder:
            weights = Path(folder) / "net_1.onnx"
            weights.write_bytes(b"weights")
            path = weights.with_suffix(".yaml")
            model_description.write(path, model_description.describe(weights, 224, (8, 16), 7, ("cat", "dog"), 30))
            description = yaml.safe_load(path.read_text())
        self.assertEqual(description["name"], "net_1")
        self.assertEqual(description["weights"]["file"], "net_1.onnx")
        self.assertEqual(len(description["weights"]["sha256"]), 64)
        output = description["output"]
        self.assertEqual((output["kind"], output["strides"], output["bins"]), ("distribution", [8, 16], 7))
        self.assertEqual(description["labels"], {0: "cat", 1: "dog"})
        self.assertLess(description["tracker"]["low_score"], description["tracker"]["high_score"])
        self.assertIn("30 epochs", description["origin"])
        self.assertAlmostEqual(description["input"]["scale"] * 127.5, 1.0, places=7)


if __name__ == "__main__":
    unittest.main()
