"""Noisy copies of clips: real recordings of noise, white and pink noise."""

import wave
import zlib

import package_path  # noqa: F401: leads to pi_speech
import numpy as np

from clips import SAMPLE_RATE_HZ
from pi_speech.errors import ToolError

LEAST_SNR_DB, MOST_SNR_DB = 10.0, 20.0
FRAME, HOP = 400, 160       # samples: 25 and 10 ms
ACTIVE_SHARE = 0.25         # of a clip's frames, the loudest ones: they are the speech
LARGEST_SAMPLE = 32000


def read_noise(path):
    """@return samples of a WAV file, mono, 16 bits, 16 kHz, as floats. @throws ToolError"""
    try:
        with wave.open(str(path)) as file:
            found = (file.getframerate(), file.getnchannels(), 8 * file.getsampwidth())
            if found != (SAMPLE_RATE_HZ, 1, 16):
                raise ToolError(f"{path}: {found[0]} Hz, {found[1]} channels, {found[2]} bits, must be "
                                f"{SAMPLE_RATE_HZ} Hz, 1 channel, 16 bits; convert it by sox")
            return np.frombuffer(file.readframes(file.getnframes()), "<i2").astype(float)
    except (OSError, EOFError, wave.Error) as error:
        raise ToolError(f"{path}: is no WAV file that can be read: {error}") from error


def speech_power(samples):
    """Mean power of the loudest frames. @param samples  at least one frame"""
    powers = np.sort([np.mean(samples[i:i + FRAME] ** 2) for i in range(0, len(samples) - FRAME + 1, HOP)])
    return float(powers[-max(1, int(len(powers) * ACTIVE_SHARE)):].mean())


def pink(random, count):
    spectrum = np.fft.rfft(random.standard_normal(count))
    return np.fft.irfft(spectrum / np.sqrt(np.maximum(np.arange(len(spectrum)), 1)), count)


def noisy_copy(samples, key, noises, seed):
    """@param samples  clip, int16
    @param key  name of the clip: with the seed it fixes which noise it gets, how strong, and from where
    @param noises  name -> samples; white and pink noise come on top
    @return (int16 samples, name of the noise, SNR [dB] against the clip's speech)
    @throws ToolError if the clip is shorter than a frame or the noise than the clip"""
    random = np.random.default_rng([seed, zlib.crc32(key.encode())])
    clean = samples.astype(float)
    kinds = [*noises, "white", "pink"]
    kind = kinds[random.integers(len(kinds))]
    snr_db = float(random.uniform(LEAST_SNR_DB, MOST_SNR_DB))
    if len(clean) < FRAME:
        raise ToolError(f"{key}: {len(clean)} samples, must be at least {FRAME}; leave it out of commands.tsv")
    if kind in noises:
        room = len(noises[kind]) - len(clean)
        if room < 0:
            raise ToolError(f"{kind}: {len(noises[kind])} samples of noise, {key} has {len(clean)}; give longer noise")
        begin = random.integers(room + 1)
        noise = noises[kind][begin:begin + len(clean)]
    else:
        noise = random.standard_normal(len(clean)) if kind == "white" else pink(random, len(clean))
    noise = noise - noise.mean()
    power = np.mean(noise ** 2)
    if power > 0.0:
        noise = noise * np.sqrt(speech_power(clean) / power / 10 ** (snr_db / 10))
    mixed = clean + noise
    mixed *= min(1.0, LARGEST_SAMPLE / max(1.0, np.abs(mixed).max()))
    return mixed.round().astype("<i2"), kind, snr_db
