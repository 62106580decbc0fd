"""Parts of the speakers for cross-validation, the same ones everywhere: crc32(speaker) % 5."""

import package_path  # noqa: F401: leads to pi_speech

from pi_speech.calibration import FOLDS, fold_of
from pi_speech.errors import ToolError

ALL = "all"  # the models that are delivered, of all parts


def split(clips):
    """@return one list of clips per part, in their order"""
    parts = [[] for _ in range(FOLDS)]
    for clip in clips:
        parts[fold_of(clip.speaker)].append(clip)
    return parts


def training_parts(fold):
    """Numbers of the parts from which the models of a fold come: without its own one. @param fold  number or ALL"""
    return [part for part in range(FOLDS) if part != fold]


def check(clips, words):
    """@throws ToolError if a part has no clip of a command, or the other parts lack a word"""
    parts = split(clips)
    for fold, part in enumerate(parts):
        if not any(clip.word in words for clip in part):
            raise ToolError(f"part {fold} of {FOLDS} of the speakers has no command; give clips of more speakers")
        there = {clip.word for other in training_parts(fold) for clip in parts[other]}
        lacking = sorted(set(words) - there)
        if lacking:
            raise ToolError(f"without part {fold} of {FOLDS} of the speakers there is no clip of {', '.join(lacking)}; "
                            "give clips of more speakers")
