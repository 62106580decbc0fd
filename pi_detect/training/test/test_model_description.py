#!/usr/bin/python3
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import model_description
from priors import PriorLayout


class ModelDescription(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def describe(self, layout):
        """As the file says it."""
        weights = self.folder / "net_1.onnx"
        weights.write_bytes(b"weights")
        path = self.folder / "net_1.yaml"
        model_description.write(path, model_description.describe(weights, layout, ("cat", "dog"), 7))
        return model_description.read(path)

    def test_priors_of_the_file_are_those_of_the_layout_in_their_order(self):
        # 288 and 224 are no multiples of the coarse strides: the last cells exceed the input.
        for size in (224, 256, 288):
            layout = PriorLayout(input_size=size)
            np.testing.assert_allclose(model_description.priors(self.describe(layout)), layout.boxes(), rtol=1e-6)

    def test_says_what_the_decoder_needs(self):
        description = self.describe(PriorLayout(variances=(0.1, 0.3)))
        self.assertEqual(description["name"], "net_1")
        self.assertEqual(description["weights"]["file"], "net_1.onnx")
        self.assertEqual(len(description["weights"]["sha256"]), 64)
        self.assertEqual(description["output"]["variances"], [0.1, 0.1, 0.3, 0.3])
        self.assertEqual(description["labels"], {0: "cat", 1: "dog"})
        self.assertIn("7 epochs", description["origin"])
        self.assertAlmostEqual(description["input"]["scale"] * 127.5, 1.0, places=7)

    def test_a_file_that_is_no_description_is_refused_by_name(self):
        path = self.folder / "wrong.yaml"
        for text in ("", "[1, 2]\n", "name: x\n", "input: {width: 3}\noutput: {feature_maps: 5, variances: 1}\n"):
            path.write_text(text)
            with self.assertRaisesRegex(ValueError, "wrong.yaml"):
                model_description.read(path)


if __name__ == "__main__":
    unittest.main()
