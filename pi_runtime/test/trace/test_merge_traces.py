"""merge_traces: traces of several processes in one file."""

import json
import pathlib
import subprocess
import sys
import tempfile
import unittest

SCRIPT = pathlib.Path(__file__).resolve().parents[2] / "scripts/merge_traces"


class MergeTraces(unittest.TestCase):

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        self.output = self.folder / "merged" / "all.json"
        self.output.parent.mkdir()

    def write(self, name, pid):
        events = [{"ph": "M", "name": "process_name", "pid": pid, "args": {"name": name}},
                  {"ph": "X", "name": "work", "pid": pid, "tid": 1, "ts": 10.0 * pid, "dur": 2.0, "cat": "run"}]
        (self.folder / (name + ".json")).write_text(json.dumps({"traceEvents": events}))
        return events

    def merge(self, *sources):
        return subprocess.run([sys.executable, SCRIPT, *sources, self.output], capture_output=True, text=True, check=False)

    def test_all_processes_are_in_one_file(self):
        expected = self.write("a_node", 7) + self.write("b_node", 8)
        done = self.merge(self.folder)
        self.assertEqual((0, "", "4 events of 2 processes in %s\n" % self.output),
                         (done.returncode, done.stderr, done.stdout))
        self.assertEqual(expected, json.loads(self.output.read_text())["traceEvents"])

    def test_a_file_that_was_cut_off_is_named_and_the_others_are_there(self):
        expected = self.write("a_node", 7)
        (self.folder / "b_node.json").write_text('{"traceEvents": [')
        done = self.merge(self.folder)
        self.assertEqual(1, done.returncode)
        self.assertIn("b_node.json: not a trace of pi_runtime, or cut off", done.stderr)
        self.assertEqual(expected, json.loads(self.output.read_text())["traceEvents"])

    def test_nothing_to_merge_says_what_to_do(self):
        done = self.merge(self.folder)
        self.assertEqual(1, done.returncode)
        self.assertIn("no traces in %s; start the nodes with PI_RUNTIME_TRACE" % self.folder, done.stderr)
        self.assertFalse(self.output.exists())

    def test_an_output_that_cannot_be_written_is_named(self):
        self.write("a_node", 7)
        self.output.parent.rmdir()
        self.assertIn("all.json cannot be written: No such file or directory", self.merge(self.folder).stderr)


if __name__ == "__main__":
    unittest.main()
