#!/usr/bin/python3
"""Average precision and speed of the exported network and of the teacher, on the same pictures by the same code.

  evaluate.py --data FOLDER --work FOLDER --network ssd_street.onnx --teacher TEACHER.pb --teacher-labels labelmap.txt

Both networks run in OpenCV's dnn module. Average precision is at IoU 0.5, per class, against two truths: "human", the
boxes that people drew (only in pictures where they labelled the class), and "targets", all training targets of the
split, which outside people's boxes are the teacher's own and so favour it.
"""

import argparse
import json
from pathlib import Path

import numpy as np

import dnn_forward
import model_description
import package_path  # noqa: F401  (leads to pi_detect)
from box_coding import decode, non_maximum_suppression, select_detections
from label_set import CLASSES, human_truth, load_records, target_truth
from pi_detect.average_precision import evaluate

TEACHER_SIZE = 300  # pixels


def to_pixels(rows, record):
    """Scales the boxes of detection rows from 0..1 to the record's pixels."""
    scaled = rows.copy()
    scaled[:, 2:] *= np.asarray([record.width, record.height] * 2, rows.dtype)
    return scaled


def own_detections(outputs, description, nms_iou):
    """Detections per picture, rows [class, score, x1, y1, x2, y2] in 0..1, of raw box codes and scores
    (pictures x 1 x priors x ...)."""
    priors = model_description.priors(description)
    variances = description["output"]["variances"][1:3]  # of x, y, width, height: one of the centre, one of the size
    return [select_detections(decode(codes, priors, variances), scores, nms_iou=nms_iou)
            for codes, scores in zip(outputs["boxes"][:, 0], outputs["scores"][:, 0])]


def teacher_detections(output, labels, nms_iou):
    """The same rows from OpenCV's DetectionOutput (1 x 1 x n x 7 per picture; class = line of the label map)."""
    number = {labels.index(name): i for i, name in enumerate(CLASSES)}
    results = []
    for rows in output.reshape(len(output), -1, 7):
        rows = np.asarray([[number[int(r[1])], *r[2:]] for r in rows if int(r[1]) in number]).reshape(-1, 6)
        kept = [np.flatnonzero(rows[:, 0] == label) for label in range(len(CLASSES))]
        kept = [chosen[non_maximum_suppression(rows[chosen, 2:], rows[chosen, 1], nms_iou)] for chosen in kept]
        rows = rows[np.concatenate(kept).astype(int)]
        results.append(rows[np.argsort(-rows[:, 1], kind="stable")])
    return results


def precision_table(records, detections):
    """Dict truth -> class name -> {"ap": 0..1, "boxes": count} for classes that have boxes."""
    pixels = [to_pixels(rows, record) for rows, record in zip(detections, records)]
    table = {}
    for name, truth in (("human", human_truth), ("targets", target_truth)):
        results = evaluate(pixels, [truth(record) for record in records], len(CLASSES))
        table[name] = {CLASSES[label]: {"ap": round(ap, 4), "boxes": boxes}
                       for label, (ap, boxes) in results.items() if boxes}
    return table


def print_table(networks):
    for truth in ("human", "targets"):
        print(f"AP@0.5 against {truth} boxes" + "".join(f"{name:>12}" for name in networks))
        first = next(iter(networks.values()))
        for label, entry in first["precision"][truth].items():
            values = "".join(f"{network['precision'][truth][label]['ap']:12.3f}" for network in networks.values())
            print(f"  {label:15}{entry['boxes']:6d} boxes{values}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder of labels.json")
    parser.add_argument("--work", type=Path, required=True, help="folder for the helper program")
    parser.add_argument("--network", type=Path, help="ONNX file of export.py; its .yaml lies beside it")
    parser.add_argument("--teacher", type=Path, help="COCO SSD for comparison")
    parser.add_argument("--teacher-labels", type=Path, help="text file, class id = line number from 0")
    parser.add_argument("--nms-iou", type=float, default=0.5, help="suppression threshold, for both networks")
    parser.add_argument("--output", type=Path, help="JSON file for the figures")
    arguments = parser.parse_args()
    if arguments.teacher and not arguments.teacher_labels:
        parser.error("--teacher needs --teacher-labels")
    records = load_records(arguments.data, "val")
    pictures = [arguments.data / record.image for record in records]
    program = dnn_forward.build(arguments.work)
    networks = {}
    if arguments.network:
        description = model_description.read(arguments.network.with_suffix(".yaml"))
        outputs, times = dnn_forward.forward(program, arguments.network, pictures, description["input"]["width"])
        detections = own_detections(outputs, description, arguments.nms_iou)
        networks["own"] = {"precision": precision_table(records, detections), "forward": times}
    if arguments.teacher:
        outputs, times = dnn_forward.forward(program, arguments.teacher, pictures, TEACHER_SIZE)
        labels = arguments.teacher_labels.read_text().splitlines()
        detections = teacher_detections(outputs["detection_out"], labels, arguments.nms_iou)
        networks["teacher"] = {"precision": precision_table(records, detections), "forward": times}
    if not networks:
        parser.error("nothing to evaluate: give --network, --teacher or both")
    print_table(networks)
    for name, network in networks.items():
        print(f"{name}: forward median {network['forward']['median_ms']:.1f} ms, "
              f"min {network['forward']['min_ms']:.1f} ms on 2 threads")
    if arguments.output:
        arguments.output.write_text(json.dumps(networks, indent=2) + "\n")


if __name__ == "__main__":
    main()
