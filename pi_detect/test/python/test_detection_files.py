#!/usr/bin/python3
import json
import sys
import tempfile
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "src"))

from pi_detect.detection_files import load_boxes, load_detections, pair_pictures
from pi_detect.errors import ToolError

BOXES = [{"image": "a/1.jpg", "width": 100, "height": 50, "boxes": [["cat", 1, 2, 30, 40.5], ["dog", 5, 5, 9, 9]]},
         {"image": "a/2.jpg", "width": 100, "height": 50, "boxes": []}]
FOUND = [{"image": "a/1.jpg", "class": "cat", "score": 0.75, "x1": 1, "y1": 2, "x2": 31.5, "y2": 40}]


class Case(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.path = Path(folder.name) / "file.json"

    def write(self, content):
        self.path.write_text(content if isinstance(content, str) else json.dumps(content))
        return self.path

    def assert_refused(self, load, content, message):
        with self.assertRaisesRegex(ToolError, message) as caught:
            load(self.write(content))
        self.assertIn(str(self.path), str(caught.exception))
        self.assertNotIn("\n", str(caught.exception))


class Boxes(Case):
    def test_boxes_are_read_by_picture(self):
        first, second = load_boxes(self.write(BOXES))
        self.assertEqual((first.image, first.classes), ("a/1.jpg", ["cat", "dog"]))
        self.assertEqual(first.boxes.tolist(), [[1, 2, 30, 40.5], [5, 5, 9, 9]])
        self.assertEqual(second.boxes.shape, (0, 4))

    def test_wrong_content_is_refused_by_place_and_value(self):
        def box(*values):
            return [{**BOXES[0], "boxes": [list(values)]}]

        for content, message in (
                ({}, r"the file = \{\}, must be a list"), ([], "no picture"), ([3], r"\[0\] = 3"),
                ([{"width": 1}], r"\[0\] has no field image"),
                (BOXES + BOXES[:1], r"\[2\].image = a/1.jpg is there twice"),
                ([{**BOXES[0], "width": 0}], r"\[0\].width = 0, must be a positive"),
                (box("cat", 1, 2, 3), r"boxes\[0\] = \[\"cat\", 1, 2, 3\]"), (box(7, 1, 2, 3, 4), "class = 7"),
                (box("cat", 1, 2, "3", 4), r"boxes\[0\] x2 = \"3\""), (box("cat", 1, 2, True, 4), "x2 = true"),
                (box("cat", 9, 2, 3, 4), "x1 <= x2"),
                (box("cat", 1, 2, float("nan"), 4), "x2 = NaN, must be a finite")):
            self.assert_refused(load_boxes, content, message)

    def test_a_missing_file_and_no_json_are_refused(self):
        with self.assertRaisesRegex(ToolError, "file.json: No such file"):
            load_boxes(self.path)
        self.assert_refused(load_boxes, "[{]", "is not JSON")
        self.assert_refused(load_boxes, "[" * 100_000, "is not JSON")
        self.path.write_bytes(b"\xff\xfe\x00")
        with self.assertRaisesRegex(ToolError, "is not JSON"):
            load_boxes(self.path)


class FoundObjects(Case):
    def test_a_list_does_not_say_which_pictures_were_looked_at(self):
        found = load_detections(self.write(FOUND))
        self.assertEqual((found.model, found.images, found.found_in, found.classes), ("", None, ["a/1.jpg"], ["cat"]))
        self.assertEqual(found.rows.tolist(), [[0.75, 1, 2, 31.5, 40]])
        self.assertEqual(load_detections(self.write([])).rows.shape, (0, 5))

    def test_an_object_says_it(self):
        found = load_detections(self.write({"model": "m", "images": ["a/1.jpg", "a/2.jpg"], "detections": FOUND}))
        self.assertEqual((found.model, found.images, found.classes), ("m", ["a/1.jpg", "a/2.jpg"], ["cat"]))

    def test_wrong_content_is_refused_by_place_and_value(self):
        def one(**fields):
            return [{**FOUND[0], **fields}]

        for content, message in (
                (3, "the file = 3, must be a list of detections"), ([[]], r"\[0\] = \[\]"),
                ([{"image": "a"}], r"\[0\] has no field class"), (one(score=1.5), r"\[0\].score = 1.5.*\[0, 1\]"),
                (one(score=float("nan")), r"\[0\].score = NaN"), (one(x1=float("inf")), r"\[0\].x1 = Infinity"),
                (one(y2=0), "y1 <= y2"), (one(image=""), r"image = \"\""), (one(**{"class": 3}), "class = 3"),
                ({"detections": []}, "the file has no field images"), ({"images": 3, "detections": []}, "images = 3"),
                ({"images": [], "detections": one(score="x")}, r"detections\[0\].score = \"x\""),
                ({"images": ["b.jpg"], "detections": FOUND}, "a/1.jpg, which its images do not list")):
            self.assert_refused(load_detections, content, message)


class Pairs(unittest.TestCase):
    def test_the_longest_common_end_decides(self):
        images = ["set/a/1.jpg", "set/b/1.jpg", "set/b/2.jpg"]
        pairs, unknown = pair_pictures(["/data/set/b/1.jpg", "elsewhere/2.jpg", "a/1.jpg", "3.jpg"], images)
        self.assertEqual(pairs, {"/data/set/b/1.jpg": 1, "elsewhere/2.jpg": 2, "a/1.jpg": 0})
        self.assertEqual(unknown, ["3.jpg"])

    def test_a_part_of_a_file_name_is_no_match(self):
        self.assertEqual(pair_pictures(["11.jpg"], ["a/1.jpg"]), ({}, ["11.jpg"]))

    def test_ambiguous_names_are_refused(self):
        with self.assertRaisesRegex(ToolError, "c/1.jpg fits a/1.jpg, b/1.jpg"):
            pair_pictures(["c/1.jpg"], ["a/1.jpg", "b/1.jpg"])
        with self.assertRaisesRegex(ToolError, "x/1.jpg and y/1.jpg both fit a/1.jpg"):
            pair_pictures(["x/1.jpg", "y/1.jpg"], ["a/1.jpg"])


if __name__ == "__main__":
    unittest.main()
