"""What replay.launch prints at its end, without a graph."""

import sys
import unittest
from pathlib import Path
from types import SimpleNamespace as Message

PACKAGE = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(PACKAGE / "src"))
from pi_bringup.replay_summary import Summary  # noqa: E402


def header(seconds):
    return Message(stamp=Message(to_sec=lambda: seconds))


def pose(seconds, x):
    position = Message(x=x, y=0.0, z=0.0)
    return Message(header=header(seconds), pose=Message(pose=Message(position=position)))


def picture(*labels):
    return Message(detections=[Message(results=[Message(id=label)]) for label in labels])


class TheSummary(unittest.TestCase):
    def test_names_what_was_localised_seen_and_heard(self):
        summary = Summary()
        for seconds, x in ((10.0, 0.0), (11.0, 2.0), (12.0, 1.0)):
            summary.on_odometry(pose(seconds, x))
        summary.on_labels(Message(ids=[0, 2], names=["person", "car"]))
        for labels in ((0, 0), (0, 2), (7,), ()):
            summary.on_detections(picture(*labels))
        summary.on_obstacles(Message(obstacles=[1]))
        summary.on_obstacles(Message(obstacles=[]))
        summary.on_command(Message(header=header(11.5), text="stop", confidence=0.91))
        self.assertEqual(["localised: 3 poses over 2.0 s, a way of 3.0 m",
                          "seen: person in 2, car in 1, label 7 in 1 of 4 pictures; obstacles in 1 of 2 reports",
                          "heard: \"stop\" (0.91) at 1.5 s"], summary.lines())

    def test_says_so_where_nothing_came(self):
        localised, seen, heard = Summary().lines()
        self.assertIn("no pose: is imu/data in the recording", localised)
        self.assertIn("no picture was looked at", seen)
        self.assertEqual("heard: no command", heard)


if __name__ == "__main__":
    unittest.main()
