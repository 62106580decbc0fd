"""The list of garbage words."""

import unittest
from pathlib import Path

import training_path  # noqa: F401: leads to the modules of the training

import garbage_words
import requirements
from pi_speech.errors import ToolError


class GarbageWords(unittest.TestCase):
    DICTIONARY = {"no": ["N OW"], "know": ["N OW"], "that": ["DH AE T"], "i": ["AY"], "to": ["T UW"],
                  "it's": ["IH T S"], "and": ["AH N D", "AE N D"], "with": ["W IH DH"]}

    def test_words_keep_their_order_and_pass_the_rule(self):
        frequent = ["that", "i", "to", "no", "know", "it's", "unheard", "with", "and"]
        self.assertEqual(garbage_words.choose(frequent, ["no"], self.DICTIONARY, 2), ["that", "with"])
        self.assertEqual(garbage_words.choose(frequent, ["no", "that"], self.DICTIONARY, 2), ["with", "and"])

    def test_too_few_words_are_reported(self):
        with self.assertRaisesRegex(ToolError, "1 words .* must be 300"):
            garbage_words.choose(["and"], ["no"], self.DICTIONARY)

    def test_another_file_is_reported(self):
        with self.assertRaisesRegex(ToolError, "no binary language model"):
            garbage_words.words_by_frequency(__file__)

    @unittest.skipUnless(requirements.LANGUAGE_MODEL.is_file(), "pocketsphinx-en-us is not installed")
    def test_the_committed_file_is_the_one_that_is_written(self):
        committed = Path(__file__).resolve().parents[2] / "config/garbage_words.txt"
        self.assertEqual(committed.read_text(), garbage_words.text())


if __name__ == "__main__":
    unittest.main()
