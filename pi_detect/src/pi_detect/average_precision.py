"""Average precision of detections against boxes, with regions that count neither way (NumPy only).

The trainer and evaluate_detections count with this module.
"""

import numpy as np

from pi_detect.boxes import area, intersection, iou

# How the area under the precision-recall curve is taken, after precision is made monotone: at every point (PASCAL VOC
# since 2010), or as the mean at 101 recalls 0, 0.01 .. 1 (COCO).
INTERPOLATIONS = ("area", "coco")
COCO_RECALLS = np.linspace(0.0, 1.0, 101)


def label_detections(detections, boxes, ignored_boxes, iou_threshold=0.5):
    """Labels one picture's detections of one class.

    @param detections     n x 5 rows (score, x1, y1, x2, y2)
    @param boxes          m x 4 true boxes; each is found at most once, by the best-scored detection that overlaps it
    @param ignored_boxes  k x 4; an unmatched detection more than half inside one counts neither as hit nor as error
    @return n values, in the order of the detections: 1 hit, 0 error, -1 not counted
    """
    results = np.zeros(len(detections), np.int64)
    found = np.zeros(len(boxes), bool)
    if not len(detections):
        return results
    overlaps = iou(detections[:, 1:], boxes) if len(boxes) else np.zeros((len(detections), 0))
    if len(ignored_boxes):
        inside = intersection(detections[:, 1:], ignored_boxes) / np.maximum(area(detections[:, 1:]), 1e-12)[:, None]
        excused = inside.max(1) > 0.5
    else:
        excused = np.zeros(len(detections), bool)
    for i in np.argsort(-detections[:, 0], kind="stable"):
        candidates = np.where(found, 0, overlaps[i])
        best = candidates.argmax() if len(boxes) else -1
        if best >= 0 and candidates[best] >= iou_threshold:
            found[best] = True
            results[i] = 1
        elif excused[i]:
            results[i] = -1
    return results


def precision_recall(scores, labels, box_count):
    """The curve over falling score, one point per counted detection, precision not yet made monotone.

    @param scores, labels  of all pictures' detections, labels as label_detections() gives them
    @param box_count       at least 1
    @return (precisions, recalls, hit or not), each in the order of falling score
    """
    labels = np.asarray(labels)
    scores = np.asarray(scores, float)[labels >= 0]
    labels = labels[labels >= 0]
    labels = labels[np.argsort(-scores, kind="stable")]
    hits = np.cumsum(labels)
    return hits / np.maximum(np.arange(1, len(hits) + 1), 1), hits / box_count, labels


def average_precision(scores, labels, box_count, interpolation="area"):
    """Area under the precision-recall curve with precision made monotone.

    @param scores, labels  of all pictures' detections, labels as label_detections() gives them
    @param interpolation   one of INTERPOLATIONS
    @return 0..1, or nan if there is no box to be found
    """
    if interpolation not in INTERPOLATIONS:
        raise ValueError(f"interpolation = '{interpolation}', must be one of {', '.join(INTERPOLATIONS)}")
    if box_count == 0:
        return float("nan")
    precision, recall, labels = precision_recall(scores, labels, box_count)
    precision = np.maximum.accumulate(precision[::-1])[::-1]
    if interpolation == "area":
        return float(np.sum(precision * labels) / box_count)
    # The precision at the first point that reaches each recall; recalls that are never reached count 0.
    points = np.searchsorted(recall, COCO_RECALLS, side="left")
    return float(np.append(precision, 0.0)[points].sum() / len(COCO_RECALLS))


def evaluate(detections, truth, classes, iou_threshold=0.5, interpolation="area"):
    """Average precision per class over a list of pictures.

    @param detections  per picture: n x 6 rows (class, score, x1, y1, x2, y2)
    @param truth       per picture: dict class number -> (boxes m x 4, ignored_boxes k x 4); a class that is missing
                       there is not judged in that picture
    @return dict class number -> (average precision, number of boxes)
    """
    results = {}
    for label in range(classes):
        scores, labels, boxes = [], [], 0
        for rows, picture in zip(detections, truth):
            if label not in picture:
                continue
            true_boxes, ignored = picture[label]
            own = rows[rows[:, 0] == label][:, 1:]
            scores.append(own[:, 0])
            labels.append(label_detections(own, true_boxes, ignored, iou_threshold))
            boxes += len(true_boxes)
        results[label] = (average_precision(np.concatenate(scores or [np.zeros(0)]),
                                            np.concatenate(labels or [np.zeros(0, np.int64)]), boxes, interpolation),
                          boxes)
    return results
