"""MAP estimates on numbers worked out by hand, and what adapt() writes."""

import struct
import tempfile
import unittest
from pathlib import Path

import training_path  # noqa: F401: leads to the modules of the training
import numpy as np

import adapt
import sphinx_files


class MapEstimates(unittest.TestCase):
    def test_means_lie_between_prior_and_clips(self):
        prior = np.array([[[[1.0, -2.0]]]])
        sums = np.array([[[[30.0, 10.0]]]])  # of ten frames: mean 3 and 1
        means = adapt.map_means(prior, sums, np.array([[[10.0]]]), 5.0)
        np.testing.assert_allclose(means, [[[[(5.0 + 30.0) / 15.0, (-10.0 + 10.0) / 15.0]]]])

    def test_a_gaussian_without_frames_keeps_its_mean(self):
        prior = np.array([[[[1.5, -2.5]]]])
        np.testing.assert_array_equal(adapt.map_means(prior, np.zeros((1, 1, 1, 2)), np.zeros((1, 1, 1)), 5.0), prior)

    def test_many_frames_leave_nothing_of_the_prior(self):
        means = adapt.map_means(np.array([[[[100.0]]]]), np.array([[[[4e9]]]]), np.array([[[2e9]]]), 5.0)
        np.testing.assert_allclose(means, [[[[2.0]]]], rtol=1e-6)

    def test_weights_are_shares(self):
        prior = np.array([[[2.0, 6.0]]])  # 0.25 and 0.75
        weights = adapt.map_weights(prior, np.array([[[40.0, 10.0]]]), 50.0)
        np.testing.assert_allclose(weights, [[[(12.5 + 40.0) / 100.0, (37.5 + 10.0) / 100.0]]])
        np.testing.assert_allclose(weights.sum(2), 1.0)


class Adapt(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)
        model, adapt.ACOUSTIC_MODEL = adapt.ACOUSTIC_MODEL, self.folder
        self.addCleanup(setattr, adapt, "ACOUSTIC_MODEL", model)
        sphinx_files.write_gaussians(self.folder / "means", np.array([[[[1.0], [2.0]]]]))
        self.base = adapt.BaseModel(self.folder)
        sphinx_files.write_mixture_weights(self.base.weights, np.array([[[0.5, 0.5]]]))

    def counts(self, name, sums, occupation):
        """Counts of one codebook of two densities."""
        folder = self.folder / name
        folder.mkdir()
        body = struct.pack("<I3i4i", 0x11223344, 1, 1, 0, 1, 2, 1, 1) + struct.pack("<i2f", 2, *sums) * 2
        (folder / "gauden_counts").write_bytes(b"s3\nendhdr\n" + body + struct.pack("<4i2f", 1, 1, 2, 2, *occupation))
        sphinx_files.write_mixture_weights(folder / "mixw_counts", np.array([[occupation]]))
        return folder

    def test_parts_are_added(self):
        parts = [self.counts("a", (10.0, 0.0), (5.0, 0.0)), self.counts("b", (20.0, 14.0), (10.0, 35.0))]
        frames = adapt.adapt(self.base, parts, self.folder / "out", "off  AA F\n")
        self.assertEqual(frames, 50.0)
        np.testing.assert_allclose(sphinx_files.read_gaussians(self.folder / "out/means"),
                                   [[[[(5.0 + 30.0) / 20.0], [(10.0 + 14.0) / 40.0]]]])
        weights = sphinx_files.read_sendump(self.folder / "out/sendump")
        # (50 * 0.5 + 15) / 100 and (50 * 0.5 + 35) / 100, each at most a step of 10 % smaller
        np.testing.assert_allclose(weights, [[[0.4, 0.6]]], rtol=0.11)
        self.assertEqual((self.folder / "out/pronunciations.dict").read_text(), "off  AA F\n")


if __name__ == "__main__":
    unittest.main()
