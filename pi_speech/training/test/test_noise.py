"""Noisy copies: strength of the noise, seeds, short noises."""

import tempfile
import unittest
import wave
from pathlib import Path

import training_path  # noqa: F401: leads to the modules of the training
import numpy as np

import noise
from pi_speech.errors import ToolError


def write_wav(path, samples, rate=16000, channels=1):
    with wave.open(str(path), "wb") as file:
        file.setnchannels(channels)
        file.setsampwidth(2)
        file.setframerate(rate)
        file.writeframes(np.asarray(samples, "<i2").tobytes())


class NoisyCopies(unittest.TestCase):
    def setUp(self):
        random = np.random.default_rng(2)
        self.clip = np.zeros(16000, "<i2")  # speech in the middle half
        self.clip[4000:12000] = (3000 * np.sin(np.arange(8000) * 0.3)).astype("<i2")
        self.noises = {"hum": 500 * random.standard_normal(40000)}

    def copy(self, key, seed=1):
        return noise.noisy_copy(self.clip, key, self.noises, seed)

    def test_the_speech_is_louder_than_the_noise_by_the_named_ratio(self):
        for key in ("a", "b", "c", "d", "e", "f"):
            mixed, kind, snr_db = self.copy(key)
            rest = mixed.astype(float) - self.clip
            measured = 10 * np.log10(noise.speech_power(self.clip.astype(float)) / np.mean(rest ** 2))
            with self.subTest(key=key, kind=kind):
                self.assertAlmostEqual(measured, snr_db, delta=0.1)
                self.assertTrue(10.0 <= snr_db <= 20.0)

    def test_key_and_seed_fix_the_copy(self):
        np.testing.assert_array_equal(self.copy("a")[0], self.copy("a")[0])
        self.assertFalse(np.array_equal(self.copy("a")[0], self.copy("b")[0]))
        self.assertFalse(np.array_equal(self.copy("a", 1)[0], self.copy("a", 2)[0]))

    def test_all_kinds_are_drawn(self):
        kinds = {self.copy(str(number))[1] for number in range(60)}
        self.assertEqual(kinds, {"hum", "white", "pink"})

    def test_loud_clips_do_not_overflow(self):
        self.clip[:] = 32767
        self.clip[::2] = -32768
        for number in range(6):
            self.assertLessEqual(np.abs(self.copy(str(number))[0].astype(int)).max(), noise.LARGEST_SAMPLE)

    def test_silence_stays_silent(self):
        self.clip[:] = 0
        self.assertEqual(np.abs(self.copy("a")[0]).max(), 0)

    def test_short_noise_and_short_clips_are_reported(self):
        self.noises = {name: np.ones(100) for name in "abcdefgh"}
        with self.assertRaisesRegex(ToolError, "give longer noise"):
            for number in range(60):
                self.copy(str(number))
        self.clip = self.clip[:399]
        with self.assertRaisesRegex(ToolError, "a: 399 samples"):
            self.copy("a")


class NoiseFiles(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.path = Path(folder.name) / "noise.wav"

    def test_samples_are_read(self):
        write_wav(self.path, [1, -2, 32767])
        np.testing.assert_array_equal(noise.read_noise(self.path), [1.0, -2.0, 32767.0])

    def test_other_formats_are_reported(self):
        write_wav(self.path, [0] * 10, rate=8000, channels=2)
        with self.assertRaisesRegex(ToolError, "8000 Hz, 2 channels, 16 bits, must be 16000 Hz"):
            noise.read_noise(self.path)
        self.path.write_text("no sound")
        with self.assertRaisesRegex(ToolError, "no WAV file"):
            noise.read_noise(self.path)
        with self.assertRaisesRegex(ToolError, "missing.wav"):
            noise.read_noise(self.path.with_name("missing.wav"))


if __name__ == "__main__":
    unittest.main()
