#!/usr/bin/python3
import sys
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "src"))

import numpy as np

from pi_speech.logistic_regression import fit, sigmoid


class LogisticRegression(unittest.TestCase):
    def test_known_weights_are_found_again(self):
        random = np.random.default_rng(1)
        features = random.normal(size=(40000, 3)) * [1.0, 5.0, 0.1] + [0.0, 3.0, -1.0]
        weights, bias = np.array([1.5, -0.2, 4.0]), 0.7
        labels = random.random(len(features)) < sigmoid(features @ weights + bias)
        found = fit(features, labels, 1e-3)
        # One standard error of a weight is about 0.013 in units of standardised features.
        np.testing.assert_allclose(found.weights * [1.0, 5.0, 0.1], weights * [1.0, 5.0, 0.1], atol=0.06)
        self.assertAlmostEqual(float(found.logits(np.array([0.0, 3.0, -1.0]))), -0.6 - 4.0 + 0.7, delta=0.08)

    def test_the_gradient_is_zero_at_the_solution(self):
        random = np.random.default_rng(2)
        features = random.normal(size=(300, 2)) * [2.0, 30.0]
        labels = features[:, 0] + random.normal(size=300) > 0.5
        ridge, deviation = 2.0, features.std(axis=0)
        found = fit(features, labels, ridge)
        residual = sigmoid(found.logits(features)) - labels
        self.assertAlmostEqual(float(residual.sum()), 0.0, places=6)
        scaled = (features - features.mean(axis=0)) / deviation
        np.testing.assert_allclose(scaled.T @ residual + ridge * found.weights * deviation, 0.0, atol=1e-6)

    def test_labels_that_can_be_told_apart_have_finite_weights(self):
        features = np.linspace(-1.0, 1.0, 100)[:, None]
        found = fit(features, features[:, 0] > 0.0, 1.0)
        self.assertTrue(np.isfinite(found.weights).all())
        self.assertGreater(found.weights[0], 1.0)
        self.assertGreater(fit(features, features[:, 0] > 0.0, 0.01).weights[0], found.weights[0])

    def test_a_constant_feature_has_no_weight(self):
        features = np.column_stack([np.linspace(-1.0, 1.0, 50), np.full(50, 3.0)])
        found = fit(features, np.arange(50) % 3 == 0, 1.0)
        self.assertEqual(found.weights[1], 0.0)
        self.assertAlmostEqual(float(sigmoid(found.logits(features)).mean()), 17 / 50, places=6)


if __name__ == "__main__":
    unittest.main()
