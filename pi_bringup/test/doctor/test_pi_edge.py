"""The program, as a user starts it."""

import contextlib
import io
import json
import os
import subprocess
import sys
import threading
import unittest

from pi_bringup import pi_edge
from pi_bringup.doctor.result import fail, ok, run_check, warn, worst

RUN = "from pi_bringup.pi_edge import main; main()"


class Program(unittest.TestCase):
    def start(self, *arguments, **environment):
        return subprocess.run([sys.executable, "-c", RUN, "doctor", *arguments], stdin=subprocess.DEVNULL,
                              capture_output=True, text=True, timeout=300, check=False,
                              env=dict(os.environ, **environment))

    def test_status_says_whether_a_check_failed(self):
        good = self.start("--only", "ROS host", ROS_HOSTNAME="localhost", ROS_MASTER_URI="http://localhost:11311")
        self.assertEqual(0, good.returncode, good.stdout + good.stderr)
        self.assertRegex(good.stdout, r"^OK   ROS host name: .*\n1 OK, 0 WARN, 0 FAIL\n$")
        bad = self.start("--only", "ROS host", ROS_HOSTNAME="no-such-host.invalid")
        self.assertEqual(1, bad.returncode, bad.stdout + bad.stderr)
        self.assertRegex(bad.stdout, r"^FAIL ROS host name: ")

    def test_json(self):
        answer = self.start("--json", "--only", "edge node", "--node", "nonsense")
        self.assertEqual(1, answer.returncode, answer.stdout + answer.stderr)
        report = json.loads(answer.stdout)
        self.assertEqual("FAIL", report["level"])
        self.assertEqual({"OK": 0, "WARN": 0, "FAIL": 1}, report["counts"])
        self.assertEqual("edge node nonsense", report["checks"][0]["check"])

    def test_live_without_a_master_fails_at_once(self):
        answer = self.start("--live", "--only", "live", ROS_MASTER_URI="http://127.0.0.1:1")
        self.assertEqual(1, answer.returncode, answer.stdout + answer.stderr)
        self.assertIn("start the vehicle first", answer.stdout)

    def test_wrong_command_lines(self):
        for arguments in (["--only", "nothing at all"], ["--topic", "imu/data"], ["--topic", "imu/data:0"],
                          ["--bridge-port", "70000"], ["--health-port", "x"]):
            with self.subTest(arguments):
                answer = self.start(*arguments)
                self.assertEqual(2, answer.returncode, answer.stdout + answer.stderr)
                self.assertIn(arguments[0], answer.stderr)

    def test_names_are_unique(self):
        options = pi_edge.parse(["doctor", "--live", "--node", "a:1", "--node", "b:2", "__name:=x"])
        names = [name for name, _, _ in pi_edge.checks(options)]
        self.assertEqual(len(names), len(set(names)))
        self.assertIn("edge node b:2", names)
        with contextlib.redirect_stderr(io.StringIO()), self.assertRaises(SystemExit):
            pi_edge.parse([])


class Runs(unittest.TestCase):
    def test_a_check_that_hangs(self):
        end = threading.Event()
        self.addCleanup(end.set)
        results = run_check("slow", lambda: end.wait(600), 0.1)
        self.assertEqual(["FAIL"], [result.level for result in results])
        self.assertIn("not done within", results[0].line())

    def test_a_check_that_breaks(self):
        result = run_check("broken", lambda: {}["key"], 30)[0]
        self.assertEqual("FAIL", result.level)
        self.assertIn("KeyError: 'key' (test_pi_edge.py:", result.text)

    def test_one_result_or_several(self):
        self.assertEqual([ok("a", "b")], run_check("a", lambda: ok("a", "b"), 30))
        self.assertEqual(2, len(run_check("a", lambda: [ok("a", "b"), warn("a", "c", "d")], 30)))

    def test_the_worst_counts(self):
        self.assertEqual("OK", worst([]))
        self.assertEqual("WARN", worst([ok("a", ""), warn("b", "", "c")]))
        self.assertEqual("FAIL", worst([fail("a", "", "c"), ok("b", "")]))


if __name__ == "__main__":
    unittest.main()
