#!/usr/bin/python3
"""Average precision of the networks on photographs of COCO, beside stored floors.

Guards against faults of reading, scaling and decoding. The photographs are of COCO's training set, which fast and
accurate have seen: their figures are no claim about quality. street has not seen them.
"""

import os
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import yaml

PACKAGE = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(PACKAGE / "src"))

from pi_detect.detection_files import load_boxes, load_detections
from pi_detect.evaluation import evaluate

FLOORS = yaml.safe_load(Path(__file__).with_name("floors.yaml").read_text(encoding="utf-8"))
LEAST_SCORE = 0.01  # the curve of precision and recall goes down to it
TIMEOUT_S = 600     # 126 photographs on a loaded computer


class Photographs(unittest.TestCase):
    def setUp(self):
        self.data = Path(os.environ.get("PI_EDGE_DATA", "none")) / "detect"
        if not (self.data / "boxes_dev.json").is_file():
            self.skipTest(f"no {self.data / 'boxes_dev.json'}; set PI_EDGE_DATA")

    def detect(self, model):
        """@return evaluation of the network's detections"""
        with tempfile.TemporaryDirectory() as folder:
            found = Path(folder) / "found.json"
            ended = subprocess.run(
                [Path(os.environ["PROGRAMS"]) / "detect_images", "--model",
                 PACKAGE / "config" / "models" / f"{model}.yaml", "--output", found,
                 "--score", str(LEAST_SCORE), "--threads", "1", "--name-pictures", "--quiet", "--direct",
                 self.data / "images_dev"], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                timeout=TIMEOUT_S, check=False)
            self.assertEqual(ended.returncode, 0, ended.stdout)
            self.assertNotIn("stands in", ended.stdout)
            return evaluate(load_boxes(self.data / "boxes_dev.json"), load_detections(found))

    def check(self, model):
        result = self.detect(model)
        floors = FLOORS[model]
        self.assertEqual(result.pictures, 126)
        self.assertGreaterEqual(result.mean(1), floors.get("mean", 0.0), "mean over all classes")
        for label, floor in floors["classes"].items():
            with self.subTest(label):
                self.assertGreaterEqual(result.classes[label][1], floor)

    def test_accurate(self):
        self.check("accurate")

    def test_fast(self):
        self.check("fast")

    def test_street(self):
        self.check("street")


if __name__ == "__main__":
    unittest.main()
