"""Reads the labels of the training set and its pictures, decoded once into a memory map."""

import json
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

import package_path  # noqa: F401  (leads to the next one)
from pi_detect.boxes import iou

CLASSES = ("person", "bicycle", "car", "motorcycle", "bus", "truck", "traffic light", "stop sign", "dog")
VEHICLES = {CLASSES.index(name) for name in ("car", "bus", "truck")}
# Sources whose people left out boxes of the classes that they labelled, and drew the others without the heads.
INCOMPLETE = ("pedestrian_behaviour",)
LEAST_SCORE = 0.3                       # of a teacher's box that is a training target
SURE_SCORE = 0.5                        # of a teacher's box that validation asks for


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


def _complete(human, teacher):
    """People's boxes without heads, replaced by the teacher's of the same person or, if there is none, ignored.

    @return rows with people's score, ignored boxes
    """
    if not len(human) or not len(teacher):
        return human[:0], human[:, 1:5]
    overlaps = iou(human[:, 1:5], teacher[:, 1:5]) * (human[:, :1] == teacher[None, :, 0])
    completed, is_known = human.copy(), overlaps.max(1) >= 0.4
    completed[:, 1:5] = teacher[overlaps.argmax(1), 1:5]
    return completed[is_known], human[~is_known, 1:5]


def _merge(human, teacher, human_classes, is_complete):
    """Training targets and ignored regions of one picture, from people's boxes and the teacher's (rows of _rows()).

    The teacher serves for the classes that people did not label. Where they did, a box that only the teacher has is
    ignored, or, where people are known to have left out many (is_complete is false), a target. Uncertain boxes are
    ignored. Of several vehicles in one place the best remains.
    """
    targets, ignored = list(human), []
    for row in sorted(teacher, key=lambda row: -row[5]):
        rivals = [other for other in targets if other[0] == row[0] or {other[0], row[0]} <= VEHICLES]
        overlaps = iou(row[None, 1:5], np.asarray(rivals)[:, 1:5])[0] if rivals else np.zeros(0)
        if any(overlap > (0.7 if other[0] != row[0] and other[5] < 1 else 0.45)
               for overlap, other in zip(overlaps, rivals)):
            continue
        is_certain = row[5] >= LEAST_SCORE and (row[0] not in human_classes or not is_complete)
        (targets if is_certain else ignored).append(row)
    return np.asarray(targets, np.float32).reshape(-1, 6), np.asarray(ignored, np.float32).reshape(-1, 6)[:, 1:5]


def load_records(folder, split, teacher_boxes):
    """Records of one split ("train" or "val") in the order of labels.json.

    @param teacher_boxes  as teacher.py writes them: picture -> [[name, x1, y1, x2, y2, score]]
    """
    path = Path(folder) / "labels.json"
    records = []
    for entry in json.loads(path.read_text()):
        if entry["split"] != split:
            continue
        human = _rows(entry["boxes"]) if entry["labels"] == "human" else np.zeros((0, 6), np.float32)
        human_classes = tuple(CLASSES.index(name) for name in entry["human_classes"] if name in CLASSES)
        teacher, is_complete = _rows(teacher_boxes[entry["image"]]), entry["source"] not in INCOMPLETE
        ignored = np.asarray(entry["ignore_boxes"], np.float32).reshape(-1, 4)
        if not is_complete:
            human, unknown = _complete(human, teacher)
            ignored = np.concatenate([ignored, unknown])
        rows, uncertain = _merge(human, teacher, human_classes, is_complete)
        if len(rows):  # a region that the set leaves open may hold a target now
            ignored = ignored[iou(ignored, rows[:, 1:5]).max(1) < 0.5]
        records.append(Record(
            entry["image"], entry["width"], entry["height"], entry["source"], human_classes,
            rows[:, 1:5], rows[:, 0].astype(np.int64), rows[:, 5], np.concatenate([ignored, uncertain]), human[:, :5]))
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
    """Truth for average_precision.evaluate() from people's boxes and elsewhere the teacher's certain ones."""
    sure = record.scores >= SURE_SCORE
    return {label: (record.boxes[sure & (record.classes == label)],
                    np.concatenate([record.ignored_boxes, record.boxes[~sure]])) for label in range(len(CLASSES))}


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
