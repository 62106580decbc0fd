"""What was said in the clips: commands, other speech, or nothing."""

from dataclasses import dataclass

import numpy as np

from pi_speech.errors import ToolError, name_some


@dataclass
class Labels:
    """Names in the column of truth that are no commands."""

    other: tuple = ("_unknown_",)
    background: tuple = ("_silence_",)
    commands: tuple = ()  # empty: all the others


@dataclass
class Truth:
    """One entry per clip."""

    words: np.ndarray          # texts
    commands: list             # names, sorted
    is_command: np.ndarray
    is_other: np.ndarray
    is_background: np.ndarray


def read_truth(words, labels, path):
    """@param words  column of truth
    @throws ToolError naming words that are no command and no label"""
    words = np.array(words, dtype=object)
    is_other = np.isin(words, labels.other)
    is_background = np.isin(words, labels.background)
    rest = sorted(set(words[~is_other & ~is_background]))
    if labels.commands:
        strange = [word for word in rest if word not in labels.commands]
        way_out = f"known commands are {name_some(labels.commands, 30)}"
    else:
        strange = [word for word in rest if not word or word.startswith("_")]
        way_out = "name it by --other or --background"
    if strange:
        names = name_some(repr(word) for word in strange)
        raise ToolError(f"{path}: unknown word {names} in the column of truth; {way_out}")
    commands = sorted(labels.commands) if labels.commands else rest
    return Truth(words, commands, ~is_other & ~is_background, is_other, is_background)
