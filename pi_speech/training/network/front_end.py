"""The input of the word network: the same numbers as FilterBank and WordNetwork of pi_speech compute in C++."""

import numpy as np
from scipy.signal import lfilter

SAMPLE_RATE_HZ = 16000
FRAME, HOP, FFT = 400, 160, 512       # samples
BANDS, LOWEST_HZ, HIGHEST_HZ = 26, 60.0, 7600.0
PRE_EMPHASIS = 0.97
ENERGY_FLOOR = 100.0
# Per-channel energy normalisation (Wang et al. 2017), with their constants: it takes level and steady noise away.
SMOOTHING, GAIN_EXPONENT, OFFSET, ROOT = 0.025, 0.98, 2.0, 0.5


def _mel(hertz):
    return 2595.0 * np.log10(1.0 + hertz / 700.0)


def _triangles():
    low = _mel(LOWEST_HZ)
    step = (_mel(HIGHEST_HZ) - low) / (BANDS + 1)
    corners = 700.0 * (10.0 ** ((low + step * np.arange(BANDS + 2)) / 2595.0) - 1.0)
    hertz = np.arange(FFT // 2 + 1) * SAMPLE_RATE_HZ / FFT
    rise = (hertz[None, :] - corners[:-2, None]) / np.diff(corners)[:-1, None]
    fall = (corners[2:, None] - hertz[None, :]) / np.diff(corners)[1:, None]
    return np.maximum(0.0, np.minimum(rise, fall)).T.astype(np.float32)


_TRIANGLES = _triangles()
_WINDOW = (0.54 - 0.46 * np.cos(2.0 * np.pi * np.arange(FRAME) / (FRAME - 1))).astype(np.float32)


def log_energies(samples):
    """ln energies of the bands, one row per 10 ms. @param samples  at full scale 32768"""
    samples = np.asarray(samples, dtype=np.float32)
    if len(samples) < FRAME:
        return np.zeros((0, BANDS), np.float32)
    frames = np.lib.stride_tricks.sliding_window_view(samples, FRAME)[::HOP]
    before = np.concatenate([frames[:, :1], frames[:, :-1]], axis=1)
    spectra = np.fft.rfft((frames - PRE_EMPHASIS * before) * _WINDOW, FFT, axis=1)
    powers = (spectra.real ** 2 + spectra.imag ** 2).astype(np.float32)
    return np.log(powers @ _TRIANGLES + ENERGY_FLOOR)


def normalise(energies):
    """Input of the network. @param energies  ... x frames x BANDS, as log_energies() gives them"""
    energies = np.exp(np.asarray(energies, dtype=np.float32))
    numerator, denominator = np.float32([SMOOTHING]), np.float32([1.0, SMOOTHING - 1.0])
    smooth, _ = lfilter(numerator, denominator, energies, axis=-2, zi=(1.0 - SMOOTHING) * energies[..., :1, :])
    return (energies / smooth ** GAIN_EXPONENT + OFFSET) ** ROOT - OFFSET ** ROOT
