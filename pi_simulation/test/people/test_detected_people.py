"""A network that was trained on photographs finds the simulated people in the pictures that the live cameras give, and
nothing else that it takes for people."""

import os
import sys
import unittest
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(PACKAGE / "bench"))
import detected_people  # noqa: E402

# Bounds for few pictures. docs/benchmarks/vehicle.md has what 728 pictures reach.
LEAST_RECALL = 0.72
MOST_ELSEWHERE = 0.02


class LivePictures(unittest.TestCase):
    def test_a_detector_finds_the_people_and_nobody_else(self):
        models = Path(os.environ.get("PI_EDGE_DATA", ".")) / "detect" / "models"
        if not (models / "yolox_nano_416.onnx").exists():
            self.skipTest("no %s; set PI_EDGE_DATA" % (models / "yolox_nano_416.onnx"))
        figures = detected_people.simulated(detected_people.Yolox(models), seeds=(1, 2, 3), rate_hz=0.5)
        hits = figures.hits()
        print("%d pictures, %d people within 12 m, %d of them found, %d found where nobody is" % (
            figures.pictures, len(hits), sum(hits), figures.elsewhere))
        self.assertGreaterEqual(len(hits), 50)
        self.assertGreaterEqual(sum(hits), LEAST_RECALL * len(hits))
        self.assertLessEqual(figures.elsewhere, MOST_ELSEWHERE * figures.pictures)


if __name__ == "__main__":
    unittest.main()
