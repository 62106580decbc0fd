"""Logistic regression with a ridge, by Newton's method (iteratively reweighted least squares)."""

from dataclasses import dataclass

import numpy as np

from pi_speech.errors import ToolError

MOST_STEPS = 100
TOLERANCE = 1e-9  # of the largest change of a weight, in units of standardised features


@dataclass
class Logistic:
    """ln(p / (1 - p)) = bias + features @ weights"""

    weights: np.ndarray
    bias: float

    def logits(self, features):
        return features @ self.weights + self.bias


def sigmoid(logits):
    return 0.5 * (1.0 + np.tanh(0.5 * np.asarray(logits, float)))


def fit(features, labels, ridge):
    """Minimises the sum of -ln p(label) plus ridge / 2 times the squares of the weights of the features in units of
    their standard deviation; the bias is free. A feature that is constant gets the weight 0.
    @param features  n x m
    @param labels    n booleans, both kinds there
    @param ridge     > 0, so that there is one minimum even where the labels can be told apart without error
    @throws ToolError if it does not converge"""
    mean, deviation = features.mean(axis=0), features.std(axis=0)
    varies = deviation > 1e-12 * (1.0 + np.abs(mean))
    scaled = (features[:, varies] - mean[varies]) / deviation[varies]
    design = np.column_stack([np.ones(len(scaled)), scaled])
    penalty = np.full(design.shape[1], float(ridge))
    penalty[0] = 0.0
    positive = np.asarray(labels, float)
    solution = np.zeros(design.shape[1])
    solution[0] = np.log(positive.mean() / (1.0 - positive.mean()))

    def loss(candidate):
        logits = design @ candidate
        return np.logaddexp(0.0, logits).sum() - positive @ logits + 0.5 * penalty @ candidate**2

    best = loss(solution)
    for _ in range(MOST_STEPS):
        probability = sigmoid(design @ solution)
        gradient = design.T @ (probability - positive) + penalty * solution
        curvature = (design * (probability * (1.0 - probability))[:, None]).T @ design + np.diag(penalty)
        step = np.linalg.lstsq(curvature, gradient, rcond=None)[0]
        size = 1.0
        while size > 1e-6 and loss(solution - size * step) > best + 1e-12 * abs(best):  # Newton's step may overshoot
            size /= 2
        solution = solution - size * step
        best = loss(solution)
        if np.abs(size * step).max() < TOLERANCE:
            break
    else:
        raise ToolError(f"the fit does not converge in {MOST_STEPS} steps: give a larger --ridge than {ridge:g}")
    weights = np.zeros(features.shape[1])
    weights[varies] = solution[1:] / deviation[varies]
    return Logistic(weights, float(solution[0] - weights @ mean))
