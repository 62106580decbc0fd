"""What the detector called people beside where people truly were, without a graph."""

import sys
import unittest
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(PACKAGE / "scripts"))
from campus_drive import labels  # noqa: E402

AHEAD = [labels.IMU_AHEAD_M + 8.0, 0.0]  # in the middle of the picture


def figures(people, boxes, stamp=10.0):
    return labels.figures([{"stamp": 10.0, "people": people}], [(stamp, boxes)])


class Labels(unittest.TestCase):
    def test_a_person_under_a_box_has_the_label(self):
        self.assertEqual({"in_view": 1, "labelled": 1, "pictures": 1, "false": 0},
                         figures([AHEAD], [("person", 0.6, 300.0, 340.0)]))

    def test_left_is_left_in_the_picture(self):
        found = figures([[labels.IMU_AHEAD_M + 8.0, 4.0]], [("person", 0.6, 140.0, 180.0)])
        self.assertEqual((1, 1, 0), (found["in_view"], found["labelled"], found["false"]))

    def test_another_label_and_a_low_score_do_not_count(self):
        for box in (("car", 0.9, 300.0, 340.0), ("person", 0.3, 300.0, 340.0)):
            found = figures([AHEAD], [box])
            self.assertEqual((0, 0), (found["labelled"], found["false"]))

    def test_a_label_at_nobody_is_false_and_one_far_away_is_not(self):
        self.assertEqual(1, figures([AHEAD], [("person", 0.6, 500.0, 540.0)])["false"])
        far = figures([[25.0, 0.0]], [("person", 0.6, 310.0, 330.0)])
        self.assertEqual((0, 0), (far["in_view"], far["false"]))

    def test_people_outside_of_the_picture_need_no_label(self):
        self.assertEqual(0, figures([[-3.0, 0.0], [2.5, 6.0]], [])["in_view"])

    def test_a_picture_without_a_state_of_its_time_is_left_out(self):
        self.assertEqual(0, figures([AHEAD], [], stamp=11.0)["pictures"])


if __name__ == "__main__":
    unittest.main()
