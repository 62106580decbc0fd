"""Sphinx-III files and sendumps: written and read back, checked byte by byte, damaged ones reported."""

import struct
import tempfile
import unittest
from pathlib import Path

import training_path  # noqa: F401: leads to the modules of the training
import numpy as np

import sphinx_files
from pi_speech.errors import ToolError
from requirements import ACOUSTIC_MODEL


class Files(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.path = Path(folder.name) / "file"
        self.random = np.random.default_rng(1)


class SphinxThree(Files):
    def test_gaussians_are_read_as_written(self):
        values = self.random.standard_normal((2, 3, 4, 5)).astype("f4")
        sphinx_files.write_gaussians(self.path, values)
        np.testing.assert_array_equal(sphinx_files.read_gaussians(self.path), values)

    def test_mixture_weights_are_read_as_written(self):
        values = self.random.random((4, 3, 2)).astype("f4")
        sphinx_files.write_mixture_weights(self.path, values)
        np.testing.assert_array_equal(sphinx_files.read_mixture_weights(self.path), values)

    def test_the_layout_is_that_of_sphinx(self):
        sphinx_files.write_gaussians(self.path, np.array([[[[1.0, 2.0]], [[3.0, 4.0]]]]))
        self.assertEqual(self.path.read_bytes(), b"s3\nversion 1.0\nendhdr\n"
                         + struct.pack("<I6i4f", 0x11223344, 1, 2, 1, 2, 2, 4, 1.0, 2.0, 3.0, 4.0))

    def test_counts_of_bw_are_read(self):
        head = b"s3\nversion 1.0\nchksum0 no\nendhdr\n"
        # One codebook of two densities, one stream of two values: sums, squares, occupation.
        body = struct.pack("<I3i3ii", 0x11223344, 1, 1, 0, 1, 2, 1, 2)
        body += struct.pack("<i4f", 4, 1, 2, 3, 4) + struct.pack("<i4f", 4, 5, 6, 7, 8)
        body += struct.pack("<3ii2f", 1, 1, 2, 2, 9, 10)
        self.path.write_bytes(head + body)
        sums, squares, occupation = sphinx_files.read_gaussian_counts(self.path)
        np.testing.assert_array_equal(sums, [[[[1, 2], [3, 4]]]])
        np.testing.assert_array_equal(squares, [[[[5, 6], [7, 8]]]])
        np.testing.assert_array_equal(occupation, [[[9, 10]]])

    def test_counts_without_sums_for_variances_are_reported(self):
        self.path.write_bytes(b"s3\nendhdr\n" + struct.pack("<I3i", 0x11223344, 1, 0, 0))
        with self.assertRaisesRegex(ToolError, "lacks sums"):
            sphinx_files.read_gaussian_counts(self.path)

    def test_every_cut_of_a_file_is_reported(self):
        sphinx_files.write_gaussians(self.path, np.ones((1, 1, 2, 2)))
        whole = self.path.read_bytes()
        for size in range(len(whole)):
            self.path.write_bytes(whole[:size])
            with self.subTest(size=size), self.assertRaisesRegex(ToolError, str(self.path)):
                sphinx_files.read_gaussians(self.path)

    def test_another_kind_and_a_missing_file_are_reported(self):
        with self.assertRaisesRegex(ToolError, "No such file"):
            sphinx_files.read_gaussians(self.path)
        self.path.write_bytes(b"RIFF" + bytes(100))
        with self.assertRaisesRegex(ToolError, "of another kind"):
            sphinx_files.read_mixture_weights(self.path)
        self.path.write_bytes(b"s3\nendhdr\n" + struct.pack(">I", 0x11223344) + bytes(40))
        with self.assertRaisesRegex(ToolError, "little endian"):
            sphinx_files.read_mixture_weights(self.path)


class Sendump(Files):
    def test_weights_are_read_back_within_a_step(self):
        weights = self.random.dirichlet(np.ones(8), (5, 3))
        sphinx_files.write_sendump(self.path, weights)
        read = sphinx_files.read_sendump(self.path)
        self.assertEqual(read.shape, weights.shape)
        step = np.log(sphinx_files.LOG_BASE) * 2 ** sphinx_files.SENDUMP_SHIFT
        error = np.log(weights) - np.log(read)  # steps are rounded up, so what is read is smaller
        self.assertGreaterEqual(error.min(), -1e-3)
        self.assertLess(error.max(), step + 1e-3)

    def test_steps_are_those_of_hand(self):
        # -ln(0.5) / ln(1.0001) / 1024 = 6.77 and -ln(0.25) / ln(1.0001) / 1024 = 13.54, rounded up
        np.testing.assert_array_equal(sphinx_files.sendump_steps(np.array([[[2.0, 1.0, 1.0]]])), [[[7, 14, 14]]])

    def test_no_weight_is_below_the_least(self):
        # -ln(1e-5) / ln(1.0001) / 1024 = 112.4, and -ln(1 - 1e-5) / ln(1.0001) = 0.1, cut to 0
        np.testing.assert_array_equal(sphinx_files.sendump_steps(np.array([[[1.0, 0.0]]])), [[[0, 113]]])

    def test_values_lie_at_a_multiple_of_four_bytes_by_stream_density_and_senone(self):
        weights = np.array([[[3.0, 1.0]], [[1.0, 1.0]], [[1.0, 3.0]]])
        sphinx_files.write_sendump(self.path, weights)
        content = self.path.read_bytes()
        self.assertEqual((len(content) - 6) % 4, 0)
        steps = sphinx_files.sendump_steps(weights)
        self.assertEqual(list(content[-6:]), [*steps[:, 0, 0], *steps[:, 0, 1]])
        self.assertEqual(struct.unpack("<3i", content[-18:-6]), (0, 2, 3))

    def test_every_cut_of_a_file_is_reported(self):
        sphinx_files.write_sendump(self.path, np.ones((2, 1, 2)))
        whole = self.path.read_bytes()
        for size in range(0, len(whole), 7):
            self.path.write_bytes(whole[:size])
            with self.subTest(size=size), self.assertRaisesRegex(ToolError, str(self.path)):
                sphinx_files.read_sendump(self.path)

    @unittest.skipUnless((ACOUSTIC_MODEL / "sendump").is_file(), "pocketsphinx-en-us is not installed")
    def test_the_model_en_us_is_read(self):
        weights = sphinx_files.read_sendump(ACOUSTIC_MODEL / "sendump")
        self.assertEqual(weights.shape, (5126, 3, 128))
        sums = weights.sum(2)
        self.assertLess(abs(sums.mean() - 1.0), 0.1)  # of rounded weights


if __name__ == "__main__":
    unittest.main()
