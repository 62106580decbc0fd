"""The table and the JUnit file of scenario_suite, without a graph."""

import sys
import unittest
from pathlib import Path
from xml.etree import ElementTree

PACKAGE = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(PACKAGE / "scripts"))
from scenarios import results  # noqa: E402


def drive(name="crossing", failures=(), collisions=(), expect="reach", **more):
    tree = {"expect": expect, "reached": not failures, "collisions": list(collisions), "nearest_m": 1.234,
            "hardest_braking": 2.5, "standstills": [{"cause": None}, {"cause": "a spoken stop"}],
            "labels": {"in_view": 20, "labelled": 15, "pictures": 100, "false": 3},
            "localisation": {"max_m": 0.25}, "failures": list(failures)}
    return {"name": name, "seed": 2, "seconds": 41.3, "tree": {**tree, **more}, "error": ""}


NO_DRIVE = {"name": "broken", "seed": 1, "seconds": 3.0, "tree": None, "error": "no drive: drive_campus: no such file"}


def hit(name, speed):
    return {"speed": speed, "with": {"actor": name, "class": "person"}}


class Table(unittest.TestCase):
    def test_a_row_has_a_text_for_each_title(self):
        for one in (drive(), NO_DRIVE):
            self.assertEqual(len(results.TITLES), len(results.row(one)))
        self.assertEqual(["crossing", "2", "yes", "no", "1.23", "2.5", "1", "15/20", "3/100", "0.25", "41", "passed"],
                         results.row(drive()))

    def test_a_collision_is_told_with_the_speed_of_the_fastest(self):
        row = results.row(drive(failures=["collision"], collisions=[hit("", 0.4), hit("runner", 2.04)]))
        self.assertIn("runner 2.0 m/s", row)
        self.assertEqual("FAILED", row[-1])

    def test_what_was_not_measured_is_no_zero(self):
        row = results.row(drive(nearest_m=None, hardest_braking=None, localisation={"max_m": None},
                                labels={"in_view": 0, "labelled": 0, "pictures": 0, "false": 0}))
        self.assertEqual(4, row.count("-"))

    def test_what_was_expected_stands_beside_what_was_reached(self):
        self.assertIn("no (stop)", results.row(drive(expect="stop", reached=False)))

    def test_the_last_line_counts(self):
        lines = results.lines([drive(), drive(failures=["x"], collisions=[hit("a", 1.0)]), NO_DRIVE])
        self.assertEqual("1 of 3 drives passed, 1 with a collision, 1 without a drive", lines[-1])
        self.assertIn("broken, seed 1: no drive: drive_campus: no such file", lines)


class Junit(unittest.TestCase):
    def test_failures_and_errors_are_apart(self):
        suite = ElementTree.fromstring(results.junit([drive(), drive("hit", ["a < b", "c"]), NO_DRIVE]))
        self.assertEqual(("3", "1", "1"), tuple(suite.get(key) for key in ("tests", "failures", "errors")))
        cases = {case.get("classname"): case for case in suite}
        self.assertIsNone(cases["scenario_suite.crossing"].find("failure"))
        failure = cases["scenario_suite.hit"].find("failure")
        self.assertEqual(("a < b", "a < b\nc"), (failure.get("message"), failure.text))
        self.assertIsNotNone(cases["scenario_suite.broken"].find("error"))


if __name__ == "__main__":
    unittest.main()
