"""Steps that are done are not done again; folders of other runs are refused."""

import sys
import tempfile
import unittest
from pathlib import Path

import training_path  # noqa: F401: leads to the modules of the training

from pi_speech.errors import ToolError
from steps import Steps


class StepsOfARun(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.work = Path(folder.name) / "work"
        self.lines, self.calls = [], []

    def steps(self, settings=None):
        steps = Steps(self.work, settings or {"seed": 1, "snr_db": (10, 20)}, 3, self.lines.append)
        self.addCleanup(steps.close)
        return steps

    def work_on(self, value):
        self.calls.append(value)
        return {"value": value}

    def test_a_step_is_done_once(self):
        first = self.steps()
        self.assertEqual(first.run("one", self.work_on, 7), {"value": 7})
        first.close()
        second = self.steps()
        self.assertEqual(second.run("one", self.work_on, 7), {"value": 7})
        self.assertEqual(second.run("one", self.work_on, 8, again=True), {"value": 8})
        self.assertEqual(self.calls, [7, 8])
        self.assertIn("  1/3 one: done before", self.lines)

    def test_a_step_that_failed_is_done_again(self):
        def fail():
            raise ToolError("no")
        steps = self.steps()
        with self.assertRaises(ToolError):
            steps.run("one", fail)
        self.assertEqual(steps.run("one", self.work_on, 1), {"value": 1})

    def test_other_settings_and_a_second_run_are_refused(self):
        first = self.steps()
        with self.assertRaisesRegex(ToolError, "another run is at work"):
            self.steps()
        first.close()
        with self.assertRaisesRegex(ToolError, "other every, seed"):
            self.steps({"seed": 2, "snr_db": (10, 20), "every": 3})
        self.steps().close()

    def test_a_folder_that_cannot_be_made_is_reported(self):
        self.work.write_text("a file")
        with self.assertRaisesRegex(ToolError, "cannot be written"):
            self.steps()

    def test_a_program_that_fails_is_reported_with_its_last_line_and_its_log(self):
        steps = self.steps()
        self.assertEqual(steps.call("good", [sys.executable, "-c", "print('out')"]), "out\n")
        script = "import sys; print('first\\nlast', file=sys.stderr); sys.exit(3)"
        with self.assertRaisesRegex(ToolError, r"status 3: last; see .*logs/bad\.log"):
            steps.call("bad", [sys.executable, "-c", script])


if __name__ == "__main__":
    unittest.main()
