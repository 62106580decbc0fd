"""The table of decisions and nodes, of the messages that the coordinator sends."""

import unittest

from pi_offload import offload_top
from pi_offload.msg import EdgeNodeStatus, OffloadDecision


def decision(**fields):
    return OffloadDecision(**{"kind": "detection", "how": "remote", "node": "lamp", "reason": "cheapest", "deadline": 0.2,
                              "expected_time": 0.06, "expected_energy": 0.06, "response_time": 0.0555, "energy": 0.04,
                              "by_deadline": True, **fields})


class OffloadTop(unittest.TestCase):
    def test_a_task_has_where_why_expected_and_real(self):
        self.assertEqual(["detection", "lamp", "remote", "60", "56", "200", "0.060", "0.040", "cheapest"],
                         offload_top.task_row(decision()).split())

    def test_a_dropped_hedged_late_task_says_so(self):
        row = offload_top.task_row(decision(node="", how="abandoned", by_deadline=False, dropped=True, hedged=True))
        self.assertIn("vehicle", row)
        self.assertTrue(row.endswith("LATE, DROPPED, hedged, cheapest"), row)

    def test_the_summary_counts_and_gives_watts(self):
        tasks = [decision(), decision(how="local", node="", energy=0.36), decision(by_deadline=False, dropped=True)]
        self.assertEqual("0.3 tasks/s, 67 % done by nodes, 1 late, 1 dropped, 0 hedged; 0.04 W by the model (0.02 W "
                         "expected)", offload_top.summary(tasks, 10.0))
        self.assertEqual("no tasks in 10 s", offload_top.summary([], 10.0))

    def test_nodes_with_their_checks(self):
        good, bad, far = EdgeNodeStatus(connected=True, in_range=True, sent=5, checked=3), EdgeNodeStatus(), EdgeNodeStatus()
        good.node.id, bad.node.id, far.node.id = "lamp", "liar", "far"
        bad.distrusted, bad.in_range, bad.disagreed, bad.unasked = "its answers do not fit", True, 7, 2
        rows = offload_top.node_rows([good, bad, far])
        self.assertEqual(["lamp", "connected", "0.0", "0.0", "5", "0", "0", "0", "0", "3", "0"], rows[1].split())
        self.assertEqual(["liar", "distrusted"], rows[2].split()[:2])
        self.assertEqual(["2", "0", "7"], rows[2].split()[-3:])
        self.assertEqual("  its answers do not fit", rows[3])
        self.assertIn("out of range", rows[4])

    def test_the_newest_come_first_and_old_ones_go(self):
        now = [0.0]
        recent = offload_top.Recent(lambda: now[0])
        for second in range(20):
            now[0] = float(second)
            recent.add(decision(reason="task%d" % second))
        lines = recent.lines(3, [])
        self.assertEqual(["task19", "task18", "task17"], [line.split()[-1] for line in lines[3:6]])
        self.assertTrue(lines[0].startswith("1.1 tasks/s"), lines[0])


if __name__ == "__main__":
    unittest.main()
