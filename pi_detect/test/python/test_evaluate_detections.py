#!/usr/bin/python3
import contextlib
import io
import json
import sys
import tempfile
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "src"))

from pi_detect.evaluate_detections import main

# Two cats and a dog. A cat is found exactly, the other by a box of IoU 0.6 and, with a lower score, by one of IoU 0.8;
# the dog's detection is in the wrong place; a bird is found where none is.
BOXES = [{"image": "set/1.png", "width": 100, "height": 100, "boxes": [["cat", 0, 0, 10, 10], ["dog", 50, 50, 60, 60]]},
         {"image": "set/2.png", "width": 100, "height": 100, "boxes": [["cat", 20, 20, 30, 30]]}]


def found(image, label, score, *box):
    return {"image": image, "class": label, "score": score, **dict(zip(("x1", "y1", "x2", "y2"), box))}


FOUND = [found("/x/set/1.png", "cat", 0.9, 0, 0, 10, 10), found("/x/set/2.png", "cat", 0.8, 20, 20, 30, 26),
         found("/x/set/2.png", "cat", 0.7, 20, 20, 30, 28), found("/x/set/1.png", "dog", 0.6, 0, 50, 10, 60),
         found("/x/set/2.png", "bird", 0.55, 1, 1, 5, 5)]
SEEN = ["/x/set/1.png", "/x/set/2.png"]


class EvaluateDetections(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)
        self.boxes, self.found = self.folder / "boxes.json", self.folder / "found.json"
        self.boxes.write_text(json.dumps(BOXES))
        self.write({"model": "net", "images": SEEN, "detections": FOUND})

    def write(self, content):
        self.found.write_text(json.dumps(content))

    def run_tool(self, *arguments):
        """@return (exit status, output, errors)"""
        output, errors = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(output), contextlib.redirect_stderr(errors):
            try:
                status = main(["--boxes", str(self.boxes), str(self.found), *map(str, arguments)])
            except SystemExit as left:
                status = left.code
        return status, output.getvalue(), errors.getvalue()

    def figures(self, *arguments):
        path = self.folder / "figures.json"
        status, _, errors = self.run_tool("--json", path, *arguments)
        self.assertEqual((status, errors), (0, ""))
        return json.loads(path.read_text())

    def test_figures_are_those_of_the_definition(self):
        figures = self.figures()
        self.assertEqual((figures["model"], figures["pictures"], figures["boxes"]), ("net", 2, 3))
        self.assertEqual(figures["iou_thresholds"], [0.5, 0.55, 0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9, 0.95])
        cat, dog, bird = (figures["classes"][name] for name in ("cat", "dog", "bird"))
        self.assertEqual((cat["boxes"], cat["detections"], cat["ap_50"]), (2, 3, 1.0))
        # At 0.65 to 0.8 the better box of the second cat is an error, the worse one (IoU 0.8) a hit: precision 1 up to
        # recall 0.5 (51 of 101), then 2/3. From 0.85 on only the first cat is found.
        middle, high = (51 + 50 * 2 / 3) / 101, 51 / 101
        self.assertAlmostEqual(cat["ap"], (3 * 1.0 + 4 * middle + 3 * high) / 10, places=5)
        self.assertEqual((dog["ap_50"], dog["ap"]), (0.0, 0.0))
        self.assertEqual((bird["boxes"], bird["ap_50"], bird["at"]["precision"], bird["at"]["recall"]),
                         (0, None, 0.0, None))
        self.assertAlmostEqual(figures["map_50"], 0.5)  # of cat and dog: no bird is there to be found
        self.assertEqual(cat["at"], {"score": 0.5, "found": 3, "precision": round(2 / 3, 6), "recall": 1.0, "f1": 0.8})

    def test_pooled_precision_and_recall_follow_the_score(self):
        pooled = {entry["score"]: entry for entry in self.figures()["pooled"]}
        self.assertEqual(list(pooled), [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9])
        self.assertEqual((pooled[0.1]["found"], pooled[0.1]["precision"], pooled[0.1]["recall"]),
                         (5, 0.4, round(2 / 3, 6)))
        self.assertEqual((pooled[0.9]["found"], pooled[0.9]["precision"], pooled[0.9]["f1"]), (1, 1.0, 0.5))

    def test_scores_for_a_tracker_are_those_with_a_chance_to_be_right(self):
        # Of ten detections at each score, as many are right as the score says.
        boxes, detections = [], []
        for tenths in range(1, 10):
            for number in range(10):
                name = f"{tenths}_{number}.png"
                boxes.append({"image": name, "width": 100, "height": 100, "boxes": [["cat", 0, 0, 10, 10]]})
                left = 0 if number < tenths else 50
                detections.append(found(name, "cat", tenths / 10, left, 0, left + 10, 10))
        self.boxes.write_text(json.dumps(boxes))
        self.write(detections)
        tracker = self.figures()["tracker"]
        self.assertAlmostEqual(tracker["low_score"], 1 / 3, delta=0.05)
        self.assertAlmostEqual(tracker["high_score"], 4 / 5, delta=0.05)
        self.assertRegex(self.run_tool()[1], r"(?m)^for a tracker: low_score 0\.3\d \(right: 0\.33\), high_score 0\.")

    def test_interpolation_classes_and_score_can_be_chosen(self):
        area = self.figures("--interpolation", "area")["classes"]["cat"]
        self.assertAlmostEqual(area["ap"], (3 * 1.0 + 4 * (0.5 + 0.5 * 2 / 3) + 3 * 0.5) / 10, places=5)
        cats = self.figures("--classes", "cat", "--score", "0.75")
        self.assertEqual(list(cats["classes"]), ["cat"])
        self.assertEqual((cats["boxes"], cats["classes"]["cat"]["at"]["found"], cats["map_50"]), (2, 2, 1.0))

    def test_at_most_a_hundred_detections_of_a_class_in_a_picture_count(self):
        worse = [found("2.png", "cat", 0.5 + i / 1000, 60, 60, 70, 70) for i in range(100)]
        self.write(worse + [found("2.png", "cat", 0.4, 20, 20, 30, 30)])
        cat = self.figures()["classes"]["cat"]
        self.assertEqual((cat["detections"], cat["ap_50"]), (100, 0.0))

    def test_the_table_shows_classes_and_means(self):
        status, output, _ = self.run_tool()
        self.assertEqual(status, 0)
        self.assertRegex(output, r"(?m)^net: 2 pictures, 3 boxes$")
        self.assertRegex(output, r"(?m)^cat +2 +3 +1\.000 +0\.78\d +0\.667 +1\.000$")
        self.assertRegex(output, r"(?m)^bird +0 +1 +- +- +0\.000 +-$")
        self.assertRegex(output, r"(?m)^mean of 2 classes +3 +5 +0\.500 ")
        self.assertRegex(output, r"(?m)^ +0\.9 +1 +1\.000 +0\.333 +0\.500$")

    def test_a_plot_is_drawn(self):
        try:
            import matplotlib  # noqa: F401
        except ImportError:
            self.skipTest("matplotlib is not installed (Debian: python3-matplotlib)")
        picture = self.folder / "curve.png"
        self.assertEqual(self.run_tool("--plot", picture)[0], 0)
        self.assertEqual(picture.read_bytes()[:4], b"\x89PNG")
        status, _, errors = self.run_tool("--plot", self.folder / "missing" / "curve.png")
        self.assertEqual((status, errors.count("\n")), (1, 1))

    def test_a_list_counts_all_pictures_with_boxes(self):
        self.write(FOUND[:1])
        self.assertEqual(self.figures()["classes"]["cat"]["ap_50"], round(51 / 101, 6))
        self.write([])
        figures = self.figures()
        self.assertEqual((figures["map_50"], figures["pooled"][0]["precision"], figures["pooled"][0]["recall"]),
                         (0.0, None, 0.0))

    def test_pictures_that_were_not_looked_at_are_an_error_or_left_out(self):
        self.write({"images": SEEN[:1] + ["new.png"], "detections": FOUND[:1]})
        status, _, errors = self.run_tool()
        self.assertEqual(status, 1)
        self.assertIn("no true boxes for picture new.png", errors)
        self.write({"images": SEEN[:1], "detections": FOUND[:1]})
        status, _, errors = self.run_tool()
        self.assertEqual(status, 1)
        self.assertRegex(errors, r"^evaluate_detections: 1 of 2 pictures .*\(set/2.png\).*--only-seen\n$")
        figures = self.figures("--only-seen")
        self.assertEqual((figures["pictures"], figures["boxes"], figures["classes"]["cat"]["ap_50"]), (1, 2, 1.0))

    def test_only_seen_needs_to_know_what_was_seen(self):
        self.write(FOUND)
        status, _, errors = self.run_tool("--only-seen")
        self.assertEqual(status, 1)
        self.assertIn("lists the pictures looked at", errors)
        self.write({"images": ["new.png"], "detections": []})
        self.assertIn("none of the 1 pictures", self.run_tool("--only-seen")[2])

    def test_input_that_cannot_be_used_is_one_line_and_status_1(self):
        self.found.write_text("{")
        status, output, errors = self.run_tool()
        self.assertEqual((status, output, errors.count("\n")), (1, "", 1))
        self.assertIn("found.json is not JSON", errors)
        self.write(FOUND)
        status, _, errors = self.run_tool("--classes", "cat,cow")
        self.assertEqual(status, 1)
        self.assertIn("--classes cow: neither boxes nor detections have this class; known are bird, cat, dog", errors)
        status, _, errors = self.run_tool("--json", self.folder / "missing" / "figures.json")
        self.assertEqual((status, errors.count("\n")), (1, 1))

    def test_a_wrong_command_line_is_status_2(self):
        for arguments in (("--score", "2"), ("--classes", "cat,"), ("--interpolation", "eleven"), ("--what",)):
            self.assertEqual(self.run_tool(*arguments)[0], 2)


if __name__ == "__main__":
    unittest.main()
