#!/usr/bin/python3
"""Tracks of people in two films beside hand-made ones, and beside stored floors.

vtest.avi is in Debian's opencv-doc, the other film is in the folder that PI_EDGE_DATA names. What is judged are the
confirmed tracks that are seen in a picture.
"""

import json
import os
import subprocess
import tempfile
import unittest
from pathlib import Path

import yaml

PACKAGE = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get("PI_EDGE_DATA", "none")) / "detect"
PEDESTRIANS = Path("/usr/share/doc/opencv-doc/examples/data/vtest.avi")
ONE_BY_ONE = DATA / "videos" / "one-by-one-person-detection.mp4"
FLOORS = yaml.safe_load(Path(__file__).with_name("film_floors.yaml").read_text(encoding="utf-8"))
TIMEOUT_S = 600  # 200 pictures on a loaded computer


class Films(unittest.TestCase):
    def figures(self, film, truth, model, *arguments):
        if not DATA.is_dir():
            self.skipTest(f"no {DATA}; set PI_EDGE_DATA")
        if not film.is_file():
            self.skipTest(f"no {film}" + ("; it is in Debian's opencv-doc" if film == PEDESTRIANS else ""))
        with tempfile.TemporaryDirectory() as folder:
            figures = Path(folder) / "figures.json"
            ended = subprocess.run(
                [Path(os.environ["PROGRAMS"]) / "bench_tracking", film, PACKAGE / "test" / "data" / truth,
                 PACKAGE / "config" / "models" / f"{model}.yaml", "--threads", "1", "--json", figures, *arguments],
                stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=TIMEOUT_S, check=False)
            self.assertEqual(ended.returncode, 0, ended.stdout)
            return json.loads(figures.read_text())

    def check(self, name, *arguments):
        figures, floors = self.figures(*arguments), FLOORS[name]
        most_switches = floors.pop("switches_per_minute")
        for what, floor in floors.items():
            with self.subTest(what):
                self.assertGreaterEqual(figures[what], floor)
        self.assertLessEqual(figures["switches_per_minute"], most_switches)

    def test_pedestrians_accurate(self):
        self.check("pedestrians_accurate", PEDESTRIANS, "vtest_tracks.csv", "accurate")

    def test_pedestrians_fast(self):
        self.check("pedestrians_fast", PEDESTRIANS, "vtest_tracks.csv", "fast")

    def test_pedestrians_before_a_camera_that_turns(self):
        self.check("pan_fast", PEDESTRIANS, "vtest_tracks.csv", "fast", "--window", "576", "--pan", "20")

    def test_one_by_one(self):
        self.check("one_by_one_fast", ONE_BY_ONE, "one_by_one_tracks.csv", "fast")


if __name__ == "__main__":
    unittest.main()
