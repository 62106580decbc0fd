#!/usr/bin/python3
"""Judge of launcher.test."""

import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
import unittest

import rostest

LAUNCHER = os.path.join(os.path.dirname(os.path.realpath(__file__)), "..", "scripts", "first_drive", "launcher.py")
NODES = 6
START_LIMIT_S = 90.0
END_LIMIT_S = 15.0  # less than the 20 s for which roslaunch waits in its handler
# Interrupts itself where roslaunch holds the lock of the node that it is about to start.
INTERRUPTED = """
import os, runpy, signal, sys
from roslaunch import nodeprocess
configure = nodeprocess.LocalProcess._configure_logging
def interrupt(process):
    if process.name.startswith("node_2-"):
        print("interrupted", flush=True)
        os.kill(os.getpid(), signal.SIGINT)
    return configure(process)
nodeprocess.LocalProcess._configure_logging = interrupt
del sys.argv[0]
runpy.run_path(sys.argv[0], run_name="__main__")
"""


class Launcher(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.launch_file = os.path.join(folder.name, "nodes.launch")
        with open(self.launch_file, "w") as file:
            file.write("<launch>%s</launch>" % "".join(
                '<node pkg="tf2_ros" type="static_transform_publisher" name="node_%d" '
                'args="0 0 0 0 0 0 map frame_%d"/>' % (index, index) for index in range(NODES)))

    def start(self, *words):
        self.process = subprocess.Popen([sys.executable, "-P", *words, self.launch_file],
                                        env=dict(os.environ, PYTHONUNBUFFERED="1"), stdin=subprocess.DEVNULL,
                                        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                                        start_new_session=True)
        self.addCleanup(self.kill)
        watchdog = threading.Timer(START_LIMIT_S + END_LIMIT_S, self.process.kill)
        watchdog.start()
        self.addCleanup(watchdog.cancel)
        self.output = ""

    def kill(self):
        self.process.kill()
        self.process.wait()
        self.process.stdout.close()
        for pid in self.pids():
            try:
                os.kill(pid, signal.SIGKILL)
            except ProcessLookupError:
                pass

    def pids(self):
        return [int(pid) for pid in re.findall(r"started with pid \[(\d+)\]", self.output)]

    def await_output(self, pattern, count=1):
        for line in self.process.stdout:
            self.output += line
            if len(re.findall(pattern, self.output)) >= count:
                return
        self.fail("roslaunch ended without %d x %s:\n%s" % (count, pattern, self.output))

    def assert_ends(self):
        began = time.monotonic()
        self.output += self.process.stdout.read()  # to the end of all who write to it
        self.process.wait()
        self.assertLess(time.monotonic() - began, END_LIMIT_S, self.output)
        for pid in self.pids():
            self.assertFalse(os.path.exists("/proc/%d" % pid), "process %d is left:\n%s" % (pid, self.output))

    def test_is_interrupted_while_it_starts_a_node(self):
        self.start("-c", INTERRUPTED, LAUNCHER)
        self.await_output("interrupted")
        self.assert_ends()
        self.assertGreaterEqual(len(self.pids()), 2, self.output)

    def test_is_interrupted_as_soon_as_all_nodes_have_started(self):
        self.start(LAUNCHER)
        self.await_output("started with pid", NODES)
        self.process.send_signal(signal.SIGINT)
        self.assert_ends()


if __name__ == "__main__":
    rostest.rosrun("pi_bringup", "launcher", Launcher)
