#!/usr/bin/python3
"""The teacher: YOLOX-nano (Ge et al. 2021) as published in ONNX, run by PyTorch; and its boxes for the training set.

  teacher.py --data FOLDER --network yolox_nano.onnx --output teacher.json

The teacher looks at each picture, its mirror image and two overlapping parts of each.
"""

import argparse
import json
import os
from pathlib import Path

import numpy as np
import onnx
import onnx.numpy_helper
import torch
import torch.nn.functional as F
import yaml
from PIL import Image

from cells import cells, non_maximum_suppression
from label_set import CLASSES
from model import STRIDES, autocast, rows

SIZE = 416           # pixels of its input, as it was trained
LEAST_SCORE = 0.15   # of a box that is written
PART = 0.65          # length of a part of a picture in parts of its longer side
BORDER_PX = 4        # boxes of a part that come so near to its cut edge are left out
BAR_LEVEL = 114
LABELS = yaml.safe_load((Path(__file__).resolve().parents[1] / "config/models/accurate.yaml").read_text())["labels"]
STREET = [next(i for i, name in LABELS.items() if name == label) for label in CLASSES]  # its numbers of our classes


class Teacher:
    """Runs the operators of the ONNX graph up to the heads."""

    def __init__(self, path):
        graph = onnx.load(str(path)).graph
        constants = [(node.output[0], node.attribute[0].t) for node in graph.node if node.op_type == "Constant"]
        self._weights = {name: torch.from_numpy(onnx.numpy_helper.to_array(value).copy())
                         for name, value in constants + [(value.name, value) for value in graph.initializer]}
        self._input = graph.input[0].name
        self._nodes = [(node.op_type, list(filter(None, node.input)), node.output[0],
                        {a.name: onnx.helper.get_attribute_value(a) for a in node.attribute})
                       for node in graph.node if node.op_type != "Constant"]

    @torch.no_grad()
    def __call__(self, pixels):
        """Raw outputs of all cells (n x cells x 85: x, y, width, height, objectness, 80 classes), logits.

        @param pixels  n x 3 x S x S, RGB, 0..255
        """
        values = {self._input: pixels.flip(1).float().contiguous(memory_format=torch.channels_last)}
        heads = {}
        for operator, names, output, attributes in self._nodes:
            if operator == "Reshape":  # behind the heads
                break
            inputs = [values[name] if name in values else self._weights[name] for name in names]
            values[output] = self._run(operator, inputs, attributes)
            if operator == "Conv" and "_preds." in names[1]:
                kind, level = names[1].split(".")[1:3]  # head.cls_preds.0.weight
                heads[kind, level] = values[output].float()
        return rows([torch.cat([heads[kind, str(level)] for kind in ("reg_preds", "obj_preds", "cls_preds")], 1)
                     for level in range(len(STRIDES))])

    @staticmethod
    def _run(operator, inputs, attributes):
        x = inputs[0]
        if operator == "Conv":
            return F.conv2d(*inputs, attributes["strides"], attributes["pads"][:2], 1, attributes["group"])
        if operator == "Sigmoid":
            return torch.sigmoid(x)
        if operator == "Mul":
            return x * inputs[1]
        if operator == "Add":
            return x + inputs[1]
        if operator == "Concat":
            return torch.cat(inputs, attributes["axis"])
        if operator == "MaxPool":
            return F.max_pool2d(x, attributes["kernel_shape"], attributes["strides"], attributes["pads"][:2])
        if operator == "Resize":
            return F.interpolate(x, scale_factor=2.0, mode="nearest")
        if operator == "Slice":  # of rows or columns to their end
            for start, axis, step in zip(*(inputs[i].tolist() for i in (1, 3, 4))):
                x = x[(slice(None),) * axis + (slice(start, None, step),)]
            return x
        raise ValueError(f"the teacher's network has an operator {operator}, must be one of YOLOX's")


def street_boxes(outputs):
    """Rows [class, score, x1, y1, x2, y2] of our classes, in pixels of the teacher's input, before suppression."""
    place = cells(SIZE, STRIDES, offset=0.0)
    outputs = outputs.numpy()
    centre = place[:, :2] + outputs[:, :2] * place[:, 2:]
    half = np.exp(outputs[:, 2:4]) * place[:, 2:] / 2
    probability = 1 / (1 + np.exp(-outputs[:, 4:]))
    scores = probability[:, :1] * probability[:, 1:][:, STREET]
    cell, label = np.nonzero(scores >= LEAST_SCORE)
    return np.column_stack([label, scores[cell, label], (centre - half)[cell], (centre + half)[cell]])


def views(image):
    """(left, top, right, bottom) of the whole picture and of both ends of its longer side, which overlap."""
    width, height = image.size
    if width >= height:
        part = int(width * PART)
        return [(0, 0, width, height), (0, 0, part, height), (width - part, 0, width, height)]
    part = int(height * PART)
    return [(0, 0, width, height), (0, 0, width, part), (0, height - part, width, height)]


def look(teacher, image):
    """Rows [class, score, x1, y1, x2, y2] in pixels of the picture, best first."""
    inputs, scales = [], []
    for view in views(image):
        width, height = view[2] - view[0], view[3] - view[1]
        scale = SIZE / max(width, height)
        shape = (round(width * scale), round(height * scale))
        canvas = np.full((SIZE, SIZE, 3), BAR_LEVEL, np.uint8)
        canvas[:shape[1], :shape[0]] = np.asarray(image.resize(shape, Image.Resampling.BILINEAR, view))
        mirrored = canvas.copy()
        mirrored[:shape[1], :shape[0]] = canvas[:shape[1], :shape[0]][:, ::-1]
        inputs += [canvas, mirrored]
        scales += [(view, scale, False), (view, scale, True)]
    found = []
    with autocast():
        batch = teacher(torch.from_numpy(np.stack(inputs).transpose(0, 3, 1, 2)))
    for outputs, (view, scale, is_mirrored) in zip(batch, scales):
        boxes = street_boxes(outputs)
        boxes[:, 2:] /= scale
        if is_mirrored:
            boxes[:, [2, 4]] = (view[2] - view[0]) - boxes[:, [4, 2]]
        boxes[:, 2:] += np.asarray(view[:2] * 2)
        whole = np.asarray((0, 0) + image.size)
        for side, sign in ((0, 1), (1, 1), (2, -1), (3, -1)):
            if view[side] != whole[side]:
                boxes = boxes[sign * (boxes[:, 2 + side] - view[side]) > BORDER_PX]
        boxes[:, 2:] = np.clip(boxes[:, 2:], 0, np.tile(image.size, 2))
        found.append(boxes)
    found = np.concatenate(found)
    kept = [non_maximum_suppression(found[chosen, 2:], found[chosen, 1], 0.55)
            for chosen in (np.flatnonzero(found[:, 0] == label) for label in range(len(CLASSES)))]
    chosen = np.concatenate([np.flatnonzero(found[:, 0] == label)[own] for label, own in enumerate(kept)]).astype(int)
    return found[chosen[np.argsort(-found[chosen, 1], kind="stable")]]


def write_boxes(data, network, output):
    """Writes {picture: [[name, x1, y1, x2, y2, score]]} of all pictures of the set; nothing if the run is ended."""
    teacher = Teacher(network)
    boxes = {}
    for entry in json.loads((Path(data) / "labels.json").read_text()):
        with Image.open(Path(data) / entry["image"]) as image:
            found = look(teacher, image.convert("RGB"))
        boxes[entry["image"]] = [[CLASSES[int(row[0])], *np.round(row[2:], 1).tolist(), round(float(row[1]), 3)]
                                 for row in found]
        if len(boxes) % 100 == 0:
            print(f"teacher: {len(boxes)} pictures", flush=True)
    partial = Path(output).with_suffix(".partial")
    partial.write_text(json.dumps(boxes))
    os.replace(partial, output)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder of labels.json")
    parser.add_argument("--network", type=Path, required=True, help="YOLOX-nano, ONNX")
    parser.add_argument("--output", type=Path, required=True, help="JSON file to write")
    arguments = parser.parse_args()
    write_boxes(arguments.data, arguments.network, arguments.output)


if __name__ == "__main__":
    main()
