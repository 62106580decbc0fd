"""Noises that are computed: nothing depends on one recording. All have a mean square of 1."""

import numpy as np

from front_end import SAMPLE_RATE_HZ


def _unit(samples):
    samples = samples - samples.mean()
    return (samples / (np.sqrt(np.mean(samples ** 2)) + 1e-9)).astype(np.float32)


def coloured(random, count, slope=None):
    """Noise whose power falls by `slope` * 10 dB per decade."""
    slope = random.uniform(0.0, 2.2) if slope is None else slope
    spectrum = np.fft.rfft(random.standard_normal(count))
    return _unit(np.fft.irfft(spectrum * np.maximum(np.arange(len(spectrum)), 1) ** (-0.5 * slope), count))


def _slow(random, count, hertz):
    """A smooth random curve with a deviation of about 1."""
    points = max(4, int(count / SAMPLE_RATE_HZ * hertz) + 3)
    return np.interp(np.linspace(0, points - 1, count), np.arange(points), random.standard_normal(points))


def wind(random, count):
    """Low rumble in gusts, with hiss that comes with the strong ones."""
    gust = np.exp(random.uniform(0.3, 1.2) * _slow(random, count, random.uniform(0.5, 4.0)))
    return _unit(gust * coloured(random, count, random.uniform(1.5, 3.0))
                 + random.uniform(0.0, 0.2) * gust ** 2 * coloured(random, count, random.uniform(0.3, 1.0)))


def rain(random, count):
    """Hiss with drops: short decaying tones and clicks."""
    result = coloured(random, count, random.uniform(-0.5, 0.8))
    length = 400
    for at in random.integers(0, max(1, count - length), int(count / SAMPLE_RATE_HZ * random.uniform(5, 150))):
        time = np.arange(length) / SAMPLE_RATE_HZ
        drop = np.exp(-time * random.uniform(150, 1500)) * np.sin(2 * np.pi * random.uniform(400, 6000) * time)
        result[at:at + length] += (random.exponential(3.0) * drop)[:max(0, count - at)]
    return _unit(result)


def fan(random, count):
    """Air and blades: coloured noise, shallow modulation at the blades' rate, tones."""
    time = np.arange(count) / SAMPLE_RATE_HZ
    blade = random.uniform(10, 120)
    depth = random.uniform(0.0, 0.5)
    result = coloured(random, count, random.uniform(0.5, 1.8))
    result *= 1 + depth * np.sin(2 * np.pi * blade * time + random.uniform(0, 6))
    for harmonic in range(1, random.integers(2, 8)):
        result += random.uniform(0, 0.3) / harmonic * np.sin(2 * np.pi * blade * harmonic * time)
    return _unit(result)


def machine(random, count):
    """Motor, bicycle or tyre: harmonics of a turning rate that wanders, beats and ticks at the rate of the load."""
    base = np.exp(random.uniform(np.log(15), np.log(400)))
    rate = base * (1 + random.uniform(0, 0.06) * _slow(random, count, random.uniform(0.3, 3.0)))
    phase = 2 * np.pi * np.cumsum(rate) / SAMPLE_RATE_HZ
    result = np.zeros(count)
    fall = random.uniform(0.2, 1.5)
    formant = random.uniform(200, 4000)
    for harmonic in range(1, min(50, int(7000 / base)) + 1):
        if random.random() < 0.7:
            near = 1 + random.uniform(0, 4) * np.exp(-(np.log(harmonic * base / formant) / 0.4) ** 2)
            result += random.uniform(0.3, 1) * near * harmonic ** -fall * np.sin(harmonic * phase + random.uniform(0, 6))
    beat = np.exp(random.uniform(np.log(0.8), np.log(14)))
    turn = 2 * np.pi * beat * np.arange(count) / SAMPLE_RATE_HZ + 0.5 * _slow(random, count, 0.5)
    shape = (0.5 + 0.5 * np.sin(turn)) ** random.uniform(0.5, 6.0)
    depth = random.uniform(0.0, 1.0)
    hiss = random.uniform(0.1, 2.0) * coloured(random, count)
    ticks = 0.5 + 0.5 * np.sin(turn + random.uniform(0, 6))
    return _unit(_unit(result) * (1 - depth + depth * shape) + hiss * (1 - depth + depth * ticks ** random.uniform(1, 8)))


def music(random, count):
    """Notes with harmonics on a scale, chords and a beat."""
    result = np.zeros(count)
    step = int(SAMPLE_RATE_HZ * random.uniform(0.12, 0.6))
    key = random.uniform(55, 440)
    scale = np.array([0, 2, 4, 5, 7, 9, 11, 12, 14, 16])
    for at in range(0, count, step):
        length = min(count - at, int(step * random.uniform(0.5, 3)))
        time = np.arange(length) / SAMPLE_RATE_HZ
        envelope = np.exp(-time * random.uniform(0.5, 10)) * np.minimum(1, time / random.uniform(0.003, 0.05))
        for _ in range(random.integers(1, 4)):
            pitch = key * 2 ** (random.choice(scale) / 12) * random.choice([0.5, 1, 1, 2])
            vibrato = random.uniform(0, 0.01) * np.sin(2 * np.pi * random.uniform(4, 7) * time)
            for harmonic in range(1, random.integers(2, 12)):
                if harmonic * pitch < 7500:
                    result[at:at + length] += (harmonic ** -random.uniform(0.5, 2) * envelope
                                               * np.sin(2 * np.pi * harmonic * pitch * time * (1 + vibrato)))
        if random.random() < 0.5:
            hit = min(count - at, 2000)
            result[at:at + hit] += (random.uniform(0, 2) * np.exp(-np.arange(hit) / random.uniform(50, 600))
                                    * random.standard_normal(hit))
    return _unit(result)


def clatter(random, count):
    """Bangs, dishes, clicks: bursts of noise and of ringing modes."""
    result = random.uniform(0.01, 0.1) * coloured(random, count)
    for at in random.integers(0, count, max(1, int(count / SAMPLE_RATE_HZ * random.uniform(0.5, 8)))):
        length = min(count - at, int(SAMPLE_RATE_HZ * random.uniform(0.02, 0.5)))
        time = np.arange(length) / SAMPLE_RATE_HZ
        burst = random.standard_normal(length) * np.exp(-time * random.uniform(20, 400))
        for _ in range(random.integers(0, 6)):
            burst += (random.uniform(0, 1.5) * np.exp(-time * random.uniform(5, 80))
                      * np.sin(2 * np.pi * random.uniform(200, 7000) * time))
        result[at:at + length] += random.exponential(1.0) * burst
    return _unit(result)


KINDS = (coloured, wind, rain, rain, fan, machine, machine, machine, music, clatter)


def draw(random, count):
    """One of all kinds: often those that hide words best."""
    return KINDS[random.integers(len(KINDS))](random, count)
