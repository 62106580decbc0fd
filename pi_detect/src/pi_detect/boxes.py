"""Areas and overlaps of corner boxes (NumPy only): rows (x1, y1, x2, y2), all in one common unit."""

import numpy as np


def area(boxes):
    """Areas of corner boxes; an inverted box has none."""
    sides = np.maximum(boxes[..., 2:] - boxes[..., :2], 0)
    return sides[..., 0] * sides[..., 1]


def intersection(a, b):
    """Common area of every corner box of a (n) with every one of b (m): n x m."""
    # Axis by axis: several times faster than arrays of n x m x 2, and matching is most of a training sample's time.
    sides = [np.minimum(a[:, None, axis + 2], b[None, :, axis + 2]) - np.maximum(a[:, None, axis], b[None, :, axis])
             for axis in range(2)]
    return np.maximum(sides[0], 0) * np.maximum(sides[1], 0)


def iou(a, b):
    """Intersection over union of every corner box of a (n) with every one of b (m): n x m in 0..1."""
    common = intersection(a, b)
    union = area(a)[:, None] + area(b)[None, :] - common
    return common / np.maximum(union, 1e-12)
