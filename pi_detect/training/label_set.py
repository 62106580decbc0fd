"""Reads the labels of the training set and its pictures, decoded once into a memory map."""

import json
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

CLASSES = ("person", "bicycle", "car", "motorcycle", "bus", "truck", "traffic light", "stop sign", "dog")


@dataclass
class Record:
    """One picture; boxes are corner boxes in pixels of the stored picture."""

    image: str                 # path relative to the set
    width: int
    height: int
    source: str
    human_classes: tuple       # class numbers that people labelled in this picture
    boxes: np.ndarray          # n x 4, training targets
    classes: np.ndarray        # n class numbers
    scores: np.ndarray         # n, 1 for people's boxes, the teacher's score otherwise
    ignored_boxes: np.ndarray  # m x 4
    human_boxes: np.ndarray    # k x 5 rows (class, x1, y1, x2, y2) from people only
    offset: int = 0            # of the picture's first byte in the memory map


def _rows(boxes):
    """[name, x1, y1, x2, y2, score] lists to an n x 6 array with the class number; unknown names are left out."""
    rows = [[CLASSES.index(box[0])] + list(box[1:6]) for box in boxes if box[0] in CLASSES]
    return np.asarray(rows, np.float32).reshape(-1, 6)


def load_records(folder, split):
    """Records of one split ("train" or "val") in the order of labels.json."""
    path = Path(folder) / "labels.json"
    records = []
    for entry in json.loads(path.read_text()):
        if entry["split"] != split:
            continue
        rows = _rows(entry["train_boxes"])
        human = _rows(entry["boxes"]) if entry["labels"] == "human" else np.zeros((0, 6), np.float32)
        records.append(Record(
            entry["image"], entry["width"], entry["height"], entry["source"],
            tuple(CLASSES.index(name) for name in entry["human_classes"] if name in CLASSES),
            rows[:, 1:5], rows[:, 0].astype(np.int64), rows[:, 5],
            np.asarray(entry["ignore_boxes"], np.float32).reshape(-1, 4), human[:, :5]))
    if not records:
        raise ValueError(f"{path} has no picture of split '{split}', expected 'train' or 'val'")
    return records


def human_truth(record):
    """Truth for average_precision.evaluate(): only classes that people labelled, only their boxes.

    Boxes of such a class that only the teacher reported (far persons that people left out) count neither way.
    """
    truth = {}
    for label in record.human_classes:
        human = record.human_boxes[record.human_boxes[:, 0] == label, 1:]
        added = record.boxes[(record.classes == label) & (record.scores < 1)]
        truth[label] = (human, np.concatenate([record.ignored_boxes, added]))
    return truth


def target_truth(record):
    """Truth for average_precision.evaluate() from the training targets: people's boxes, elsewhere the teacher's."""
    return {label: (record.boxes[record.classes == label], record.ignored_boxes) for label in range(len(CLASSES))}


class PictureStore:
    """RGB pixels of all records of a split in one read-only memory map, decoded at the first use."""

    def __init__(self, folder, records, cache):
        offset = 0
        for record in records:
            record.offset = offset
            offset += record.width * record.height * 3
        self._records = records
        cache = Path(cache)
        if not cache.exists() or cache.stat().st_size != offset:
            self._decode(Path(folder), cache)
        self._pixels = np.memmap(cache, np.uint8, "r")

    def _decode(self, folder, cache):
        cache.parent.mkdir(parents=True, exist_ok=True)
        partial = cache.with_name(cache.name + f".{os.getpid()}.partial")
        with open(partial, "wb") as file:
            for record in self._records:
                with Image.open(folder / record.image) as image:
                    if image.size != (record.width, record.height):
                        raise ValueError(f"{record.image} is {image.size[0]}x{image.size[1]}, "
                                         f"labels.json says {record.width}x{record.height}")
                    file.write(image.convert("RGB").tobytes())
        os.replace(partial, cache)

    def image(self, record):
        """The picture as a PIL image that shares the mapped memory where PIL can."""
        size = record.width * record.height * 3
        pixels = self._pixels[record.offset:record.offset + size].reshape(record.height, record.width, 3)
        return Image.fromarray(pixels)
