"""The list of clips and their samples."""

import shutil
import subprocess
import tempfile
import unittest
from pathlib import Path

import training_path  # noqa: F401: leads to the modules of the training
import numpy as np

import clips
from pi_speech.errors import ToolError


class Clips(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def list(self, rows):
        (self.folder / "commands.tsv").write_text("file\tword\tspeaker\n" + "".join(rows))

    def flac(self, samples, rate=16000):
        """A clip in the folder. Skips the test where flac is not installed."""
        if not shutil.which("flac"):
            self.skipTest("flac is not installed")
        path = self.folder / "clip.flac"
        subprocess.run(["flac", "-s", "-f", "--force-raw-format", "--endian=little", "--sign=signed", "--channels=1",
                        "--bps=16", f"--sample-rate={rate}", "-o", str(path), "-"],
                       input=np.asarray(samples, "<i2").tobytes(), check=True)
        return path

    def test_the_list_is_read_and_written_with_whole_paths(self):
        self.list(["c/on/a_0.flac\ton\ta\n", "c/off/a_0.flac\toff\ta\n"])
        found = clips.read_clips(self.folder)
        self.assertEqual([clip.key for clip in found], ["on__a_0", "off__a_0"])
        clips.write_list(self.folder / "out.tsv", found)
        lines = (self.folder / "out.tsv").read_text().splitlines()
        self.assertEqual(lines[1].split("\t"), [str(self.folder.resolve() / "c/on/a_0.flac"), "on", "a"])

    def test_each_nth_clip_of_a_word_is_kept(self):
        self.list([f"{word}/{i}.flac\t{word}\ts{i}\n" for i in range(5) for word in ("on", "off")])
        self.assertEqual([clip.key for clip in clips.read_clips(self.folder, 2)],
                         ["on__0", "off__0", "on__2", "off__2", "on__4", "off__4"])

    def test_two_files_of_one_name_are_reported(self):
        self.list(["a/on/0.flac\ton\ts\n", "b/on/0.flac\ton\tt\n"])
        with self.assertRaisesRegex(ToolError, "on__0"):
            clips.read_clips(self.folder)

    def test_samples_are_those_that_were_written(self):
        samples = np.array([0, 1, -1, 32767, -32768] * 100, "<i2")
        path = self.flac(samples)
        self.assertEqual(clips.flac_format(path), (16000, 1, 16))
        np.testing.assert_array_equal(clips.read_flac(path), samples)

    def test_other_formats_and_damage_are_reported(self):
        with self.assertRaisesRegex(ToolError, "8000 Hz, 1 channels, 16 bits, must be 16000 Hz"):
            clips.read_flac(self.flac([0] * 5000, 8000))
        path = self.flac(np.random.default_rng(1).integers(-3000, 3000, 9000))
        path.write_bytes(path.read_bytes()[:5000])
        with self.assertRaisesRegex(ToolError, "cannot be decoded"):
            clips.read_flac(path)
        path.write_text("no sound")
        with self.assertRaisesRegex(ToolError, "no FLAC file"):
            clips.read_flac(path)


if __name__ == "__main__":
    unittest.main()
