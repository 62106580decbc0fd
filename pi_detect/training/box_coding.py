"""Box arithmetic of the SSD: centre-size coding, matching and non-maximum suppression (NumPy only).

Corner boxes are rows (x1, y1, x2, y2), centre boxes rows (centre x, centre y, width, height), both in one common unit.
"""

import numpy as np

import package_path  # noqa: F401  (leads to the next one)
from pi_detect.boxes import area, intersection, iou

IGNORED = -1     # class of a prior that takes no part in the classification loss
BACKGROUND = -2  # class of a prior that must answer "nothing"


def to_corners(boxes):
    """Centre boxes to corner boxes."""
    half = boxes[..., 2:] / 2
    return np.concatenate([boxes[..., :2] - half, boxes[..., :2] + half], -1)


def to_centres(boxes):
    """Corner boxes to centre boxes."""
    return np.concatenate([(boxes[..., :2] + boxes[..., 2:]) / 2, boxes[..., 2:] - boxes[..., :2]], -1)


def encode(corners, priors, variances):
    """Corner boxes relative to centre-size priors of the same count (Liu et al. 2016, eq. 2, with variances)."""
    boxes = to_centres(corners)
    centre = (boxes[:, :2] - priors[:, :2]) / priors[:, 2:] / variances[0]
    size = np.log(np.maximum(boxes[:, 2:], 1e-6) / priors[:, 2:]) / variances[1]
    return np.concatenate([centre, size], -1).astype(np.float32)


def decode(codes, priors, variances):
    """Inverse of encode(): codes (... x priors x 4) to corner boxes in the unit of the priors."""
    centre = priors[:, :2] + codes[..., :2] * variances[0] * priors[:, 2:]
    size = priors[:, 2:] * np.exp(codes[..., 2:] * variances[1])
    return to_corners(np.concatenate([centre, size], -1))


def match(priors, boxes, classes, ignored_boxes, positive_iou=0.5, negative_iou=0.4, forced_iou=0.25, forced=5):
    """Assigns a box to every prior (Liu et al. 2016, section 2.2 "Matching strategy", with more forced matches).

    @param priors         corner boxes, p x 4
    @param boxes, classes  n x 4 corner boxes and n class numbers >= 0
    @param ignored_boxes  m x 4 regions with content unknown; a prior more than half inside one is never background
    @return (class per prior, or IGNORED, or BACKGROUND; index of the matched box, or -1)

    A prior takes the box it overlaps best if the IoU is at least positive_iou, or if it is one of the `forced` best
    priors of that box and the IoU is at least forced_iou: small and narrow boxes fall between the cells and would
    otherwise train one prior each. Every box keeps its best prior, even against a better box, if the IoU is at least
    forced_iou. Unmatched priors of negative_iou or more are ignored.
    """
    labels = np.full(len(priors), BACKGROUND, np.int64)
    indices = np.full(len(priors), -1, np.int64)
    if len(ignored_boxes):
        inside = intersection(priors, ignored_boxes) / np.maximum(area(priors), 1e-12)[:, None]
        labels[inside.max(1) > 0.5] = IGNORED
    if len(boxes):
        overlaps = iou(boxes, priors)
        best = overlaps.argmax(0)
        best_iou = overlaps.max(0)
        labels[best_iou >= negative_iou] = IGNORED
        positive = best_iou >= positive_iou
        top = np.argpartition(overlaps, -min(forced, len(priors)), 1)[:, -min(forced, len(priors)):]
        for box, candidates in enumerate(top):
            own = best[candidates] == box
            positive[candidates[own & (overlaps[box, candidates] >= forced_iou)]] = True
        for box, prior in enumerate(overlaps.argmax(1)):
            if overlaps[box, prior] >= forced_iou:
                best[prior] = box
                positive[prior] = True
        labels[positive] = np.asarray(classes)[best[positive]]
        indices[positive] = best[positive]
    return labels, indices


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


def select_detections(boxes, scores, score_threshold=0.01, nms_iou=0.5, per_class=200, total=100):
    """Post-processing of one picture: decoded corner boxes (p x 4) and scores (p x classes) to rows
    [class, score, x1, y1, x2, y2], best first, after suppression per class."""
    rows = []
    for label in range(scores.shape[1]):
        chosen = np.flatnonzero(scores[:, label] >= score_threshold)
        chosen = chosen[np.argsort(-scores[chosen, label], kind="stable")][:per_class]
        chosen = chosen[non_maximum_suppression(boxes[chosen], scores[chosen, label], nms_iou)]
        rows.append(np.column_stack([np.full(len(chosen), label), scores[chosen, label], boxes[chosen]]))
    rows = np.concatenate(rows)
    return rows[np.argsort(-rows[:, 1], kind="stable")][:total]
