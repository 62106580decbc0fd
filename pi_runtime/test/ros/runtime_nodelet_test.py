#!/usr/bin/python3 -B
"""Judge of runtime_nodelet.test."""

import queue
import signal
import sys
import unittest

import numpy
import rosgraph
import rospy
import rostest
from rosgraph_msgs.msg import Log

import runtime_harness as harness
from runtime_harness import halve_picture_task, picture, until


class RuntimeNodelet(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node("runtime_nodelet")
        cls.image = picture(60, 83)

    def assert_runs_tasks(self, node):
        response = harness.Services(node).submit_task(task=halve_picture_task(self.image), wait=True)
        self.assertTrue(response.ended, response.message)
        self.assertEqual("", response.report.message)
        expected = harness.halved(self.image)
        actual = numpy.frombuffer(response.report.outputs[0].data, numpy.uint8).reshape(expected.shape)
        self.assertTrue(numpy.array_equal(expected, actual))

    @staticmethod
    def provider(service):
        """@return the node that offers a service, None if there is none."""
        _, _, services = rosgraph.Master("/runtime_nodelet").getSystemState()
        return dict(services).get(service, [None])[0]

    @staticmethod
    def load(name, *arguments):
        return harness.start("nodelet", "nodelet", "load", "pi_runtime/runtime", "/manager", "__name:=" + name,
                             *arguments)

    def test_the_launch_file_loads_it_into_the_manager(self):
        self.assert_runs_tasks("/runtime")
        self.assertEqual("/manager", self.provider("/runtime/submit_task"))

    def test_it_can_be_unloaded_and_loaded_again(self):
        for _ in range(2):
            loader = self.load("guest")
            self.assert_runs_tasks("/guest")
            loader.send_signal(signal.SIGINT)
            loader.communicate(timeout=harness.TIMEOUT_S)
            until(lambda: self.provider("/guest/submit_task") is None, "the services go")
        self.assert_runs_tasks("/runtime")

    def test_nodelets_of_a_manager_share_one_runtime(self):
        loader = self.load("guest")
        guest, runtime = harness.Services("/guest"), harness.Services("/runtime")
        before = runtime.get_statistics().statistics.submitted
        self.assertTrue(guest.submit_task(task=halve_picture_task(self.image), wait=True).ended)
        self.assertEqual(before + 1, runtime.get_statistics().statistics.submitted)
        loader.send_signal(signal.SIGINT)
        loader.communicate(timeout=harness.TIMEOUT_S)

    def test_a_wrong_parameter_is_refused_by_name(self):
        messages = queue.Queue()
        subscriber = rospy.Subscriber("/rosout", Log, messages.put)
        until(subscriber.get_num_connections, "/rosout is there")
        loader = self.load("wrong", "_slice:=-1")
        loader.communicate(timeout=harness.TIMEOUT_S)
        self.assertNotEqual(0, loader.returncode)
        text = ""
        while "/wrong/slice = -1 us" not in text:
            text = messages.get(timeout=harness.TIMEOUT_S).msg
        self.assertEqual("parameter /wrong/slice = -1 us, must be above 0", text)
        self.assert_runs_tasks("/runtime")


if __name__ == "__main__":
    rostest.rosrun("pi_runtime", "runtime_nodelet", RuntimeNodelet, sys.argv)
