#!/usr/bin/python3 -B
"""Judge of runtime_diagnostics.test."""

import queue
import sys
import unittest

import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

import runtime_harness as harness
from runtime_harness import halve_picture_task, picture

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
UNIT, SCHEDULER, POWER = "runtime: unit cpu0", "runtime: scheduler", "runtime: power"


class RuntimeDiagnostics(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node("runtime_diagnostics")
        cls.runtime = harness.Services("/runtime")
        cls.image = picture(60, 83)
        cls.arrays = queue.Queue()
        cls.subscriber = rospy.Subscriber("/diagnostics", DiagnosticArray, cls.arrays.put)

    def next_array(self):
        """The next complete message. At its start the node sends one for each status."""
        while True:
            array = self.arrays.get(timeout=harness.TIMEOUT_S)
            statuses = {status.name: status for status in array.status}
            if len(statuses) > 1:
                return statuses

    def await_levels(self, **levels):
        """@return the first array in which the statuses have these levels."""
        wanted = {{"unit": UNIT, "scheduler": SCHEDULER}[name]: level for name, level in levels.items()}
        statuses = {}
        for _ in range(100):
            statuses = self.next_array()
            if all(statuses[name].level == level for name, level in wanted.items()):
                return statuses
        self.fail("%s did not come, the last was %s" % (levels, statuses))

    @staticmethod
    def values(status):
        return {pair.key: pair.value for pair in status.values}

    def run_task(self, **fields):
        response = self.runtime.submit_task(task=halve_picture_task(self.image, unit="cpu0", **fields), wait=True)
        self.assertTrue(response.ended, response.message)

    def test_every_part_has_a_status(self):
        statuses = self.next_array()
        self.assertEqual({UNIT, "runtime: unit cpu1", SCHEDULER, POWER}, set(statuses))
        self.assertEqual({OK}, {status.level for status in statuses.values()})
        self.assertTrue(all(status.hardware_id and status.message for status in statuses.values()))
        self.assertIn("search", statuses[SCHEDULER].message)

    def test_tasks_are_counted(self):
        before = self.values(self.next_array()[UNIT])
        self.run_task()
        # Two: the first may have been on its way before the task had ended.
        self.next_array()
        statuses = self.next_array()
        self.assertEqual(int(before["tasks"]) + 1, int(self.values(statuses[UNIT])["tasks"]))
        self.assertTrue(0.0 <= float(self.values(statuses[UNIT])["utilisation"]) <= 1.0)
        self.assertLess(0, int(self.values(statuses[SCHEDULER])["submitted"]))

    def test_a_missed_deadline_is_a_warning_once(self):
        self.await_levels(unit=OK, scheduler=OK)
        self.run_task(deadline=rospy.Duration(0, 1))
        statuses = self.await_levels(unit=WARN, scheduler=WARN)
        self.assertEqual("1 deadline missed", statuses[UNIT].message)
        self.assertEqual("1", self.values(statuses[SCHEDULER])["missed deadlines since last"])
        statuses = self.await_levels(unit=OK, scheduler=OK)
        self.assertLess(0, int(self.values(statuses[UNIT])["missed deadlines"]))

    def test_a_unit_that_is_out_is_an_error_until_it_is_back(self):
        self.assertTrue(self.runtime.set_unit_available(unit="cpu0", available=False).success)
        statuses = self.await_levels(unit=ERROR)
        self.assertIn("taken out", statuses[UNIT].message)
        self.assertEqual(OK, statuses["runtime: unit cpu1"].level)
        self.assertTrue(self.runtime.set_unit_available(unit="cpu0", available=True).success)
        self.await_levels(unit=OK)


if __name__ == "__main__":
    rostest.rosrun("pi_runtime", "runtime_diagnostics", RuntimeDiagnostics, sys.argv)
