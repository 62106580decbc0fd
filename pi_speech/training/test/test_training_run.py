"""What train_models says about its inputs before it begins."""

import contextlib
import io
import tempfile
import unittest
from pathlib import Path

import training_path  # noqa: F401: leads to the modules of the training

import requirements
import training_run
from pi_speech.errors import ToolError


class Inputs(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def commands(self, text):
        path = self.folder / "commands.yaml"
        path.write_text(text)
        return training_run.read_commands(path)

    def test_the_commands_of_the_package_are_read(self):
        self.assertEqual(sorted(training_run.read_commands(training_run.PACKAGE / "config/commands.yaml")),
                         ["down", "go", "left", "no", "off", "on", "right", "stop", "up", "yes"])

    def test_tables_that_are_none_are_reported(self):
        self.assertEqual(self.commands("commands: [go, {text: stop, fast: true}]"), ["go", "stop"])
        for text in ("commands: [go, on]", "commands: [go left]", "commands: []", "commands: go", "words: [go]",
                     "commands: {", "- go", "commands: [{fast: true}]"):
            with self.subTest(text=text), self.assertRaisesRegex(ToolError, "commands.yaml"):
                self.commands(text)

    def test_packages_that_lack_are_named_together(self):
        missing = requirements.missing_packages({"python3": "python3", "no-such-program-a": "b", "/no/such": "a"},
                                                {self.folder / "model": "c", Path(__file__): "d"})
        self.assertEqual(missing, ["a", "b", "c"])

    def test_tools_are_found_in_a_folder(self):
        for name in requirements.TOOLS:
            (self.folder / name).write_text("#!/bin/sh\n")
            (self.folder / name).chmod(0o755)
        self.assertEqual(requirements.find_tools(self.folder)["recognize_files"],
                         (self.folder / "recognize_files").resolve())
        (self.folder / "recognize_files").unlink()
        with self.assertRaisesRegex(ToolError, "recognize_files is not in"):
            requirements.find_tools(self.folder)

    def test_numbers_out_of_range_are_refused(self):
        line = ["--data", "d", "--work", "w", "--output", "o"]
        self.assertEqual(training_run.parse(line).seed, 1)
        for wrong in (["--every", "0"], ["--seed", "-1"], ["--max-false-other", "1"], ["--max-false-background", "x"]):
            with self.subTest(wrong=wrong), contextlib.redirect_stderr(io.StringIO()), \
                    self.assertRaises(SystemExit) as exit_:
                training_run.parse(line + wrong)
            self.assertEqual(exit_.exception.code, 2)

    def test_tables_are_joined_under_one_head(self):
        for name in ("a", "b"):
            (self.folder / name).write_text(f"file\tword\n{name}\ton\n")
        training_run.join_tables([self.folder / "a", self.folder / "b"], self.folder / "c")
        self.assertEqual((self.folder / "c").read_text(), "file\tword\na\ton\nb\ton\n")


if __name__ == "__main__":
    unittest.main()
