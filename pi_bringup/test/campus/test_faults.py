"""Faults that the runner of a drive executes, without a graph."""

import contextlib
import io
import signal
import subprocess
import tempfile
import unittest
import sys
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(PACKAGE / "scripts"))
from campus_drive.faults import RunnerFaults  # noqa: E402

KILL = '{"stamp":3.0,"t":1.0,"type":"command","line":"kill %s","restores":false}\n'


class Faults(unittest.TestCase):
    def setUp(self):
        self.log = tempfile.NamedTemporaryFile("w", suffix=".jsonl")
        self.child = subprocess.Popen(["sleep", "60"])
        self.faults = RunnerFaults(self.log.name, lambda: {"vio": self.child.pid}, [])

    def tearDown(self):
        self.child.kill()
        self.child.wait()
        self.log.close()

    def tick(self, text):
        self.log.write(text)
        self.log.flush()
        with contextlib.redirect_stdout(io.StringIO()):
            self.faults.tick()

    def test_a_node_is_killed_once_its_line_is_whole(self):
        line = KILL % "/vio"
        self.tick('{"type":"state"}\n' + line[:20])
        self.assertIsNone(self.child.poll())
        self.tick(line[20:])
        self.assertEqual(-signal.SIGKILL, self.child.wait(10))
        self.assertEqual([{"stamp": 3.0, "line": "kill /vio", "problem": ""}], self.faults.done)

    def test_what_cannot_be_done_is_kept_with_its_reason(self):
        self.tick(KILL % "radar" + '{"stamp":4.0,"type":"command","line":"radio off","restores":false}\n')
        self.assertIn("no node radar runs, but vio", self.faults.done[0]["problem"])
        self.assertIn("no edge_nodes", self.faults.done[1]["problem"])

    def test_commands_of_the_simulator_are_left_to_it(self):
        self.tick('{"stamp":4.0,"type":"command","line":"imu off","restores":false}\n')
        self.assertEqual([], self.faults.done)


if __name__ == "__main__":
    unittest.main()
