"""Judges the detections of a file by true boxes.

  evaluate_detections --boxes boxes.json detections.json [--plot curve.png] [--json figures.json]

Prints average precision per class at IoU 0.5 (AP@0.5) and as the mean over IoU 0.5, 0.55 .. 0.95 (AP@.5:.95), their
means over the classes that have boxes, and precision, recall and F1 over the score. Exit status: 0; 1 if a file cannot
be used; 2 for a wrong command line.
"""

import argparse
import json
import sys
from pathlib import Path

from pi_detect.average_precision import INTERPOLATIONS
from pi_detect.detection_files import load_boxes, load_detections
from pi_detect.errors import ToolError
from pi_detect.evaluation import evaluate
from pi_detect.evaluation_report import as_json, plot, table


def _score(text):
    value = float(text)
    if not 0.0 <= value <= 1.0:
        raise argparse.ArgumentTypeError(f"{text}, must be in [0, 1]")
    return value


def _names(text):
    names = [name.strip() for name in text.split(",")]
    if not all(names):
        raise argparse.ArgumentTypeError(f"'{text}', must be names with commas between them")
    return list(dict.fromkeys(names))


def parse(arguments):
    parser = argparse.ArgumentParser(prog="evaluate_detections", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("detections", type=Path, help="JSON file of detect_images")
    parser.add_argument("--boxes", type=Path, required=True,
                        help="JSON file of true boxes: [{image, width, height, boxes: [[class, x1, y1, x2, y2]]}] [px]")
    parser.add_argument("--classes", type=_names, help="judge these classes only, as in person,car")
    parser.add_argument("--score", type=_score, default=0.5,
                        help="score at which precision and recall of each class are shown; default: %(default)s")
    parser.add_argument("--interpolation", choices=INTERPOLATIONS, default="coco",
                        help="area under the curve: mean at 101 recalls (coco), all points as VOC since 2010 (area); "
                        "default: %(default)s")
    parser.add_argument("--only-seen", action="store_true",
                        help="judge only pictures that were looked at and have true boxes")
    parser.add_argument("--plot", type=Path, metavar="FILE.png", help="draw precision over recall")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures")
    return parser.parse_args(arguments)


def run(arguments):
    detections = load_detections(arguments.detections)
    result = evaluate(load_boxes(arguments.boxes), detections, arguments.classes, arguments.only_seen,
                      arguments.interpolation)
    title = detections.model or arguments.detections.stem
    print(f"{title}: {result.pictures} pictures, {result.pooled.boxes} boxes\n")
    print(table(result, arguments.score))
    if arguments.json:
        try:
            arguments.json.write_text(json.dumps(as_json(result, arguments.score, title), indent=2) + "\n")
        except OSError as error:
            raise ToolError(f"--json {arguments.json}: {error.strerror or error}") from error
    if arguments.plot:
        plot(result, arguments.score, title, arguments.plot)


def main(arguments=None):
    """@return the exit status"""
    try:
        run(parse(arguments))
    except ToolError as error:
        print(f"evaluate_detections: {error}", file=sys.stderr)
        return 1
    return 0
