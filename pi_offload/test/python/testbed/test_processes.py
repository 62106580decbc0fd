"""The vehicle's nodes and edge servers as processes on devices of their own (network namespaces, needs root): each task
gets exactly one answer while nodes are killed, links break and become slow, and the vehicle drives. A short run of
bench_offload. Times are no part of it: they are those of a machine that does other things as well.
"""

import os
import select
import signal
import socket
import subprocess
import sys
import time
import unittest
from pathlib import Path

from pi_offload import bench_offload, testbed
from pi_offload.testbed_road import load_road

PACKAGE = Path(__file__).resolve().parents[3]
SCENARIO = PACKAGE / "config/scenarios/testbed.yaml"
LIMIT_S = 60.0


def make_bed(sounds):
    """Deadlines are so long that a machine that stalls is no reason to drop a picture, and the networks the smallest:
    three computers share the cores of this one, and pictures that they cannot do in time are dropped on purpose."""
    return testbed.Bed(SCENARIO, load_road(SCENARIO), bench_offload.find_pictures(None), sounds, deadline_s=2.0,
                       model="street", node_model="street")


class Link(unittest.TestCase):
    """The radio link, without anything that uses it."""

    def setUp(self):
        try:
            bed = testbed.devices.Testbed(("vehicle", "edge1"))
            self.addCleanup(bed.close)
            self.vehicle = bed.vehicle
            self.link = testbed.RadioLink(self, 1, bed.edge1)
        except testbed.Unsupported as reason:
            self.skipTest(str(reason))
        with bed.edge1.entered():
            self.there = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self.there.bind((self.link.address, 5000))
        with bed.vehicle.entered():
            self.here = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.addCleanup(self.there.close)
        self.addCleanup(self.here.close)
        self.there.settimeout(LIMIT_S)

    def send(self, text):
        self.here.sendto(text, (self.link.address, 5000))

    def test_packets_take_their_time(self):
        self.link.set(100.0, 0.05, 0.0)
        began = time.monotonic()
        self.send(b"slow")
        self.assertEqual(b"slow", self.there.recv(100))
        self.assertGreaterEqual(time.monotonic() - began, 0.05)

    def test_packets_wait_for_each_other(self):
        self.link.set(1.0, 0.0, 0.0)
        began = time.monotonic()
        for _ in range(5):
            self.send(bytes(1222))  # 1250 bytes, 10 ms each
        for _ in range(5):
            self.there.recv(2000)
        self.assertGreaterEqual(time.monotonic() - began, 0.05)

    def test_nothing_passes_a_broken_link(self):
        self.link.set(0.0, 0.0, 1.0)
        self.send(b"lost")
        self.link.set(0.0, 0.0, 0.0)
        self.send(b"first")
        self.assertEqual(b"first", self.there.recv(100))
        self.link.up(False)
        self.send(b"lost")
        self.link.up(True)
        self.send(b"second")
        self.assertEqual(b"second", self.there.recv(100))

    def test_some_packets_are_lost(self):
        self.link.set(0.0, 0.0, 0.5)
        for _ in range(200):
            self.send(b"perhaps")
        self.link.set(0.0, 0.0, 0.0)
        self.send(b"last")
        came = 0
        while self.there.recv(100) != b"last":
            came += 1
        self.assertTrue(50 <= came <= 150, came)

    def test_a_wrong_command_ends_it_with_a_reason(self):
        with self.assertRaisesRegex(testbed.BenchError, "must be rate 0 to 1e6"):
            self.link.set(-1.0, 0.0, 0.0)


class Drive(unittest.TestCase):
    def test_every_task_gets_one_answer(self):
        plan = bench_offload.Plan(rounds=1, pictures=30, drive_m=45.0, kills=2, cuts=2, spikes=1)
        try:
            sounds = bench_offload.find_sounds(None)
            with make_bed(sounds) as bed:
                bench = bench_offload.Bench(bed, plan, print)
                bench.run()
        except testbed.Unsupported as reason:
            self.skipTest(str(reason))
        print(bench_offload.report(bench.results))
        self.assertEqual([], bench.failures)
        detection = {phase: result["detection"] for phase, result in bench.results.items()}
        self.assertEqual({"local", "offloaded", "drive", "kills", "cuts", "spikes"}, set(detection))
        local = detection["local"]
        self.assertEqual(local["tasks"], local["local"])
        self.assertGreater(detection["offloaded"]["remote"], 0)
        self.assertGreater(detection["drive"]["local"], 0, "it begins out of range")
        self.assertGreater(detection["drive"]["remote"], 0)
        for phase in ("kills", "cuts", "spikes"):
            with self.subTest(phase=phase):
                self.assertGreaterEqual(detection[phase]["remote"], 10, "a node serves before and after")
                self.assertEqual(detection[phase]["tasks"], detection[phase]["once"])

    def test_nothing_stays_of_a_bed_that_was_killed(self):
        for number in (signal.SIGTERM, signal.SIGKILL):
            with self.subTest(signal=number):
                script = ("import sys\nfrom pi_offload import interrupts, testbed\ninterrupts.end_by_signals()\n"
                          "bed = testbed.devices.Testbed(('vehicle', 'edge1'))\n"
                          "sleeper = bed.vehicle.start('sleep', '1000')\n"
                          "print(sleeper.pid, bed.folder, flush=True)\n"
                          "try:\n    sys.stdin.read()\nfinally:\n    bed.close()\n")
                with subprocess.Popen([sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                      stderr=subprocess.PIPE, text=True) as bed:
                    line = bed.stdout.readline()
                    if not line and "needs root" in bed.stderr.read():
                        self.skipTest("no network namespaces here (needs root)")
                    sleeper, folder = line.split()
                    watched = os.pidfd_open(int(sleeper))
                    bed.send_signal(number)
                    bed.wait(LIMIT_S)
                deadline = time.monotonic() + LIMIT_S
                self.assertTrue(select.select([watched], [], [], LIMIT_S)[0], "its process still runs")
                os.close(watched)
                while os.path.exists(folder):
                    self.assertLess(time.monotonic(), deadline, f"{folder} is still there")


if __name__ == "__main__":
    unittest.main()
