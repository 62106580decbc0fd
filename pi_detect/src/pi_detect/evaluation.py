"""Judges detections by true boxes: average precision per class, precision and recall over the score (NumPy only)."""

from dataclasses import dataclass, field

import numpy as np

from pi_detect.average_precision import average_precision, label_detections, precision_recall
from pi_detect.detection_files import name_some, pair_pictures
from pi_detect.errors import ToolError

IOU_THRESHOLDS = np.linspace(0.5, 0.95, 10)  # of AP@.5:.95; the first is that of AP@0.5, of precision and of recall
MAX_DETECTIONS = 100                         # per picture and class, best first, as COCO's evaluation counts
SCORES = np.linspace(0.1, 0.9, 9)            # of the table of precision and recall
CHANCES = {"low": 1 / 3, "high": 4 / 5}      # of a detection to be right that continues a track, that begins one
NEWTON_STEPS = 25
NO_BOXES = np.zeros((0, 4))


@dataclass
class Judged:
    """Detections of one class, or of several pooled, in all pictures, each a hit or an error at IoU 0.5."""

    boxes: int = 0
    scores: np.ndarray = field(default_factory=lambda: np.zeros(0))
    labels: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))  # 1 hit, 0 error

    def at(self, score):
        """(precision, recall, F1) of the detections with at least this score; nan where nothing is divided."""
        kept = self.labels[self.scores >= score]
        hits = int(kept.sum())
        precision = hits / len(kept) if len(kept) else float("nan")
        recall = hits / self.boxes if self.boxes else float("nan")
        total = len(kept) + self.boxes
        return precision, recall, 2 * hits / total if total else float("nan")

    def score_of(self, chance):
        """The score at which a detection is right with a chance; nan where the scores do not tell.

        Logistic regression over the detections from score 0.1 on (Platt 1999). The chance at a score, not the precision
        from it on: the better detections would pay for the worse ones.
        """
        kept = self.scores >= SCORES[0]
        rows, right = np.column_stack([self.scores[kept], np.ones(kept.sum())]), self.labels[kept]
        if len(set(right)) < 2:
            return float("nan")
        weights = np.zeros(2)
        for _ in range(NEWTON_STEPS):
            chances = 1 / (1 + np.exp(-np.clip(rows @ weights, -30, 30)))
            # A little ridge: scores that part right from wrong without a rest would need an endless slope.
            curvature = (rows * (chances * (1 - chances))[:, None]).T @ rows + 1e-3 * np.eye(2)
            weights += np.linalg.solve(curvature, rows.T @ (right - chances) - 1e-3 * weights)
        score = (np.log(chance / (1 - chance)) - weights[1]) / weights[0] if weights[0] > 0 else float("nan")
        return float(score) if 0 < score <= 1 else float("nan")

    def curve(self):
        """(precisions, recalls) over falling score; needs a box."""
        precision, recall, _ = precision_recall(self.scores, self.labels, self.boxes)
        return precision, recall


@dataclass
class Result:
    """What evaluate() found."""

    pictures: int
    interpolation: str
    classes: dict  # name -> (Judged, AP@0.5, AP@.5:.95), most frequent first; nan where the class has no box
    pooled: Judged

    def mean(self, which):
        """Mean over the classes that have boxes: which = 1 of AP@0.5, 2 of AP@.5:.95."""
        values = [entry[which] for entry in self.classes.values() if entry[0].boxes]
        return float(np.mean(values)) if values else float("nan")


def _pictures_to_judge(pictures, detections, only_seen):
    """Dict name in the detections -> index of the picture, and the set of the indices that count. @throws ToolError"""
    names = detections.found_in if detections.images is None else detections.images
    pairs, unknown = pair_pictures(names, [picture.image for picture in pictures])
    if detections.images is None:
        if only_seen:
            raise ToolError("--only-seen needs a file of detections that lists the pictures looked at "
                            "({\"images\": [...], \"detections\": [...]}): a plain list of detections does not")
        if unknown:
            raise ToolError(f"no true boxes for picture {name_some(unknown)}: give the boxes of these pictures, too")
        return pairs, set(range(len(pictures)))
    seen = set(pairs.values())
    if only_seen:
        if not seen:
            raise ToolError(f"none of the {len(names)} pictures looked at has true boxes")
        return pairs, seen
    if unknown:
        raise ToolError(f"no true boxes for picture {name_some(unknown)}: give their boxes, or choose --only-seen")
    if len(seen) < len(pictures):
        missing = [picture.image for index, picture in enumerate(pictures) if index not in seen]
        raise ToolError(f"{len(missing)} of {len(pictures)} pictures with true boxes were not looked at "
                        f"({name_some(missing)}): detect in them, too, or choose --only-seen")
    return pairs, seen


def _choose_classes(pictures, detections, wanted):
    """Names of the classes to judge, most frequent first. @throws ToolError for a name that nobody knows"""
    counts = {name: 0 for name in detections.classes}
    for picture in pictures:
        for name in picture.classes:
            counts[name] = counts.get(name, 0) + 1
    for name in wanted or ():
        if name not in counts:
            raise ToolError(f"--classes {name}: neither boxes nor detections have this class; known are "
                            f"{', '.join(sorted(counts))}")
    return sorted(wanted or counts, key=lambda name: (-counts[name], name))


def evaluate(pictures, detections, classes=None, only_seen=False, interpolation="coco"):
    """Judges detections.

    @param pictures    of load_boxes()
    @param detections  of load_detections()
    @param classes     names to look at; None: all that have boxes or detections
    @param only_seen   leave out pictures that were not looked at, and detections in pictures without true boxes
    @throws ToolError if pictures or classes do not fit together
    """
    pairs, counted = _pictures_to_judge(pictures, detections, only_seen)
    pictures_judged = [pictures[index] for index in sorted(counted)]
    rows_of = {}  # (class, picture) -> indices of detections
    for index, (name, label) in enumerate(zip(detections.found_in, detections.classes)):
        if name in pairs:
            rows_of.setdefault((label, pairs[name]), []).append(index)
    results = {}
    for label in _choose_classes(pictures_judged, detections, classes):
        scores, boxes = [np.zeros(0)], 0
        labels = [[np.zeros(0, np.int64)] for _ in IOU_THRESHOLDS]
        for index in sorted(counted):
            picture = pictures[index]
            true_boxes = picture.boxes[[name == label for name in picture.classes]]
            boxes += len(true_boxes)
            rows = detections.rows[rows_of.get((label, index), [])]
            rows = rows[np.argsort(-rows[:, 0], kind="stable")][:MAX_DETECTIONS]
            if not len(rows):
                continue
            scores.append(rows[:, 0])
            for judged, threshold in zip(labels, IOU_THRESHOLDS):
                judged.append(label_detections(rows, true_boxes, NO_BOXES, threshold))
        scores = np.concatenate(scores)
        labels = [np.concatenate(judged) for judged in labels]
        precisions = [average_precision(scores, judged, boxes, interpolation) for judged in labels]
        results[label] = Judged(boxes, scores, labels[0]), precisions[0], float(np.mean(precisions))
    judged = [entry[0] for entry in results.values()]
    pooled = Judged(sum(entry.boxes for entry in judged),
                    np.concatenate([np.zeros(0)] + [entry.scores for entry in judged]),
                    np.concatenate([np.zeros(0, np.int64)] + [entry.labels for entry in judged]))
    return Result(len(counted), interpolation, results, pooled)
