"""The YAML description beside an exported network, as pi_detect reads it (include/pi_detect/model_description.h)."""

import hashlib

import yaml

OVERLAP_THRESHOLD = 0.6
TOP_K, KEEP_TOP_K = 300, 100
SCORE_THRESHOLD = 0.3  # best F1 on the validation split
TRACKER_SCORES = {"high_score": 0.46, "low_score": 0.33}  # there right: 4 of 5 and 1 of 3
ORIGIN = ("trained with pi_detect/training on street photographs, {epochs} epochs; teacher YOLOX-nano; see the README "
          "there")
LICENCE = "weights for research use: several sources of the training pictures are for research only"


class _Inline(list):
    """A list that is written in one line."""


class _Dumper(yaml.SafeDumper):
    pass


_Dumper.add_representer(_Inline, lambda dumper, value: dumper.represent_sequence("tag:yaml.org,2002:seq", value, True))


def describe(weights, size, strides, bins, classes, epochs):
    """The description of an exported network.

    @param weights  path of the ONNX file; the description names it relative to itself
    @param size     of the input that was exported [px]
    @param epochs   that the training has done
    """
    return {
        "name": weights.stem,
        "weights": {"file": weights.name, "sha256": hashlib.sha256(weights.read_bytes()).hexdigest()},
        "input": {"width": size, "height": size, "mean": _Inline([127.5] * 3), "scale": float(f"{1 / 127.5:.9g}"),
                  "channels": "rgb", "resize": "stretch"},
        "output": {"kind": "distribution", "strides": _Inline(strides), "offset": 0.5, "bins": bins,
                   "activation": "sigmoid", "overlap_threshold": OVERLAP_THRESHOLD, "top_k": TOP_K,
                   "keep_top_k": KEEP_TOP_K},
        "labels": dict(enumerate(classes)),
        "score_threshold": SCORE_THRESHOLD,
        "tracker": TRACKER_SCORES,
        "class_agnostic_overlap": 0.0,
        "origin": ORIGIN.format(epochs=epochs),
        "licence": LICENCE,
    }


def write(path, description):
    path.write_text("# Written by pi_detect/training/export.py.\n" +
                    yaml.dump(description, Dumper=_Dumper, sort_keys=False, width=120))
