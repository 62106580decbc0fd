"""What try_command makes of the answers."""

import contextlib
import io
import os
import sys
import unittest
from pathlib import Path
from unittest import mock

sys.path[:0] = [str(Path(__file__).resolve().parents[2] / "src")]

from pi_speech import try_command
from pi_speech.try_command import ACCEPTED, DOUBTFUL, REJECTED, Answer


class OneTime(unittest.TestCase):
    def test_what_was_accepted_counts_before_what_was_rejected(self):
        answers = [Answer("stop", REJECTED, 0.9), Answer("stop", DOUBTFUL, 0.3), Answer("go", ACCEPTED, 0.6)]
        self.assertEqual(try_command.best_of(answers, "stop").text, "go")
        self.assertEqual(try_command.best_of(answers[:2], "stop").verdict, DOUBTFUL)
        self.assertIsNone(try_command.best_of([], "stop"))

    def test_the_command_counts_before_another_one(self):
        answers = [Answer("go", ACCEPTED, 0.9), Answer("stop", ACCEPTED, 0.5)]
        self.assertTrue(try_command.is_right(try_command.best_of(answers, "stop"), "stop"))


class Summary(unittest.TestCase):
    def test_recall_and_the_nearest_confusion_are_told(self):
        answers = [Answer("stop", ACCEPTED, 0.9), Answer("stop", DOUBTFUL, 0.3), Answer("stop", REJECTED, 0.1), None,
                   Answer("go", ACCEPTED, 0.8), Answer("go", REJECTED, 0.4), Answer("", REJECTED, 0.0)]
        self.assertEqual(try_command.summary("stop", answers), [
            "\"stop\" was heard 1 of 7 times", "  perhaps heard: 1 times",
            "  too faint: 1 times, confidence 0.10 to 0.10",
            "  nothing at all: 1 times; is the microphone on, and its level in /diagnostics well?",
            "  nearest confusion: \"go\", 2 times"])

    def test_what_is_always_heard_has_one_line(self):
        self.assertEqual(try_command.summary("go", 2 * [Answer("go", ACCEPTED, 0.9)]),
                         ["\"go\" was heard 2 of 2 times"])


class Graph(unittest.TestCase):
    def test_a_missing_master_is_named(self):
        with mock.patch.dict(os.environ, ROS_MASTER_URI="http://localhost:1"), \
                contextlib.redirect_stderr(io.StringIO()) as said:
            self.assertEqual(1, try_command.main(["stop"]))
        self.assertIn("no ROS master at http://localhost:1", said.getvalue())


class CommandLine(unittest.TestCase):
    def test_the_command_is_written_as_in_the_table(self):
        self.assertEqual(try_command.parse(["Go  Left"]).command, "go left")

    def test_wrong_values_are_refused(self):
        for wrong in ([], ["stop", "--times", "0"], ["stop", "--recognizer", "recognizer"], [" "]):
            with self.subTest(wrong=wrong), contextlib.redirect_stderr(io.StringIO()), \
                    self.assertRaises(SystemExit) as exit_:
                try_command.parse(wrong)
            self.assertEqual(exit_.exception.code, 2)


if __name__ == "__main__":
    unittest.main()
