"""The recordings from which scenes are mixed: command words, other words, speech, background."""

import csv
import pickle
import re
import subprocess
import zlib
from dataclasses import dataclass
from pathlib import Path

import package_path  # noqa: F401: leads to pi_speech
import numpy as np
import soundfile
from scipy.signal import resample_poly

from front_end import HOP, SAMPLE_RATE_HZ, log_energies
from pi_speech.calibration import fold_of
from pi_speech.errors import ToolError

WORDS = ("down", "go", "left", "no", "off", "on", "right", "stop", "up", "yes")
OTHER, BACKGROUND = "_unknown_", "_silence_"  # words of the lists that are no command
SYNTHETIC = "synthetic"                       # speaker of computed voices
HELD_OUT_PART = 0                             # of speech files: crc32(name) % 4; only judged with

# Words that sound like commands, spoken by computed voices.
SIMILAR = """stock step stamp shop top star store start spot dog got drop stuff sock stub
  gold goat goes ghost dough show low toe so ago coal boat girl good
  lift laugh let leaf theft less lest lap leg last light love
  ride light bright night white write-off rain round rise height rat wrap rest
  town brown done dawn sound found dumb dine and then doubt
  now nose note new snow not none nine name mow near own
  cup app of at but us ark apple cop pup hub ever
  on-line in an one own won arm aunt hon old and
  cough awful office often of offer half have soft off-peak
  yet yeah guess chess says this is yesterday just west best""".split()
SENTENCES = """The old man walked slowly along the river and looked at the boats.
  Yesterday we had coffee with milk and talked about the weather for hours.
  I think the meeting is at seven, but she told me that it might be later.
  Please remember to buy bread, butter, apples and a bottle of water.
  My sister works in a hospital near the station and comes home late.
  They have seen the film before, because their children love it.
  What did you do in the summer? We went swimming in a lake near the mountains.
  This car is quite comfortable, and the music is good, do you not agree?
  The engine makes a strange sound when the temperature falls below zero.
  Can we have lunch somewhere? I am hungry and the shop closes soon.""".split("\n")
VOICES = ("en-us", "en-gb", "en-gb-scotland", "en-gb-x-rp", "en-029", "en-gb-x-gbclan")
VARIANTS = ("", "+m1", "+m2", "+m3", "+m4", "+m5", "+m6", "+m7", "+f1", "+f2", "+f3", "+f4", "+f5", "+whisper",
            "+croak", "+klatt", "+klatt3")
FLITE_VOICES = ("kal16", "awb", "rms", "slt")


@dataclass
class Word:
    """A clip of one word. `begin` and `end` are those of the word in it [samples]."""

    name: str
    speaker: str
    samples: np.ndarray  # float32, full scale 32768
    begin: int
    end: int


def read(path):
    """@return mono samples at 16 kHz, float32, full scale 32768. @throws ToolError"""
    path = Path(path)
    if path.suffix in (".g722", ".mp3"):
        done = subprocess.run(["ffmpeg", "-v", "error", "-i", str(path), "-ac", "1", "-ar", str(SAMPLE_RATE_HZ), "-f",
                               "s16le", "-"], capture_output=True)
        if done.returncode:
            raise ToolError(f"{path}: ffmpeg cannot decode it: {done.stderr.decode(errors='replace').strip()}")
        return np.frombuffer(done.stdout, "<i2").astype(np.float32)
    if path.suffix == ".raw":
        return np.fromfile(path, "<i2").astype(np.float32)
    try:
        raw = {"format": "RAW", "subtype": "GSM610", "samplerate": 8000, "channels": 1} if path.suffix == ".gsm" else {}
        samples, rate = soundfile.read(path, dtype="float32", always_2d=True, **raw)
    except RuntimeError as error:
        raise ToolError(f"{path}: cannot be read: {error}") from error
    samples = samples.mean(axis=1) * 32768.0
    if rate != SAMPLE_RATE_HZ:
        divisor = np.gcd(rate, SAMPLE_RATE_HZ)
        samples = resample_poly(samples, SAMPLE_RATE_HZ // divisor, rate // divisor)
    return samples.astype(np.float32)


def extent(samples):
    """Where the word is: frames within 25 dB of the loudest and well above the background, with gaps of up to 0.16 s as
    before the burst of a plosive. @return (begin, end) [samples]"""
    energies = log_energies(samples)
    if len(energies) == 0:
        return 0, len(samples)
    level = 10 / np.log(10) * np.log(np.exp(energies[:, 3:].astype(float)).sum(axis=1))
    level = np.convolve(np.pad(level, 1, mode="edge"), np.ones(3) / 3, "valid")
    loudest, floor = level.max(), np.percentile(level, 8)
    active = level > max(loudest - 25.0, floor + 0.3 * (loudest - floor))
    first = last = int(np.argmax(level))
    for step, limit in ((-1, 0), (1, len(level) - 1)):
        at, gap = first, 0
        while at != limit and gap <= 16:
            at += step
            gap = 0 if active[at] else gap + 1
            if active[at] and step < 0:
                first = at
            elif active[at]:
                last = max(last, at)
    return first * HOP, min(len(samples), last * HOP + 400)


def _word(name, speaker, samples):
    return Word(name, speaker, samples, *extent(samples))


def read_words(data):
    """The clips of DATA/commands.tsv and DATA/extra.tsv. @return (words, background). @throws ToolError"""
    words, background = [], []
    for listing in ("commands.tsv", "extra.tsv"):
        path = Path(data) / listing
        if not path.is_file():
            if listing == "commands.tsv":
                raise ToolError(f"{path} is missing; --data must name the folder with commands.tsv and its clips")
            continue
        with open(path, encoding="utf-8") as file:
            for row in csv.DictReader(file, delimiter="\t"):
                samples = read(Path(data) / row["file"])
                if row["word"] == BACKGROUND:
                    background.append((row["speaker"], samples))
                    continue
                name = row["word"] if row["word"] in WORDS else OTHER
                words.append(_word(name, row["speaker"], samples))
    return words, background


def _say(command, path):
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    samples = read(path)
    path.unlink()
    return samples


def synthetic_words(folder, seed=1):
    """Commands and words like them by espeak-ng and flite."""
    random = np.random.default_rng(seed)
    path, words = Path(folder) / "synthetic.wav", []
    for text in [*WORDS, *SIMILAR]:
        name = text if text in WORDS else OTHER
        for voice in FLITE_VOICES:
            samples = _say(["flite", "-voice", voice, "-t", text, "-o", str(path)], path)
            words.append(_word(name, SYNTHETIC, samples))
        for _ in range(70 if text in WORDS else 8):
            voice = random.choice(VOICES) + random.choice(VARIANTS)
            samples = _say(["espeak-ng", "-v", voice, "-s", str(random.integers(110, 220)), "-p",
                            str(random.integers(15, 85)), "-w", str(path), text], path)
            words.append(_word(name, SYNTHETIC, samples))
    return [word for word in words if word.end - word.begin > 1600]


def synthetic_speech(folder, seed=2):
    random = np.random.default_rng(seed)
    path, speech = Path(folder) / "synthetic.wav", []
    for sentence in SENTENCES:
        for voice in FLITE_VOICES:
            speech.append(_say(["flite", "-voice", voice, "-t", sentence, "-o", str(path)], path))
        for _ in range(4):
            voice = random.choice(VOICES) + random.choice(VARIANTS)
            speech.append(_say(["espeak-ng", "-v", voice, "-s", str(random.integers(120, 210)), "-w", str(path),
                                sentence], path))
    return speech


# Prompts with these in their English names may have a command in them, or the "no" of Romance languages.
_MAY_BE_SAID = re.compile(r"(down|go|left|not?|off|on|right|stop|up|yes|cannot|dont|wont|invalid|without|silence)")

_LIKE_COMMANDS = {"go", "gou", "no", "nou", "on", "un", "an", "of", "off", "up", "ap", "op", "ja", "da", "si"}  # syllables


def speech_files():
    """Files of speech of Debian's packages that hardly has a command in it, in other languages and English."""
    prompts = [file for file in sorted(Path("/usr/share/asterisk/sounds").rglob("*.g722"))
               if not _MAY_BE_SAID.search(f"{file.parent.name}/{file.stem}")]
    names = sorted(Path("/usr/share/tuxpaint/stamps").rglob("*_desc_*.ogg"))
    dialogues = sorted(file for file in Path("/usr/share/games/fillets-ng/sound").rglob("*.ogg")
                       if file.parent.name == "cs")
    return prompts + names[::3] + dialogues


def more_speech_files():
    """Files of speech of which none is judged with: further voices and languages, most of them single words."""
    prompts = [file for file in sorted(Path("/usr/share/asterisk/sounds").rglob("*"))
               if file.suffix in (".gsm", ".wav") and not _MAY_BE_SAID.search(f"{file.parent.name}/{file.stem}")]
    names = sorted(Path("/usr/share/ktuberling/sounds").rglob("*.ogg"))
    syllables = [file for file in sorted(Path("/usr/share/klettres").rglob("*.ogg"))
                 if file.stem.lower() not in _LIKE_COMMANDS]
    dialogues = sorted(file for file in Path("/usr/share/games/fillets-ng/sound").rglob("*.ogg")
                       if file.parent.name == "nl")
    return prompts + names + syllables + dialogues


def is_held_out(file):
    """Whether a speech file is left for judging only."""
    return zlib.crc32(Path(file).name.encode()) % 4 == HELD_OUT_PART


def read_speech(held_out=False):
    """Pieces of speech, of at least 0.5 s, that are joined to talk."""
    files = [file for file in speech_files() if is_held_out(file) == held_out]
    speech = []
    for file in files if held_out else files + more_speech_files():
        samples = read(file)
        if len(samples) > SAMPLE_RATE_HZ // 2 and np.abs(samples).max() > 500:
            speech.append(samples)
    return speech


def read_music():
    """Recorded music without voices."""
    return [read(file) for file in sorted(Path("/usr/share/asterisk/moh").rglob("*.g722"))]


def cached(path, make):
    """What make() gives, from a file where it was made before."""
    if not path.is_file():
        made = make()
        partial = path.with_suffix(".partial")
        partial.write_bytes(pickle.dumps(made))
        partial.rename(path)
        return made
    return pickle.loads(path.read_bytes())


def in_fold(speaker, fold):
    return fold is not None and speaker != SYNTHETIC and fold_of(speaker) == fold
