"""Makes scenes sound differently each time they are drawn. Works on energies of bands, which is fast."""

import numpy as np

from front_end import BANDS
from scenes import IGNORED, LAST_ALLOWED, NOTHING

SPEED, FASTEST, THROAT = 0.12, 1.5, 0.11   # deviations of the logarithms of the factors
SPEED_SHARE, THROAT_SHARE = 0.7, 0.7       # of the scenes
LOUDEST_DB, QUIETEST_DB = -4.0, -25.0      # of what is added, relative to the loudest fifth of the scene


def other_speed(random, energies, labels):
    """Faster or slower. What is missing at the end comes from the beginning of another scene.
    @param energies  scenes x frames x BANDS
    @param labels  scenes x steps"""
    count, frames, _ = energies.shape
    factor = np.exp(random.normal(0.0, SPEED, (count, 1)) * (random.random((count, 1)) < SPEED_SHARE))
    factor = np.minimum(factor, FASTEST)
    rows = np.arange(count)[:, None]
    following = np.roll(labels, 1, axis=0)
    begin = following[:, :LAST_ALLOWED]
    begin[begin == NOTHING] = IGNORED  # a word may have ended just before
    labels = np.concatenate([labels, following], axis=1)
    energies = np.concatenate([energies, np.roll(energies, 1, axis=0)], axis=1)
    at = np.arange(frames) * factor
    low = at.astype(int)
    part = (at - low)[:, :, None].astype(np.float32)
    steps = np.rint(np.arange(frames // 2) * factor).astype(int)
    return energies[rows, low] * (1 - part) + energies[rows, low + 1] * part, labels[rows, steps]


def other_throat(random, energies):
    """Formants higher or lower, as of children and tall men: the bands are stretched."""
    count = len(energies)
    factor = np.exp(random.normal(0.0, THROAT, (count, 1)) * (random.random((count, 1)) < THROAT_SHARE))
    at = np.clip(np.arange(BANDS) * factor, 0, BANDS - 1)
    low = np.minimum(at.astype(int), BANDS - 2)
    part = (at - low)[:, None, :].astype(np.float32)
    low = np.broadcast_to(low[:, None, :], energies.shape)
    return (np.take_along_axis(energies, low, 2) * (1 - part) + np.take_along_axis(energies, low + 1, 2) * part)


def with_background(random, energies, backgrounds):
    """@param backgrounds  one for each scene, added as powers, quieter than its words"""
    powers, added = np.exp(energies), np.exp(backgrounds)
    loudest = np.sort(powers.sum(axis=2), axis=1)[:, -energies.shape[1] // 5:].mean(axis=1)
    gain = loudest / added.sum(axis=2).mean(axis=1)
    gain *= 10 ** (random.uniform(QUIETEST_DB, LOUDEST_DB, len(energies)) / 10)
    return np.log(powers + gain[:, None, None].astype(np.float32) * added)


def with_holes(random, inputs):
    """Some bands and some moments are missing. @param inputs  scenes x BANDS x frames, of the network; changed"""
    for each in inputs:
        if random.random() < 0.5:
            width = random.integers(1, 5)
            begin = random.integers(BANDS - width)
            each[begin:begin + width] = 0.0
        for _ in range(random.integers(0, 3)):
            begin = random.integers(each.shape[1] - 8)
            each[:, begin:begin + random.integers(1, 8)] = 0.0
    return inputs
