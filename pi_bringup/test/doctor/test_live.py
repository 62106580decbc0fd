"""Judgements of what was heard of a graph."""

import struct
import unittest

from fake_root import FakeRoot
from pi_bringup.doctor import live

TREE = {"odom": {"map"}, "base_link": {"odom"}, "left_optical": {"base_link"}, "right_optical": {"base_link"},
        "imu_link": {"base_link"}}


def heard(rate, age=0.01, seconds=3.0):
    count = int(rate * seconds) + 1
    return live.Heard(True, count, 100.0, 100.0 + seconds, [age] * count)


class Live(FakeRoot):
    def topic(self, one, rate=200.0):
        return live.judge_topics({"imu/data": one}, {"imu/data": rate})[0]

    def test_topics(self):
        self.expect("OK", self.topic(heard(199.0)), "199.0 Hz, stamps 10 ms old")
        self.expect("WARN", self.topic(heard(100.0)), "100.0 Hz, expected are 200 Hz")
        self.expect("FAIL", self.topic(heard(200.0, 3600.0)), "stamps +3600.0 s old", "clocks")
        self.expect("FAIL", self.topic(heard(200.0, -5.0)), "stamps -5.0 s old")
        self.expect("WARN", self.topic(live.Heard()), "is not published")
        self.expect("WARN", self.topic(live.Heard(published=True)), "nothing came")
        self.expect("WARN", self.topic(live.Heard(True, 1, 5.0, 5.0)), "a single message")
        without_header = heard(200.0)
        without_header.ages = []
        self.expect("OK", self.topic(without_header), "200.0 Hz")

    def test_stamps(self):
        self.assertAlmostEqual(12.5, live.stamp_of(struct.pack("<III", 7, 12, 500000000) + b"more"))

    def test_tf(self):
        self.expect("OK", live.judge_tf(TREE), "6 frames below map")
        self.expect("WARN", live.judge_tf({"base_link": {"odom"}}), "there is no map, left_optical")
        self.expect("FAIL", live.judge_tf(dict(TREE, base_link={"base_footprint"})), "2 parts: base_footprint, map")
        self.expect("FAIL", live.judge_tf(dict(TREE, base_link={"odom", "map"})), "several parents: map, odom")
        self.expect("OK", live.judge_tf({"a": {"b"}, "b": {"a"}}, ["a"]))  # a ring ends, too

    def test_diagnostics(self):
        self.expect("WARN", live.judge_diagnostics({}), "nobody reports")
        self.expect("OK", live.judge_diagnostics({"vio: odometry": (0, "")}), "1 statuses")
        self.expect("WARN", live.judge_diagnostics({"vio: odometry": (1, "slow"), "a": (0, "")}), "vio: odometry: slow")
        levels = {f"node{i}: part": (2, f"broken {i}") for i in range(5)}
        self.expect("FAIL", live.judge_diagnostics(levels), "5 error(s): node0: part: broken 0", "and 2 more")


if __name__ == "__main__":
    unittest.main()
