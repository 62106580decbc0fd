#!/usr/bin/python3
import contextlib
import io
import json
import sys
import tempfile
import unittest
from pathlib import Path

sys.path[:0] = [str(Path(__file__).resolve().parents[2] / "src"), str(Path(__file__).resolve().parent)]

import numpy as np

from pi_speech.evaluate_commands import main
from pi_speech.evaluation import by_speaker, confusion, load_results, operating_curve
from pi_speech.evaluation_report import decibels
from pi_speech.truth import Labels
from speech_tables import CLIPS, COLUMNS, as_text, clip


class EvaluateCommands(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)
        self.path = self.folder / "out.tsv"
        self.path.write_text(as_text(CLIPS))

    def run_tool(self, *arguments):
        """@return (exit status, output, errors)"""
        output, errors = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(output), contextlib.redirect_stderr(errors):
            try:
                status = main([*map(str, arguments)])
            except SystemExit as left:
                status = left.code
        return status, output.getvalue(), errors.getvalue()

    def figures(self, *arguments):
        status, _, errors = self.run_tool(self.path, "--output", self.folder / "report", *arguments)
        self.assertEqual((status, errors), (0, ""))
        return json.loads((self.folder / "report" / "figures.json").read_text())

    def load(self):
        return load_results(self.path, Labels(), "clips")

    def refused(self, *needles):
        """That the file is refused in one line with these parts."""
        status, output, errors = self.run_tool(self.path)
        self.assertEqual((status, output, errors.count("\n")), (1, "", 1), errors)
        for needle in needles:
            self.assertIn(needle, errors)

    def test_rates_are_those_counted_by_hand(self):
        figures, = self.figures()
        self.assertEqual(figures["clips"], {"commands": 8, "other": 2, "background": 2})
        self.assertEqual(figures["rates"], {"accuracy": 0.5, "wrong": 0.25, "rejected": 0.25, "false_other": 0.5,
                                            "false_background": 0.0, "closed_accuracy": 0.625})
        self.assertEqual(figures["latency"], {"clips": 3, "median_ms": 300.0, "p95_ms": 480.0})

    def test_each_command_has_its_own_rates(self):
        words = self.figures()[0]["words"]
        self.assertEqual(list(words), ["go", "left", "stop"])
        self.assertEqual(words["stop"], {"clips": 4, "recall": 0.5, "wrong": 0.25, "rejected": 0.25,
                                         "precision": round(2 / 3, 6), "taken_for": {"go": 1}})
        self.assertEqual((words["go"]["recall"], words["go"]["precision"]), (0.5, round(1 / 3, 6)))

    def test_the_safety_word_has_its_own_figures(self):
        safety = self.figures()[0]["safety"]
        self.assertEqual(safety, {"word": "stop", "clips": 4, "recall": 0.5, "taken_for_others": 0.25, "rejected": 0.25,
                                  "false_commands": 0.25, "false_other": 0.0, "false_background": 0.0,
                                  "latency_median_ms": 200.0})
        self.assertEqual(self.figures("--safety-word", "left")[0]["safety"]["recall"], 0.5)
        self.assertIsNone(self.figures("--safety-word", "halt")[0]["safety"])

    def test_the_curve_passes_through_the_operating_point_and_ends_with_all(self):
        curve = operating_curve(self.load())
        at = int(np.flatnonzero(curve["threshold"] == 0.6)[0])  # the least that was accepted
        self.assertEqual([curve[name][at] for name in ("accuracy", "wrong", "false_other", "false_background")],
                         [0.5, 0.25, 0.5, 0.0])
        self.assertEqual([curve[name][0] for name in ("accuracy", "wrong", "false_other")], [0.0, 0.0, 0.0])
        # What was too long is accepted at no threshold, however sure.
        self.assertEqual([curve[name][-1] for name in ("accuracy", "wrong", "false_other", "false_background")],
                         [0.625, 0.25, 0.5, 0.5])
        self.assertTrue((np.diff(curve["threshold"]) < 0).all())

    def test_equal_confidences_are_accepted_together(self):
        self.path.write_text(as_text([clip(1, "go", "go", 0.5, True), clip(2, "go", "left", 0.5, True)]))
        curve = operating_curve(self.load())
        self.assertEqual((list(curve["accuracy"]), list(curve["wrong"])), ([0.0, 0.5], [0.0, 0.5]))

    def test_confusions_add_up_to_the_clips(self):
        rows, columns, counts = confusion(self.load())
        self.assertEqual(rows, ["go", "left", "stop", "other speech", "background"])
        self.assertEqual(columns, ["go", "left", "stop", "rejected"])
        self.assertEqual(counts.tolist(), [[1, 0, 1, 0], [0, 1, 0, 1], [1, 0, 2, 1], [1, 0, 0, 1], [0, 0, 0, 2]])

    def test_a_command_that_no_clip_is_of_is_a_wrong_one(self):
        self.path.write_text(as_text([clip(1, "go", "halt", 0.9, True), clip(2, "go", "go", 0.9, True)]))
        _, columns, counts = confusion(self.load())
        self.assertEqual((columns, counts.tolist()), (["go", "another", "rejected"], [[1, 1, 0]]))

    def test_intervals_are_repeatable_and_hold_the_figure(self):
        clips = [clip(i, "go", "go", 0.9, i % 3 != 0, speaker=f"s{i % 20}") for i in range(200)]
        self.path.write_text(as_text(clips))
        results = self.load()
        first, again, other = by_speaker(results, 500, 1), by_speaker(results, 500, 1), by_speaker(results, 500, 2)
        self.assertEqual(first["intervals_95"]["accuracy"], again["intervals_95"]["accuracy"])
        self.assertNotEqual(first["intervals_95"]["accuracy"], other["intervals_95"]["accuracy"])
        low, high = first["intervals_95"]["accuracy"]
        self.assertTrue(low < 133 / 200 < high, (low, high))
        self.assertEqual(first["accuracy_of_speakers"]["speakers"], 20)
        self.assertTrue(np.isnan(first["intervals_95"]["false_other"]).all())

    def test_speakers_who_are_all_alike_leave_no_doubt(self):
        self.path.write_text(as_text([clip(i, "go", "go", 0.9, i % 2 == 0, speaker=f"s{i // 2}") for i in range(40)]))
        self.assertEqual(by_speaker(self.load(), 200, 1)["intervals_95"]["accuracy"], [0.5, 0.5])

    def test_a_file_without_speakers_has_no_intervals(self):
        self.path.write_text(as_text([row[:-1] for row in CLIPS], COLUMNS[:-1]))
        self.assertIsNone(self.figures()[0]["speakers"])

    def test_the_text_shows_rates_words_and_the_safety_word(self):
        status, output, errors = self.run_tool(self.path)
        self.assertEqual((status, errors), (0, ""))
        self.assertRegex(output, r"(?m)^out: 8 commands, 2 of other speech, 2 of background$")
        self.assertRegex(output, r"(?m)^right command +50\.0 %   95 % over speakers: ")
        self.assertRegex(output, r"(?m)^stop +4 +50\.0 +25\.0 +25\.0 +66\.7  go 1$")
        self.assertRegex(output, r'(?m)^"stop": recall 50\.0 %, taken for another command 25\.0 %')

    def test_pictures_are_drawn(self):
        self.figures()
        for name in ("out_roc.png", "out_confusion.png", "out_latency.png"):
            self.assertEqual((self.folder / "report" / name).read_bytes()[:4], b"\x89PNG", name)

    def test_several_files_are_compared(self):
        quiet = self.folder / "loud.tsv"
        quiet.write_text(as_text(CLIPS[:3]))
        status, output, errors = self.run_tool(self.path, quiet, "--label", "20 dB", "--label", "0 dB", "--output",
                                               self.folder / "report")
        self.assertEqual((status, errors), (0, ""))
        self.assertRegex(output, r"(?m)^20 dB +50\.0 +25\.0 +25\.0 +50\.0 +0\.0$")
        self.assertRegex(output, r"(?m)^0 dB +66\.7 +33\.3 +0\.0 +- +-$")
        self.assertEqual((self.folder / "report" / "comparison.png").read_bytes()[:4], b"\x89PNG")
        entries = json.loads((self.folder / "report" / "figures.json").read_text())
        self.assertEqual([entry["label"] for entry in entries], ["20 dB", "0 dB"])

    def test_labels_with_decibels_are_numbers(self):
        self.assertEqual([decibels(text) for text in ("10 dB", "-5dB", "2.5 db", "clean", "10", "10 dB white")],
                         [10.0, -5.0, 2.5, None, None, None])

    def test_what_cannot_be_used_is_named_in_one_line(self):
        self.path.write_text("")
        self.refused("out.tsv is empty")
        self.path.write_text(as_text([]))
        self.refused("out.tsv has no clips")
        self.path.write_text(as_text([row[:-2] for row in CLIPS], COLUMNS[:-2]))
        self.refused("out.tsv has no column word;", "its columns are file, text")
        self.path.write_text(as_text(CLIPS) + "one\ttwo\n")
        self.refused("out.tsv:14: 2 columns, must be 8")
        self.path.write_text(as_text([clip(1, "go", "go", 1.5, True)]))
        self.refused("out.tsv:2: confidence = '1.5', must be a number in [0, 1]")
        self.path.write_text(as_text([clip(1, "go", "go", "nan", True)]))
        self.refused("out.tsv:2: confidence = 'nan'")
        self.path.write_text(as_text([clip(1, "go", "", 0.5, True)]))
        self.refused("out.tsv:2: accepted, but text is empty")
        self.path.write_text(as_text([clip(1, "go", "go", 0.5, True)]).replace("yes", "maybe"))
        self.refused("out.tsv:2: accepted = 'maybe', must be yes or no")
        self.path.write_bytes(b"\xff\xfe\x00")
        self.refused("out.tsv is no text")
        self.path.unlink()
        self.refused("out.tsv: No such file")

    def test_unknown_words_of_truth_are_named(self):
        self.path.write_text(as_text([clip(1, "_noise_", "go", 0.5, True)]))
        self.refused("unknown word '_noise_' in the column of truth; name it by --other or --background")
        self.assertEqual(self.run_tool(self.path, "--background", "_noise_")[0], 0)
        self.path.write_text(as_text(CLIPS))
        status, _, errors = self.run_tool(self.path, "--commands", "go,stop")
        self.assertEqual(status, 1)
        self.assertIn("unknown word 'left' in the column of truth; known commands are go, stop", errors)
        self.assertEqual(self.run_tool(self.path, "--commands", "go,stop,left")[0], 0)

    def test_a_folder_that_cannot_be_made_is_an_error(self):
        status, _, errors = self.run_tool(self.path, "--output", self.path / "below")
        self.assertEqual((status, errors.count("\n")), (1, 1))

    def test_a_wrong_command_line_is_status_2(self):
        for arguments in ((), (self.path, "--draws", "1"), (self.path, "--other", "a,"), (self.path, self.path),
                          (self.path, "--label", "a", "--label", "b"), (self.path, "--what")):
            self.assertEqual(self.run_tool(*arguments)[0], 2, arguments)


if __name__ == "__main__":
    unittest.main()
