"""Reads boxes and detections from JSON files and pairs their pictures."""

import json
import math
from collections import defaultdict
from dataclasses import dataclass
from pathlib import PurePosixPath

import numpy as np

from pi_detect.errors import ToolError

CORNERS = ("x1", "y1", "x2", "y2")
NAMED_AT_MOST = 5  # pictures in an error


@dataclass
class Picture:
    """A picture with its true boxes."""

    image: str
    classes: list      # n names
    boxes: np.ndarray  # n x 4 corner boxes [px]


@dataclass
class Detections:
    """What a detector found."""

    model: str           # "" if the file does not say
    images: list         # pictures that were looked at, or None: unknown
    found_in: list       # n picture names
    classes: list        # n names
    rows: np.ndarray     # n x 5 rows (score, x1, y1, x2, y2), corners in pixels


def name_some(names):
    """The first few of a list, for an error."""
    names = list(names)
    rest = f" and {len(names) - NAMED_AT_MOST} more" if len(names) > NAMED_AT_MOST else ""
    return ", ".join(names[:NAMED_AT_MOST]) + rest


class _Reader:
    """Takes values out of a JSON file. Every method throws ToolError naming file, place, value and bound."""

    def __init__(self, path):
        self.path = path

    def load(self):
        try:
            with open(self.path, encoding="utf-8") as file:
                return json.load(file)
        except OSError as error:
            raise ToolError(f"{self.path}: {error.strerror or error}") from error
        except (ValueError, RecursionError) as error:
            raise ToolError(f"{self.path} is not JSON: {error}") from error

    def refuse(self, place, value, bound):
        text = json.dumps(value)
        raise ToolError(f"{self.path}: {place} = {text if len(text) <= 60 else text[:57] + '...'}, must be {bound}")

    def field(self, entry, place, name):
        if not isinstance(entry, dict):
            self.refuse(place, entry, f"an object with the field {name}")
        if name not in entry:
            raise ToolError(f"{self.path}: {place} has no field {name}")
        return entry[name]

    def text(self, value, place):
        if not isinstance(value, str) or not value:
            self.refuse(place, value, "a text")
        return value

    def number(self, value, place, bound="a finite number", low=-math.inf, high=math.inf):
        is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
        if not is_number or not math.isfinite(value) or not low <= value <= high:
            self.refuse(place, value, bound)
        return float(value)

    def list(self, value, place, what):
        if not isinstance(value, list):
            self.refuse(place, value, what)
        return value

    def corners(self, values, place):
        box = [self.number(value, f"{place}{name}") for value, name in zip(values, CORNERS)]
        if box[2] < box[0] or box[3] < box[1]:
            self.refuse(place.rstrip("."), values, "a box with x1 <= x2 and y1 <= y2")
        return box


def load_boxes(path):
    """Pictures of a list [{image, width, height, boxes: [[class, x1, y1, x2, y2]]}]. @throws ToolError"""
    reader = _Reader(path)
    pictures, seen = [], set()
    for i, entry in enumerate(reader.list(reader.load(), "the file", "a list of pictures with their boxes")):
        place = f"[{i}]"
        image = reader.text(reader.field(entry, place, "image"), f"{place}.image")
        if image in seen:
            raise ToolError(f"{path}: {place}.image = {image} is there twice")
        seen.add(image)
        for side in ("width", "height"):
            reader.number(reader.field(entry, place, side), f"{place}.{side}", "a positive number", low=1e-9)
        classes, boxes = [], []
        for j, box in enumerate(reader.list(reader.field(entry, place, "boxes"), f"{place}.boxes", "a list of boxes")):
            at = f"{place}.boxes[{j}]"
            if not isinstance(box, list) or len(box) != 5:
                reader.refuse(at, box, "a list [class, x1, y1, x2, y2]")
            classes.append(reader.text(box[0], f"{at} class"))
            boxes.append(reader.corners(box[1:], f"{at} "))
        pictures.append(Picture(image, classes, np.asarray(boxes, float).reshape(-1, 4)))
    if not pictures:
        raise ToolError(f"{path} has no picture: there is nothing to compare with")
    return pictures


def load_detections(path):
    """Detections of a list [{image, class, score, x1, y1, x2, y2}], or of an object {model, images, detections} with
    such a list and the pictures that were looked at. @throws ToolError"""
    reader = _Reader(path)
    content = reader.load()
    model, images, place = "", None, ""
    if isinstance(content, dict):
        if "model" in content:
            model = reader.text(content["model"], "model")
        names = reader.list(reader.field(content, "the file", "images"), "images", "a list of picture names")
        images = [reader.text(name, f"images[{i}]") for i, name in enumerate(names)]
        content, place = reader.field(content, "the file", "detections"), "detections"
    found_in, classes, rows = [], [], []
    for i, entry in enumerate(reader.list(content, place or "the file", "a list of detections")):
        at = f"{place}[{i}]"
        found_in.append(reader.text(reader.field(entry, at, "image"), f"{at}.image"))
        classes.append(reader.text(reader.field(entry, at, "class"), f"{at}.class"))
        score = reader.number(reader.field(entry, at, "score"), f"{at}.score", "a number in [0, 1]", 0.0, 1.0)
        rows.append([score] + reader.corners([reader.field(entry, at, name) for name in CORNERS], f"{at}."))
    if images is not None:
        unknown = sorted(set(found_in) - set(images))
        if unknown:
            raise ToolError(f"{path} has detections in {name_some(unknown)}, which its images do not list")
    return Detections(model, images, found_in, classes, np.asarray(rows, float).reshape(-1, 5))


def _common_parts(a, b):
    """Number of equal path components from the end."""
    count = 0
    for x, y in zip(reversed(PurePosixPath(a).parts), reversed(PurePosixPath(b).parts)):
        if x != y:
            break
        count += 1
    return count


def pair_pictures(names, images):
    """Pairs names of the same pictures that start at different folders: by the longest common end of their paths, at
    least the file name.

    @param names   from a detector
    @param images  from the ground truth
    @return (dict name -> index in images, list of the names that have no such picture)
    @throws ToolError if a name fits several pictures equally well, or two names fit one
    """
    by_file = defaultdict(list)
    for index, image in enumerate(images):
        by_file[PurePosixPath(image).name].append(index)
    pairs, unknown, owner = {}, [], {}
    for name in dict.fromkeys(names):
        candidates = by_file.get(PurePosixPath(name).name, [])
        if not candidates:
            unknown.append(name)
            continue
        common = [_common_parts(name, images[index]) for index in candidates]
        best = [index for index, parts in zip(candidates, common) if parts == max(common)]
        if len(best) > 1:
            raise ToolError(f"picture {name} fits {name_some(images[index] for index in best)}: run the detector with "
                            "paths that tell them apart")
        if best[0] in owner:
            raise ToolError(f"pictures {owner[best[0]]} and {name} both fit {images[best[0]]}: run the detector with "
                            "paths that tell them apart")
        owner[best[0]] = name
        pairs[name] = best[0]
    return pairs, unknown
