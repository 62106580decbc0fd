"""Dictionaries and which pronunciation a clip has."""

import tempfile
import unittest
from pathlib import Path

import training_path  # noqa: F401: leads to the modules of the training

import features
import pronunciations
from pi_speech.errors import ToolError


class Pronunciations(unittest.TestCase):
    def test_variants_are_gathered_under_their_word(self):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "words.dict"
            path.write_text("on AA N\non(2) AO N\nup AH P\n")
            self.assertEqual(pronunciations.read_dictionary(path), {"on": ["AA N", "AO N"], "up": ["AH P"]})
            with self.assertRaisesRegex(ToolError, "No such file"):
                pronunciations.read_dictionary(path.with_name("missing"))

    def test_extra_ones_come_last_and_none_twice(self):
        found = pronunciations.of_words(["off", "up"], {"off": ["AO F"], "up": ["AH P"]}, {"off": ["AO F", "AA F"]})
        self.assertEqual(pronunciations.dictionary_text(found), "off AO F\noff(2) AA F\nup AH P\n")

    def test_a_word_that_nobody_knows_is_reported(self):
        with self.assertRaisesRegex(ToolError, "xyzzy: not in the dictionary"):
            pronunciations.of_words(["xyzzy"], {}, {})

    def test_the_committed_file_is_the_one_that_is_written(self):
        path = Path(__file__).resolve().parents[2] / "config/adaptation/pronunciations.dict"
        self.assertEqual(path.read_text(), pronunciations.extra_text(pronunciations.EXTRA))

    def test_variants_of_clips_are_read_from_segments(self):
        segments = ("a S 0 T -2132 A -1795 L -337 0 -214 -337 <sil> 40 -1581 0 on(2) 98\n"
                    "b S 0 T -2489 A -1815 L -674 0 -190 -337 <sil> 19 -1434 0 on 74 -191 -337 <sil> 98\n"
                    "c S 0 T 0 A 0 L 0 0\n")
        self.assertEqual(features.variants_of(segments, ["on"]), {"a": "on(2)", "b": "on"})


if __name__ == "__main__":
    unittest.main()
