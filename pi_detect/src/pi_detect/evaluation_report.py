"""Shows an evaluation as tables, JSON and a plot."""

import math

import numpy as np

from pi_detect.errors import ToolError
from pi_detect.evaluation import CHANCES, IOU_THRESHOLDS, SCORES

PLOTTED_CLASSES = 8  # the most frequent ones


def _cell(value, width, digits=3):
    return f"{'-':>{width}}" if math.isnan(value) else f"{value:{width}.{digits}f}"


def table(result, score):
    """Text: average precision per class, with precision and recall at one score, then both over the score."""
    width = max([len(name) for name in result.classes] + [20])
    lines = [f"{'class':{width}}  boxes  found   AP@0.5  AP@.5:.95  precision  recall   (at score {score:g})"]
    for name, (judged, ap_50, ap) in result.classes.items():
        precision, recall, _ = judged.at(score)
        found = int((judged.scores >= score).sum())
        lines.append(f"{name:{width}} {judged.boxes:6d} {found:6d}  {_cell(ap_50, 7)}  {_cell(ap, 9)}  "
                     f"{_cell(precision, 9)} {_cell(recall, 7)}")
    with_boxes = sum(1 for entry in result.classes.values() if entry[0].boxes)
    precision, recall, _ = result.pooled.at(score)
    found = int((result.pooled.scores >= score).sum())
    lines.append(f"{f'mean of {with_boxes} classes':{width}} {result.pooled.boxes:6d} {found:6d}  "
                 f"{_cell(result.mean(1), 7)}  {_cell(result.mean(2), 9)}  {_cell(precision, 9)} {_cell(recall, 7)}")
    lines += ["", "classes pooled, IoU at least 0.5", "score  found  precision  recall     F1"]
    for threshold in SCORES:
        precision, recall, f1 = result.pooled.at(threshold)
        found = int((result.pooled.scores >= threshold).sum())
        lines.append(f"{threshold:5.1f} {found:6d}  {_cell(precision, 9)} {_cell(recall, 7)} {_cell(f1, 6)}")
    scores = ", ".join(f"{name}_score {_cell(result.pooled.score_of(chance), 4, 2)} (right: {chance:.2f})"
                       for name, chance in CHANCES.items())
    return "\n".join(lines + ["", f"for a tracker: {scores}"])


def _plain(value):
    """JSON has no nan."""
    return None if math.isnan(value) else round(float(value), 6)


def as_json(result, score, model):
    """All figures as plain lists, dicts and numbers; None where there is no figure."""
    def point(judged, threshold):
        precision, recall, f1 = judged.at(threshold)
        return {"score": round(float(threshold), 6), "found": int((judged.scores >= threshold).sum()),
                "precision": _plain(precision), "recall": _plain(recall), "f1": _plain(f1)}

    return {
        "model": model,
        "pictures": result.pictures,
        "boxes": result.pooled.boxes,
        "interpolation": result.interpolation,
        "iou_thresholds": [round(float(value), 2) for value in IOU_THRESHOLDS],
        "map_50": _plain(result.mean(1)),
        "map": _plain(result.mean(2)),
        "classes": {name: {"boxes": judged.boxes, "detections": len(judged.scores), "ap_50": _plain(ap_50),
                           "ap": _plain(ap), "at": point(judged, score)}
                    for name, (judged, ap_50, ap) in result.classes.items()},
        "tracker": {f"{name}_score": _plain(result.pooled.score_of(chance)) for name, chance in CHANCES.items()},
        "pooled": [point(result.pooled, threshold) for threshold in SCORES],
    }


def plot(result, score, title, path):
    """Draws precision over recall, of the most frequent classes and of all pooled, with a dot at the given score.
    @throws ToolError"""
    try:
        import matplotlib
        matplotlib.use("Agg")
        from matplotlib import pyplot
    except ImportError as error:
        raise ToolError(f"--plot {path}: matplotlib is not installed (Debian: python3-matplotlib)") from error
    figure, axes = pyplot.subplots(figsize=(8, 5.5))
    curves = [(name, entry[0], f"{name}: AP {entry[1]:.2f}") for name, entry in result.classes.items()
              if entry[0].boxes][:PLOTTED_CLASSES]
    curves.append(("pooled", result.pooled, "all classes pooled"))
    for name, judged, label in curves:
        if not judged.boxes:
            continue
        style = {"color": "black", "linewidth": 2.5} if name == "pooled" else {"linewidth": 1.2}
        precision, recall = judged.curve()
        line, = axes.plot(recall, precision, label=label, drawstyle="steps-post", **style)
        at_precision, at_recall, _ = judged.at(score)
        if not np.isnan(at_precision):
            axes.plot([at_recall], [at_precision], "o", color=line.get_color(), markersize=6)
    axes.set(xlim=(0, 1), ylim=(0, 1.03), xlabel="recall", ylabel="precision",
             title=f"{title} (IoU 0.5; dots: score {score:g})")
    axes.grid(alpha=0.3)
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=9, frameon=False)
    try:
        figure.savefig(path, dpi=110, bbox_inches="tight")
    except (OSError, ValueError) as error:
        raise ToolError(f"--plot {path}: {error}") from error
    finally:
        pyplot.close(figure)
