"""The YAML description beside an exported network, as pi_detect reads it (include/pi_detect/model_description.h)."""

import hashlib

import numpy as np
import yaml

# The network's own output names and post-processing; evaluate.py uses the same numbers.
BOXES, SCORES = "boxes", "scores"
OVERLAP_THRESHOLD = 0.35  # at 0.5, one person often keeps boxes of several widths
TOP_K, KEEP_TOP_K = 200, 100
SCORE_THRESHOLD = 0.6  # best F1 on the validation split
ORIGIN = "trained with pi_detect/training on street photographs, {epochs} epochs; see the README there"
LICENCE = "weights for research use: several sources of the training pictures are for research only"


class _Inline(list):
    """A list that is written in one line."""


class _Dumper(yaml.SafeDumper):
    pass


_Dumper.add_representer(_Inline, lambda dumper, value: dumper.represent_sequence("tag:yaml.org,2002:seq", value, True))


def _number(value):
    """A float that YAML shows with as many digits as single precision has."""
    return float(f"{value:.9g}")


def feature_maps(layout):
    """The layout's maps in the description's terms: cells, box sizes and steps in parts of the input."""
    maps = []
    for stride in layout.strides:
        cells = -(-layout.input_size // stride)
        boxes = [_Inline([_number(size * stride * ratio ** 0.5 / layout.input_size),
                          _number(size * stride / ratio ** 0.5 / layout.input_size)])
                 for size in layout.sizes for ratio in layout.aspect_ratios]
        # Written out because the last cell of a coarse map exceeds the input: its step is not 1 / cells.
        step = _number(stride / layout.input_size)
        maps.append({"columns": cells, "rows": cells, "step_x": step, "step_y": step, "boxes": boxes})
    return maps


def priors(description):
    """All priors of a description as rows (centre x, centre y, width, height) in parts of the input, in the order of
    the network's outputs: map, row, column, box."""
    maps = []
    for entry in description["output"]["feature_maps"]:
        sizes = np.asarray(entry["boxes"])
        grid = np.empty((entry["rows"], entry["columns"], len(sizes), 4))
        grid[..., 0] = ((np.arange(entry["columns"]) + 0.5) * entry["step_x"])[None, :, None]
        grid[..., 1] = ((np.arange(entry["rows"]) + 0.5) * entry["step_y"])[:, None, None]
        grid[..., 2:] = sizes
        maps.append(grid.reshape(-1, 4))
    return np.concatenate(maps).astype(np.float32)


def describe(weights, layout, classes, epochs):
    """The description of an exported network.

    @param weights  path of the ONNX file; the description names it relative to itself
    @param layout   PriorLayout of the input size that was exported
    @param epochs   that the training has done
    """
    centre, size = layout.variances
    return {
        "name": weights.stem,
        "weights": {"file": weights.name, "sha256": hashlib.sha256(weights.read_bytes()).hexdigest()},
        "input": {"width": layout.input_size, "height": layout.input_size, "mean": _Inline([127.5] * 3),
                  "scale": _number(1 / 127.5), "channels": "rgb", "resize": "stretch"},
        "output": {"kind": "raw", "boxes": BOXES, "scores": SCORES, "box_order": "xywh", "activation": "none",
                   "background": -1, "variances": _Inline([centre, centre, size, size]),
                   "overlap_threshold": OVERLAP_THRESHOLD, "top_k": TOP_K, "keep_top_k": KEEP_TOP_K,
                   "feature_maps": feature_maps(layout)},
        "labels": dict(enumerate(classes)),
        "score_threshold": SCORE_THRESHOLD,
        "class_agnostic_overlap": 0.0,
        "origin": ORIGIN.format(epochs=epochs),
        "licence": LICENCE,
    }


def write(path, description):
    path.write_text("# Written by pi_detect/training/export.py.\n" +
                    yaml.dump(description, Dumper=_Dumper, sort_keys=False, width=120))


def read(path):
    """@throws ValueError naming the file if it is no description of an exported network"""
    description = yaml.safe_load(path.read_text())
    try:
        # Its numbers are all that the trainer's tools need of a description.
        description["input"]["width"], priors(description), description["output"]["variances"]
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{path} is no description of a network with raw outputs ({error}): write it with "
                         "export.py") from error
    return description
