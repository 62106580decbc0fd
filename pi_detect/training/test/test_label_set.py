#!/usr/bin/python3
import json
import sys
import tempfile
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from label_set import CLASSES, human_truth, load_records, target_truth

PERSON, CAR, BUS = (CLASSES.index(name) for name in ("person", "car", "bus"))
LEFT, RIGHT, FAR = [10, 10, 50, 90], [100, 10, 150, 90], [170, 10, 190, 40]


class LabelSet(unittest.TestCase):
    def record(self, teacher, human=(), human_classes=(), source="made", ignored=()):
        """@param teacher, human  lists of (name, box) with a score for the teacher's"""
        entry = {"image": "a.jpg", "width": 200, "height": 100, "source": source, "split": "train",
                 "labels": "human" if human_classes else "teacher", "human_classes": list(human_classes),
                 "boxes": [[name, *box, 1.0] for name, box in human], "ignore_boxes": list(ignored)}
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "labels.json").write_text(json.dumps([entry]))
            return load_records(folder, "train", {"a.jpg": [[name, *box, score] for name, box, score in teacher]})[0]

    def targets(self, record):
        return [(label, *box, round(float(score), 2))
                for label, box, score in zip(record.classes, record.boxes.tolist(), record.scores)]

    def test_the_teacher_labels_what_people_did_not(self):
        record = self.record([("car", RIGHT, 0.6), ("car", FAR, 0.2)], [("person", LEFT)], ["person"])
        self.assertEqual(self.targets(record), [(PERSON, *LEFT, 1.0), (CAR, *RIGHT, 0.6)])
        self.assertEqual(record.ignored_boxes.tolist(), [FAR])

    def test_the_teacher_does_not_repeat_a_box_of_people(self):
        record = self.record([("person", [11, 12, 51, 90], 0.9)], [("person", LEFT)], ["person"])
        self.assertEqual(self.targets(record), [(PERSON, *LEFT, 1.0)])
        self.assertEqual(len(record.ignored_boxes), 0)

    def test_a_box_that_people_left_out_is_ignored_or_a_target_by_source(self):
        teacher, human = [("person", RIGHT, 0.8)], [("person", LEFT)]
        self.assertEqual(self.record(teacher, human, ["person"]).ignored_boxes.tolist(), [RIGHT])
        record = self.record(teacher, human, ["person"], "pedestrian_behaviour")
        self.assertEqual(self.targets(record), [(PERSON, *RIGHT, 0.8)])

    def test_people_drawn_without_heads_get_the_teachers_box(self):
        record = self.record([("person", [10, 0, 50, 90], 0.6)], [("person", [10, 20, 50, 90]), ("person", FAR)],
                             ["person"], "pedestrian_behaviour")
        self.assertEqual(self.targets(record), [(PERSON, 10, 0, 50, 90, 1.0)])
        self.assertEqual(record.human_boxes.tolist(), [[PERSON, 10, 0, 50, 90]])
        self.assertEqual(record.ignored_boxes.tolist(), [FAR])

    def test_of_two_vehicles_in_one_place_the_better_remains(self):
        record = self.record([("bus", LEFT, 0.5), ("car", [10, 11, 50, 90], 0.7), ("person", LEFT, 0.4)])
        self.assertEqual([row[0] for row in self.targets(record)], [CAR, PERSON])

    def test_a_region_left_open_that_holds_a_target_is_open_no_more(self):
        record = self.record([("car", LEFT, 0.7)], ignored=[[9, 10, 50, 92], FAR])
        self.assertEqual(record.ignored_boxes.tolist(), [FAR])

    def test_truth_of_people_has_their_classes_only(self):
        record = self.record([("car", RIGHT, 0.6)], [("person", LEFT)], ["person", "bus"])
        truth = human_truth(record)
        self.assertEqual(set(truth), {PERSON, BUS})
        self.assertEqual(truth[PERSON][0].tolist(), [LEFT])
        self.assertEqual(len(truth[BUS][0]), 0)

    def test_truth_of_targets_asks_for_certain_boxes_and_excuses_others(self):
        truth = target_truth(self.record([("car", RIGHT, 0.6), ("car", FAR, 0.4)]))
        self.assertEqual(truth[CAR][0].tolist(), [RIGHT])
        self.assertEqual(truth[CAR][1].tolist(), [FAR])

    def test_a_split_without_pictures_is_refused(self):
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "labels.json").write_text("[]")
            with self.assertRaisesRegex(ValueError, "no picture of split 'val'"):
                load_records(folder, "val", {})


if __name__ == "__main__":
    unittest.main()
