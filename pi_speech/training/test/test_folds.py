"""Parts of the speakers."""

import unittest
import zlib
from pathlib import Path

import training_path  # noqa: F401: leads to the modules of the training

import folds
from clips import Clip
from pi_speech.errors import ToolError


def speakers_of(part, count):
    """The first names s0, s1, ... whose CRC-32 falls into the part."""
    names, number = [], 0
    while len(names) < count:
        if zlib.crc32(f"s{number}".encode()) % 5 == part:
            names.append(f"s{number}")
        number += 1
    return names


def clip(word, speaker):
    return Clip(Path(f"{word}/{speaker}.flac"), f"{word}__{speaker}", word, speaker)


class Folds(unittest.TestCase):
    def setUp(self):
        self.clips = [clip(word, speakers_of(part, 1)[0]) for part in range(5) for word in ("go", "stop")]

    def test_the_parts_come_from_the_check_sum_of_the_speaker(self):
        # CRC-32 of "123456789" is 0xCBF43926
        self.assertEqual(folds.fold_of("123456789"), 0xCBF43926 % 5)

    def test_clips_of_a_speaker_stay_together(self):
        parts = folds.split(self.clips)
        self.assertEqual([len(part) for part in parts], [2] * 5)
        for number, part in enumerate(parts):
            self.assertEqual({folds.fold_of(one.speaker) for one in part}, {number})

    def test_a_fold_learns_from_the_other_parts(self):
        self.assertEqual(folds.training_parts(2), [0, 1, 3, 4])
        self.assertEqual(folds.training_parts(folds.ALL), [0, 1, 2, 3, 4])

    def test_clips_of_all_words_and_parts_are_enough(self):
        folds.check(self.clips, ("go", "stop"))

    def test_a_part_without_a_command_is_reported(self):
        clips = [one for one in self.clips if folds.fold_of(one.speaker) != 3]
        clips.append(clip("_unknown_", speakers_of(3, 1)[0]))
        with self.assertRaisesRegex(ToolError, "part 3 of 5"):
            folds.check(clips, ("go", "stop"))

    def test_a_word_of_one_part_only_is_reported(self):
        clips = [*self.clips, clip("left", speakers_of(1, 1)[0])]
        with self.assertRaisesRegex(ToolError, "without part 1 of 5 .* left"):
            folds.check(clips, ("go", "stop", "left"))


if __name__ == "__main__":
    unittest.main()
