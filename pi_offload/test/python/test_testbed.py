"""What the test bed counts, and the road that it drives."""

import math
import os
import tempfile
import unittest
from pathlib import Path

from pi_offload import testbed_account as accounts
from pi_offload.errors import ToolError
from pi_offload.testbed_road import load_road

SCENARIO = Path(__file__).resolve().parents[2] / "config/scenarios/testbed.yaml"


def decision(stamp, how="remote", response_s=0.05, node="edge1", kind="detection", deadline_s=0.2):
    return {"kind": kind, "stamp": stamp, "node": node if how != "local" else "", "how": how, "reason": "",
            "deadline_s": deadline_s, "response_s": response_s}


class Detections(unittest.TestCase):
    def account(self, pictures, results, decisions):
        return accounts.detection_account(pictures, results, decisions)

    def test_one_answer_each_is_right(self):
        account = self.account([1, 2], [(1, 0.05), (2, 0.06)], [decision(1), decision(2, "local", 0.1)])
        self.assertEqual((2, 2, 0, 0), tuple(account[name] for name in ("tasks", "once", "twice", "never")))
        self.assertEqual((1, 1, 0), tuple(account[name] for name in ("remote", "local", "late")))
        self.assertEqual(0.06, account["seen_p95_s"])
        self.assertEqual([], accounts.violations(account, "x"))

    def test_two_answers_are_seen(self):
        account = self.account([1, 2], [(1, 0.05), (1, 0.07), (2, 0.05)], [decision(1), decision(2)])
        self.assertEqual((1, 1), (account["once"], account["twice"]))
        self.assertEqual(["x: 1 of 2 answered twice"], accounts.violations(account, "x"))

    def test_a_missing_answer_is_seen(self):
        account = self.account([1, 2], [(1, 0.05)], [decision(1), decision(2, "abandoned")])
        self.assertEqual(["x: 1 of 2 never answered", "x: 1 of 2 given up"], accounts.violations(account, "x"))

    def test_a_task_without_end_is_seen(self):
        account = self.account([1], [(1, 0.05)], [])
        self.assertEqual(["x: 1 of 1 never ended"], accounts.violations(account, "x"))

    def test_a_task_that_ends_twice_is_seen(self):
        account = self.account([1], [(1, 0.05)], [decision(1), decision(1, "fallback")])
        self.assertEqual(["x: 1 of 1 ended twice"], accounts.violations(account, "x"))

    def test_a_result_of_no_picture_is_seen(self):
        account = self.account([1], [(1, 0.05), (7, 0.1)], [decision(1)])
        self.assertEqual(["x: 1 of 1 results of no picture"], accounts.violations(account, "x"))

    def test_late_is_after_the_deadline(self):
        account = self.account([1, 2], [(1, 0.2), (2, 0.26)], [decision(1, response_s=0.2),
                                                              decision(2, "fallback", 0.25)])
        self.assertEqual(1, account["late"])
        self.assertAlmostEqual(0.05, account["latest_s"])

    def test_a_late_result_that_was_not_published_is_missed_not_lost(self):
        account = self.account([1, 2], [(2, 0.1)], [decision(1, "fallback", 0.25), decision(2)])
        self.assertEqual((1, 0, 1), tuple(account[name] for name in ("dropped", "never", "late")))
        self.assertEqual([], accounts.violations(account, "x"))

    def test_results_that_were_overtaken_are_counted(self):
        account = self.account([1, 2, 3], [(2, 0.1), (1, 0.2), (3, 0.1)], [decision(1), decision(2), decision(3)])
        self.assertEqual((1, 3), (account["overtaken"], account["once"]))

    def test_a_handover_is_a_change_of_the_node(self):
        account = self.account([1, 2, 3, 4], [], [decision(1), decision(2, "local"), decision(3, node="edge2"),
                                                  decision(4, node="edge2")])
        self.assertEqual(1, account["handovers"])

    def test_nothing_is_nothing(self):
        account = self.account([], [], [])
        self.assertEqual(0, account["tasks"])
        self.assertTrue(math.isnan(account["p50_s"]))
        self.assertEqual([], accounts.violations(account, "x"))


class Sums(unittest.TestCase):
    def test_speech_answered_twice_is_seen(self):
        account = accounts.speech_account([decision(1, kind="speech")], [(5, "go", True, 0.2), (5, "go", True, 0.3)])
        self.assertEqual((1, 1, 1), (account["tasks"], account["answered"], account["twice"]))
        self.assertEqual(["x: 1 of 1 answered twice"], accounts.violations(account, "x"))

    def test_counts_add_up_and_the_latest_stays(self):
        first = accounts.detection_account([1], [(1, 0.3)], [decision(1, response_s=0.3)])
        second = accounts.detection_account([2], [(2, 0.1)], [decision(2, response_s=0.1)])
        total = accounts.add(accounts.add({}, first), second)
        self.assertEqual((2, 1), (total["tasks"], total["late"]))
        self.assertAlmostEqual(0.1, total["latest_s"])

    def test_quantiles_are_values(self):
        self.assertEqual(2, accounts.quantile([3, 1, 2], 0.5))
        self.assertEqual(3, accounts.quantile([3, 1, 2], 0.99))
        self.assertEqual(1, accounts.quantile([1], 0.01))


class Road(unittest.TestCase):
    def load(self, text):
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "road.yaml")
            with open(path, "w", encoding="utf-8") as file:
                file.write(text)
            return load_road(path)

    def test_the_package_has_one(self):
        road = load_road(SCENARIO)
        self.assertAlmostEqual(280.0 / 3.0, road.duration_s)
        self.assertEqual((-30.0, 0.0, 0.0), road.at(-5.0))
        self.assertEqual((0.0, 0.0, 0.0), road.at(30.0))
        self.assertEqual((250.0, 0.0, 0.0), road.at(1e6))

    def test_the_rate_falls_with_the_distance(self):
        road = load_road(SCENARIO)
        node = road.nodes[0]
        self.assertAlmostEqual(36.0, road.rate_mbps(node, node.x, node.y))
        self.assertAlmostEqual(12.0, road.rate_mbps(node, node.x + node.range_m, node.y))
        self.assertAlmostEqual(math.sqrt(36.0 * 12.0), road.rate_mbps(node, node.x, node.y - node.range_m / 2))
        self.assertEqual(0.0, road.rate_mbps(node, node.x + node.range_m + 0.1, node.y))

    def test_a_corner_is_turned(self):
        text = SCENARIO.read_text(encoding="utf-8")
        road = self.load(text.replace("[[-30, 0], [250, 0]]", "[[0, 0], [3, 0], [3, 4]]"))
        self.assertEqual(7.0, road.length_m)
        x, y, yaw = road.at(5.0)
        self.assertEqual((3.0, 2.0), (x, y))
        self.assertAlmostEqual(math.pi / 2, yaw)

    def test_what_is_wrong_is_said(self):
        good = SCENARIO.read_text(encoding="utf-8")
        for before, after, message in (
                ("[[-30, 0], [250, 0]]", "[[0, 0]]", "route must be a list of at least two points"),
                ("[[-30, 0], [250, 0]]", "[[0, 0], [0, 0]]", "same point twice"),
                ("[[-30, 0], [250, 0]]", "[[0, 0], [x, 0]]", r"route\[1\] = .*must be a point"),
                ("speed: 3.0", "speed: fast", r"speed = 'fast', must be a number in \[0.1, 100\]"),
                ("rate_edge_mbps: 12", "rate_edge_mbps: 0", "network/rate_edge_mbps = 0, must be"),
                ("id: edge2", "id: edge1", r"nodes\[1\]/id = 'edge1', must be a name of its own"),
                ("range_m: 72", "range_m: -1", "range_m = -1, must be"),
                (good, "- 1", "must be a map of keys"), (good, "a: [", "while parsing")):
            with self.subTest(after=after), self.assertRaisesRegex(ToolError, message):
                self.load(good.replace(before, after))
        with self.assertRaisesRegex(ToolError, "No such file"):
            load_road("/nowhere.yaml")


if __name__ == "__main__":
    unittest.main()
