"""Scenes to learn from: some seconds of words, talk and noise, with what must be heard at each step."""

import numpy as np
from scipy.signal import fftconvolve

import noises
from front_end import HOP, SAMPLE_RATE_HZ, log_energies
from sounds import OTHER, WORDS, in_fold

SCENE_S = 4.0
STEP = 2 * HOP                       # samples between two decisions, 20 ms
STEPS = 199                          # of a scene, each of two frames
IGNORED = -1
NOTHING = len(WORDS)                 # class of all that is no command
# Steps relative to the end of a word. The word is demanded from 1 to 9; around that either answer is right.
FIRST_DEMANDED, LAST_DEMANDED, LAST_ALLOWED = 1, 9, 16
ALLOWED_FROM = 0.55                  # share of the word that must have been said
SHORT = ("go", "no")                 # their first half sounds like the whole
OFTEN = ("stop", "go", "up", "up", "left")  # come more often: the first is a brake, the others are heard worst
FULL_SCALE = 32767.0


def power(samples):
    """Mean power of the loudest fifth of 20 ms pieces: of speech, not of its pauses."""
    pieces = samples[:len(samples) // STEP * STEP].reshape(-1, STEP)
    if len(pieces) == 0:
        return 1.0
    powers = np.sort((pieces ** 2).mean(axis=1))
    return float(powers[-max(1, len(powers) // 5):].mean()) + 1e-3


def resampled(samples, factor):
    """Faster and higher by a factor."""
    at = np.arange(0, len(samples) - 1, factor)
    return np.interp(at, np.arange(len(samples)), samples).astype(np.float32)


def reverberated(random, samples):
    """In a room: decaying reflections behind the direct sound."""
    time_s = random.uniform(0.1, 0.8)
    time = np.arange(int(SAMPLE_RATE_HZ * min(time_s, 0.5))) / SAMPLE_RATE_HZ
    response = random.standard_normal(len(time)) * np.exp(-6.9 * time / time_s)
    response[:int(0.002 * SAMPLE_RATE_HZ)] = 0
    response *= np.sqrt(10 ** (random.uniform(-15, 3) / 10) / np.sum(response ** 2))
    response[0] = 1.0
    return fftconvolve(samples, response)[:len(samples)].astype(np.float32)


class Mixer:
    """Draws scenes of the recordings that a fold leaves."""

    def __init__(self, words, background, speech, music, seed, leave_out=None, only=None):
        """@param words, background, speech, music  as sounds.py reads them
        @param leave_out  fold whose speakers are not used; None: all are
        @param only  fold of the only speakers of commands; None: all"""
        self._random = np.random.default_rng(seed)
        keep = [word for word in words if not in_fold(word.speaker, leave_out)
                and (only is None or word.name == OTHER or in_fold(word.speaker, only))]
        self._words = {}
        for synthetic in (False, True):
            for name in [*WORDS, OTHER]:
                self._words[name, synthetic] = [word for word in keep if word.name == name
                                                and (word.speaker == "synthetic") == synthetic]
        self._background = [samples for speaker, samples in background if not in_fold(speaker, leave_out)]
        self._speech, self._music = speech, music

    def scene(self):
        """@return (log energies, frames x BANDS; class of each step)"""
        random = self._random
        count = int(SCENE_S * SAMPLE_RATE_HZ)
        voice = np.zeros(count, np.float32)
        events = []
        kind = random.choice(["words", "inside", "talk", "noise"], p=[0.18, 0.42, 0.27, 0.13])
        if kind == "words":
            self._add_words(voice, events)
        elif kind == "inside":
            self._add_words_in_talk(voice, events)
        elif kind == "talk":
            self._add_talk(voice, 0, count)
        level = power(voice) if kind != "noise" else 1.0
        if random.random() < 0.35 and kind != "noise":
            voice = reverberated(random, voice)
        samples = voice + self._noise(count, level, kind == "noise")
        samples -= samples.mean()
        # Levels of -50 to 0 dB of full scale; some are clipped.
        loudest = np.abs(samples).max() + 1e-6
        gain_db = random.uniform(-40, 0) if random.random() < 0.93 else random.uniform(0, 20)
        samples *= FULL_SCALE / loudest * 10 ** (gain_db / 20)
        samples = np.clip(np.round(samples), -FULL_SCALE - 1, FULL_SCALE)
        return log_energies(samples)[:2 * STEPS].astype(np.float16), self._labels(events)

    # ------------------------------------------------------------------------------------------------- what is said

    def _draw(self, synthetic=None, other=0.4):
        """A word, trimmed with a little of its surroundings. @param other  share of words that are no command
        @return (samples, begin, end, class)"""
        random = self._random
        name = OTHER if random.random() < other else random.choice([*WORDS, *OFTEN])
        synthetic = random.random() < (0.3 if name == OTHER else 0.1) if synthetic is None else synthetic
        choice = self._words[name, synthetic] or self._words[name, not synthetic] or self._words[OTHER, True]
        word = choice[random.integers(len(choice))]
        label = WORDS.index(word.name) if word.name in WORDS else NOTHING
        margin = int(random.uniform(0.0, 0.15) * SAMPLE_RATE_HZ)
        begin, end = word.begin, word.end
        if label != NOTHING and random.random() < 0.12:  # half a command is none
            first = name not in SHORT and random.random() < 0.6
            middle = begin + int(random.uniform(0.3, 0.6) * (end - begin))
            begin, end = (begin, middle) if first else (middle, end)
            margin, label = min(margin, 160), NOTHING
        left, right = max(0, begin - margin), min(len(word.samples), end + margin)
        factor = np.exp(random.normal(0.0, 0.12))
        samples = resampled(word.samples[left:right], factor)
        fade = min(160, len(samples) // 4)
        samples[:fade] *= np.linspace(0, 1, fade)
        samples[-fade:] *= np.linspace(1, 0, fade)
        samples *= 1000.0 / np.sqrt(power(samples)) * 10 ** (random.normal(0, 2.5) / 20)
        return samples, int((begin - left) / factor), int((end - left) / factor), label

    def _put(self, voice, events, at, drawn):
        """@return where the next one may begin"""
        samples, begin, end, label = drawn
        if at < 0 or at + len(samples) > len(voice):
            return None
        voice[at:at + len(samples)] += samples
        if label != NOTHING:
            events.append((at + begin, at + end, label))
        return at + len(samples)

    def _add_words(self, voice, events):
        random = self._random
        at = int(random.uniform(0.1, 0.9) * SAMPLE_RATE_HZ)
        drawn = self._draw()
        while at is not None:
            at = self._put(voice, events, at, drawn)
            if at is not None:
                twice = random.random() < 0.1
                at += int((random.uniform(0.03, 0.3) if twice else random.exponential(0.35)) * SAMPLE_RATE_HZ)
                drawn = drawn if twice else self._draw()

    def _add_words_in_talk(self, voice, events):
        """Talk and words in turns: gaps are short, and some pieces of talk are silent."""
        random = self._random
        at = 0
        while at is not None and at < len(voice):
            end = min(len(voice), at + int(random.uniform(0.3, 1.6) * SAMPLE_RATE_HZ))
            if random.random() < 0.8:
                self._add_talk(voice, at, end, at_end=True)
            at = self._put(voice, events, end + self._gap(), self._draw(other=0.25))
            at = at and at + self._gap()
        if at is None:
            self._add_talk(voice, end, len(voice))

    def _gap(self):
        most_s = self._random.choice([0.05, 0.25])
        return int(self._random.uniform(0, most_s) * SAMPLE_RATE_HZ)

    def _add_talk(self, voice, begin, end, at_end=False):
        """Pieces of talk, one after the other. @param at_end  the last one touches the end"""
        random = self._random
        pieces, length = [], 0
        while length < end - begin:
            piece = self._speech[random.integers(len(self._speech))].astype(np.float32)
            if len(piece) > SAMPLE_RATE_HZ and random.random() < 0.7:
                piece = piece[random.integers(len(piece) - SAMPLE_RATE_HZ):]
            piece = piece[:int(random.uniform(0.4, 4.0) * SAMPLE_RATE_HZ)]
            loud = np.flatnonzero(np.abs(piece) > 0.05 * np.abs(piece).max())
            if len(loud) == 0 or loud[-1] - loud[0] < 1600:
                continue
            piece = resampled(piece[loud[0]:loud[-1]], np.exp(random.normal(0.0, 0.1)))
            pieces.append(piece * 1000.0 / np.sqrt(power(piece)) * 10 ** (random.normal(0, 2.5) / 20))
            length += len(piece)
        if pieces:
            talk = np.concatenate(pieces)
            talk = talk[-(end - begin):] if at_end else talk[:end - begin]
            fade = min(80, len(talk))
            talk[:fade] *= np.linspace(0, 1, fade)
            talk[-fade:] *= np.linspace(1, 0, fade)
            voice[begin:end] += talk

    # --------------------------------------------------------------------------------------------------- surroundings

    def _noise(self, count, level, alone):
        random = self._random
        if not alone and random.random() < 0.25:
            return np.sqrt(level) * 10 ** (-random.uniform(30, 60) / 20) * noises.coloured(random, count)
        which = random.random()
        if which < 0.25:
            pieces = [self._background[random.integers(len(self._background))]]
            same = random.random() < 0.7
            while sum(len(piece) for piece in pieces) < count + 8000:
                pieces.append(pieces[0] if same else self._background[random.integers(len(self._background))])
            noise = np.concatenate(pieces)[random.integers(8000):][:count]
            noise = noise / (np.sqrt(np.mean(noise ** 2)) + 1e-3)
        elif which < 0.4:
            noise = np.zeros(count, np.float32)
            for _ in range(random.integers(1, 6)):
                self._add_talk(noise, 0, count)
            noise /= np.sqrt(power(noise))
        elif which < 0.47:
            piece = self._music[random.integers(len(self._music))]
            noise = piece[random.integers(len(piece) - count):][:count].astype(np.float32)
            noise = noise / (np.sqrt(np.mean(noise ** 2)) + 1.0)
        else:
            noise = noises.draw(random, count)
        snr_db = random.uniform(0, 30) if which >= 0.4 or which < 0.25 else random.uniform(8, 30)
        return np.sqrt(level) * 10 ** (-snr_db / 20) * noise

    def _labels(self, events):
        labels = np.full(STEPS, NOTHING, np.int8)
        for begin, end, _ in events:
            first = int((begin + ALLOWED_FROM * (end - begin)) / STEP)
            labels[max(0, first):max(0, end // STEP + LAST_ALLOWED)] = IGNORED
        for begin, end, label in sorted(events):
            labels[int((begin + ALLOWED_FROM * (end - begin)) / STEP):end // STEP + FIRST_DEMANDED] = IGNORED
            labels[end // STEP + FIRST_DEMANDED:end // STEP + LAST_DEMANDED + 1] = label
        return labels
