#!/usr/bin/python3 -B
"""How many simulated people a network that was trained on photographs finds, by their height in the picture, beside
photographs of pedestrians at the same heights; and what it takes for people where nobody is.

    detected_people.py --models FOLDER [--network yolox|nanodet] [--seeds N] [--photographs FOLDER]

FOLDER of the models: yolox_nano_416.onnx and nanodet_m_320.onnx. FOLDER of the photographs: labels.json, a list of
{image, width, height, labels, boxes: [[class, x1, y1, x2, y2, score]]}; those with boxes by humans count.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import numpy

LEAST_SCORE = 0.4
LEAST_OVERLAP = 0.3
NEAR_M = 12.0
MOSTLY_VISIBLE = 0.5
WIDTH, HEIGHT = 640, 480
HEIGHTS_PX = (0, 47, 62, 93, 10000)  # 62 and 47 px: a person of 1.75 m at 9 and 12 m
PEOPLE = ("person", "cyclist")
ZOOMS = (1.0, 0.6, 0.4)              # of the photographs


class Yolox:
    """YOLOX-nano: boxes around people of a BGR picture, [x1, y1, x2, y2]."""
    SIDE = 416

    def __init__(self, folder):
        self._network = cv2.dnn.readNet(str(folder / "yolox_nano_416.onnx"))
        cells = [(x, y, stride) for stride in (8, 16, 32) for y in range(self.SIDE // stride)
                 for x in range(self.SIDE // stride)]
        self._cells = numpy.array(cells, numpy.float32)

    def people(self, picture):
        scale = self.SIDE / max(picture.shape)
        small = cv2.resize(picture, None, fx=scale, fy=scale)
        padded = numpy.full((self.SIDE, self.SIDE, 3), 114, numpy.uint8)
        padded[:small.shape[0], :small.shape[1]] = small
        self._network.setInput(cv2.dnn.blobFromImage(padded))
        rows = self._network.forward().reshape(-1, 85)
        centers = (rows[:, :2] + self._cells[:, :2]) * self._cells[:, 2:] / scale
        sizes = numpy.exp(rows[:, 2:4]) * self._cells[:, 2:] / scale
        return best(numpy.hstack((centers - sizes / 2, centers + sizes / 2)), rows[:, 4] * rows[:, 5])


class Nanodet:
    """NanoDet-m, likewise."""
    SIDE = 320
    MEAN, DEVIATION = (103.53, 116.28, 123.675), (57.375, 57.12, 58.395)

    def __init__(self, folder):
        self._network = cv2.dnn.readNet(str(folder / "nanodet_m_320.onnx"))

    def people(self, picture):
        scale = self.SIDE / max(picture.shape)
        small = cv2.resize(picture, None, fx=scale, fy=scale)
        corner = numpy.array([(self.SIDE - small.shape[1]) // 2, (self.SIDE - small.shape[0]) // 2])
        padded = numpy.zeros((self.SIDE, self.SIDE, 3), numpy.float32)
        padded[corner[1]:corner[1] + small.shape[0], corner[0]:corner[0] + small.shape[1]] = small
        padded = ((padded - self.MEAN) / self.DEVIATION).astype(numpy.float32)
        self._network.setInput(cv2.dnn.blobFromImage(padded))
        outputs = [one.reshape(-1, one.shape[-1])
                   for one in self._network.forward(self._network.getUnconnectedOutLayersNames())]
        boxes, scores = [], []
        for stride in (8, 16, 32):
            side = self.SIDE // stride
            classes, bins = (next(one for one in outputs if one.shape == (side * side, width)) for width in (80, 32))
            likely = numpy.exp(bins.reshape(-1, 4, 8) - bins.reshape(-1, 4, 8).max(2, keepdims=True))
            reach = (likely / likely.sum(2, keepdims=True)) @ numpy.arange(8) * stride
            y, x = numpy.divmod(numpy.arange(side * side), side)
            centers = (numpy.stack((x, y), 1) + 0.5) * stride - corner
            boxes.append(numpy.hstack((centers - reach[:, :2], centers + reach[:, 2:])) / scale)
            scores.append(classes[:, 0])
        return best(numpy.vstack(boxes), numpy.concatenate(scores))


def best(boxes, scores):
    """Without those that overlap a better one by half."""
    chosen = numpy.flatnonzero(scores >= LEAST_SCORE)
    corners = [[float(x1), float(y1), float(x2 - x1), float(y2 - y1)] for x1, y1, x2, y2 in boxes[chosen]]
    kept = cv2.dnn.NMSBoxes(corners, scores[chosen].astype(float).tolist(), LEAST_SCORE, 0.5)
    return boxes[chosen][numpy.array(kept, int).ravel()]


def shared(a, b):
    """Area that two boxes share."""
    return max(0.0, min(a[2], b[2]) - max(a[0], b[0])) * max(0.0, min(a[3], b[3]) - max(a[1], b[1]))


def found(box, people):
    def area(one):
        return (one[2] - one[0]) * (one[3] - one[1])
    return any(shared(box, one) > LEAST_OVERLAP * (area(box) + area(one) - shared(box, one)) for one in people)


class Figures:
    def __init__(self):
        self.by_height = {least: [] for least in HEIGHTS_PX[:-1]}
        self.pictures = self.elsewhere = self.with_people = self.with_found = 0

    def add(self, box, hit):
        height = box[3] - box[1]
        self.by_height[max(least for least in HEIGHTS_PX[:-1] if height >= least)].append(hit)

    def hits(self):
        """One of each person that counts: True if found."""
        return sum(self.by_height.values(), [])

    def text(self):
        every = self.hits()
        cells = ["%d px and more: %.0f %% of %d" % (least, 100 * numpy.mean(hits), len(hits))
                 for least, hits in self.by_height.items() if hits]
        return "%s; all: %.1f %% of %d" % ("; ".join(cells), 100 * numpy.mean(every), len(every))


def simulated(network, seeds, rate_hz=1.25):
    """Pictures of a round of 72 s through one world per seed. Raises CalledProcessError if render_sequence fails."""
    figures = Figures()
    for seed in seeds:
        with tempfile.TemporaryDirectory() as folder:
            recording = Path(folder) / "drive"
            subprocess.run(["rosrun", "pi_simulation", "render_sequence", str(recording), "--color", "--quality", "live",
                            "--supersampling", "none", "--obstacle-truth", "--rate", str(rate_hz),
                            "--duration", "72", "--seed", str(seed)], check=True, capture_output=True)
            for truth in json.loads((recording / "truth" / "obstacles.json").read_text(encoding="utf-8"))["frames"]:
                picture = cv2.imread(str(recording / "mav0" / "cam0" / "data" / ("%d.png" % truth["stamp_ns"])))
                judge(truth["obstacles"], network.people(picture), figures)
    return figures


def judge(obstacles, people, figures):
    every = [one for one in obstacles if one["class"] in PEOPLE]
    near = [one["box"] for one in every if one["nearest_depth_m"] <= NEAR_M and one["visible"] > MOSTLY_VISIBLE and
            one["box"][0] > 0 and one["box"][2] < WIDTH]
    hits = [found(box, people) for box in near]
    for box, hit in zip(near, hits):
        figures.add(box, hit)
    figures.pictures += 1
    figures.with_people += bool(near)
    figures.with_found += any(hits)
    figures.elsewhere += sum(not any(shared(box, one["box"]) > 0 for one in every) for box in people)


def photographed(network, folder):
    """Pedestrians in photographs, made smaller inside of a picture of the cameras' size."""
    figures = Figures()
    for entry in json.loads((folder / "labels.json").read_text(encoding="utf-8")):
        boxes = [one[1:5] for one in entry["boxes"] if one[0] == "person"]
        if entry["labels"] != "human" or entry["source"] != "pedestrian_behaviour" or not boxes:
            continue
        photograph = cv2.imread(str(folder / entry["image"]))
        for zoom in ZOOMS:
            scale = zoom * min(HEIGHT / photograph.shape[0], WIDTH / photograph.shape[1])
            small = cv2.resize(photograph, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
            corner = numpy.array([(WIDTH - small.shape[1]) // 2, (HEIGHT - small.shape[0]) // 2])
            picture = numpy.full((HEIGHT, WIDTH, 3), 114, numpy.uint8)
            picture[corner[1]:corner[1] + small.shape[0], corner[0]:corner[0] + small.shape[1]] = small
            people = network.people(picture)
            for x1, y1, x2, y2 in boxes:
                whole = x1 > 2 and y1 > 2 and x2 < entry["width"] - 2 and y2 < entry["height"] - 2
                if whole and y2 - y1 > 1.7 * (x2 - x1) and scale * (y2 - y1) >= 40:
                    box = numpy.array([x1, y1, x2, y2]) * scale + numpy.tile(corner, 2)
                    figures.add(box, found(box, people))
    return figures


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--models", type=Path, required=True)
    parser.add_argument("--network", choices=("yolox", "nanodet"), default="yolox")
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--photographs", type=Path)
    options = parser.parse_args()
    try:
        network = {"yolox": Yolox, "nanodet": Nanodet}[options.network](options.models)
    except cv2.error as error:
        sys.exit("detected_people: --models %s: %s" % (options.models, str(error).strip().splitlines()[-1]))
    try:
        figures = simulated(network, range(1, options.seeds + 1))
    except subprocess.CalledProcessError as error:
        sys.exit("detected_people: " + (error.stderr.decode().strip() or str(error)))
    print("simulated: %s" % figures.text())
    print("  in %d of %d pictures with people near one of them is found; %d of %d pictures: found where nobody is" % (
        figures.with_found, figures.with_people, figures.elsewhere, figures.pictures))
    if options.photographs:
        print("photographs: %s" % photographed(network, options.photographs).text())


if __name__ == "__main__":
    main()
