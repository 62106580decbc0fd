"""Cells of an anchor-free head, and the choice of boxes among them (NumPy only).

Corner boxes are rows (x1, y1, x2, y2), all in one common unit.
"""

import numpy as np

import package_path  # noqa: F401  (leads to the next one)
from pi_detect.boxes import iou


def cells(size, strides, offset=0.5):
    """Rows (x, y, stride) [px of the input] of all cells of a square input, by stride, row, column.

    @param offset  of a cell's point from its top left corner, in cells
    """
    maps = []
    for stride in strides:
        points = (np.arange(-(-size // stride)) + offset) * stride
        x, y = np.meshgrid(points, points)
        maps.append(np.stack([x.ravel(), y.ravel(), np.full(x.size, stride)], 1))
    return np.concatenate(maps).astype(np.float32)


def non_maximum_suppression(boxes, scores, threshold):
    """Greedy suppression: indices of the kept corner boxes, best score first; no kept pair exceeds the threshold."""
    order = np.argsort(-scores, kind="stable")
    overlaps = iou(boxes[order], boxes[order]) > threshold
    alive = np.ones(len(order), bool)
    kept = []
    for i in range(len(order)):
        if alive[i]:
            kept.append(order[i])
            alive[i + 1:] &= ~overlaps[i, i + 1:]
    return np.asarray(kept, np.int64)


def select_detections(boxes, scores, score_threshold=0.01, nms_iou=0.6, candidates=300, total=100):
    """Boxes (n x 4) and scores (n x classes) of one picture's cells to rows [class, score, x1, y1, x2, y2], best first.

    As pi_detect's CellDecoder: a cell gives its best class only; boxes of one class suppress each other.
    """
    labels, best = scores.argmax(1), scores.max(1)
    chosen = np.flatnonzero(best >= score_threshold)
    chosen = chosen[np.argsort(-best[chosen], kind="stable")][:candidates]
    # Far apart, boxes of different classes do not overlap.
    apart = boxes[chosen] + (labels[chosen] * 2.0 * (np.abs(boxes).max(initial=0) + 1))[:, None]
    chosen = chosen[non_maximum_suppression(apart, best[chosen], nms_iou)][:total]
    return np.column_stack([labels[chosen], best[chosen], boxes[chosen]]).reshape(-1, 6)
