"""The recordings: a list of clips with one word each, and their samples."""

import subprocess
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import package_path  # noqa: F401: leads to pi_speech
import numpy as np

from pi_speech.errors import ToolError
from pi_speech.tables import read_table

SAMPLE_RATE_HZ = 16000


@dataclass(frozen=True)
class Clip:
    path: Path
    key: str      # a name for files made of it
    word: str
    speaker: str


def key_of(file):
    """commands/on/0a_nohash_0.flac -> on__0a_nohash_0: the last folder and the name."""
    path = Path(file)
    return f"{path.parent.name}__{path.stem}"


def read_clips(data, every=1):
    """The list DATA/commands.tsv with columns file, word and speaker; files are beside it.
    @param every  N: keep the first, the (N + 1)th, ... clip of each word
    @throws ToolError"""
    listing = Path(data) / "commands.tsv"
    table = read_table(listing, ["file", "word", "speaker"])
    seen, clips = {}, []
    for file, word, speaker in zip(*(table.columns[name] for name in ("file", "word", "speaker"))):
        number = seen.get(word, 0)
        seen[word] = number + 1
        if number % every == 0:
            clips.append(Clip((Path(data) / file).resolve(), key_of(file), word, speaker))
    key, count = Counter(clip.key for clip in clips).most_common(1)[0]
    if count > 1:
        raise ToolError(f"{listing}: {count} files are called {key}; folder and name together must differ")
    return clips


def write_list(path, clips):
    """A list that recognize_files reads from any folder."""
    Path(path).write_text("file\tword\tspeaker\n" + "".join(f"{clip.path}\t{clip.word}\t{clip.speaker}\n"
                                                            for clip in clips))


def flac_format(path):
    """@return (samples per second, channels, bits) of a FLAC file. @throws ToolError"""
    try:
        with open(path, "rb") as file:
            head = file.read(42)
    except OSError as error:
        raise ToolError(f"{path}: {error.strerror or error}") from error
    if len(head) < 42 or head[:4] != b"fLaC" or head[4] & 0x7F != 0:
        raise ToolError(f"{path} is no FLAC file; write it again by flac")
    packed = int.from_bytes(head[18:26], "big")
    return packed >> 44, (packed >> 41 & 7) + 1, (packed >> 36 & 31) + 1


def read_flac(path):
    """@return samples of a mono clip of 16 bits at 16 kHz, int16. @throws ToolError"""
    rate, channels, bits = flac_format(path)
    if (rate, channels, bits) != (SAMPLE_RATE_HZ, 1, 16):
        raise ToolError(f"{path}: {rate} Hz, {channels} channels, {bits} bits, must be {SAMPLE_RATE_HZ} Hz, 1 channel, "
                        "16 bits; convert it by sox")
    done = subprocess.run(["flac", "-s", "-d", "-c", "--force-raw-format", "--endian=little", "--sign=signed",
                           str(path)], capture_output=True)
    if done.returncode:
        message = done.stderr.decode(errors="replace").strip().splitlines()
        raise ToolError(f"{path}: cannot be decoded: {message[-1] if message else 'flac gives no reason'}")
    return np.frombuffer(done.stdout, "<i2")
