"""Fits the model of the confidence to evidence of clips, with cross-validation over speakers."""

import zlib
from dataclasses import dataclass

import numpy as np

from pi_speech.errors import ToolError, name_some
from pi_speech.logistic_regression import fit
from pi_speech.tables import read_table
from pi_speech.truth import Truth, read_truth

FOLDS = 5
LAST_OTHER_COLUMN = "candidate"  # behind it come the features


@dataclass
class EvidenceSet:
    """Candidates for commands, one entry each; the clips that they are of, one entry each in `truth`."""

    path: str
    names: list            # m features
    features: np.ndarray   # n x m
    candidates: np.ndarray  # texts; "" where nothing fits
    clips: np.ndarray      # index of the clip of each candidate
    right: np.ndarray      # the candidate is what was said, and a command
    truth: Truth
    folds: np.ndarray      # of each clip, by its speaker


@dataclass
class Rates:
    accuracy: float
    false_other: float
    false_background: float


def fold_of(speaker):
    return zlib.crc32(speaker.encode()) % FOLDS


def load_evidence(path, labels, word_column, speaker_column):
    """@throws ToolError"""
    table = read_table(path, ["file", word_column, speaker_column, LAST_OTHER_COLUMN])
    names = table.names[table.names.index(LAST_OTHER_COLUMN) + 1:]
    if not names:
        raise ToolError(f"{path} has no features behind the column {LAST_OTHER_COLUMN}; write it by recognize_files "
                        "--evidence")
    features = np.column_stack([table.numbers(name) for name in names])
    files, first, clips = np.unique(np.array(table.columns["file"]), return_index=True, return_inverse=True)
    words = np.array(table.columns[word_column], dtype=object)
    speakers = np.array(table.columns[speaker_column], dtype=object)
    for name, column in ((word_column, words), (speaker_column, speakers)):
        different = column != column[first][clips]
        if different.any():
            raise ToolError(f"{path}: {files[clips[different][0]]} has several values of {name}, must be one per file")
    truth = read_truth(words[first], labels, path)
    candidates = np.array(table.columns[LAST_OTHER_COLUMN], dtype=object)
    right = truth.is_command[clips] & (candidates == words)
    for kind, there in (("commands", truth.is_command), ("other speech", truth.is_other),
                        ("background", truth.is_background)):
        if not there.any():
            raise ToolError(f"{path} has no clips of {kind}: the confidence needs commands, other speech "
                            "and background")
    return EvidenceSet(str(path), names, features, candidates, clips, right, truth,
                       np.array([fold_of(speaker) for speaker in speakers[first]]))


def _fit(evidence, rows, ridge):
    rows = rows & (evidence.candidates != "")
    count = int(rows.sum())
    right = int((evidence.right & rows).sum())
    if right == 0 or right == count:
        raise ToolError(f"{evidence.path}: {right} of {count} candidates are right, must be some but not all; give "
                        "more clips, of more speakers")
    return fit(evidence.features[rows], evidence.right[rows], ridge)


def fit_all(evidence, ridge):
    """@throws ToolError"""
    return _fit(evidence, np.ones(len(evidence.clips), bool), ridge)


def cross_validated_logits(evidence, ridge):
    """Logit of each candidate by a fit to the clips of other speakers' folds. @throws ToolError"""
    folds = sorted(set(evidence.folds))
    if len(folds) < 2:
        raise ToolError(f"{evidence.path}: all speakers fall into one of {FOLDS} parts; give clips of more speakers")
    logits = np.empty(len(evidence.clips))
    for fold in folds:
        held_out = evidence.folds[evidence.clips] == fold
        logits[held_out] = _fit(evidence, ~held_out, ridge).logits(evidence.features[held_out])
    return logits


def clip_scores(evidence, logits):
    """@return (logit of each clip's best candidate, -inf where there is none; whether that one is right)"""
    logits = np.where(evidence.candidates == "", -np.inf, logits)
    best = np.full(len(evidence.truth.words), -np.inf)
    right = np.zeros(len(best), bool)
    for row in np.argsort(logits, kind="stable"):
        if np.isfinite(logits[row]):
            best[evidence.clips[row]], right[evidence.clips[row]] = logits[row], evidence.right[row]
    return best, right


def rates_at(evidence, best, right, threshold):
    accepted = best >= threshold
    truth = evidence.truth
    return Rates(float((accepted & right)[truth.is_command].mean()), float(accepted[truth.is_other].mean()),
                 float(accepted[truth.is_background].mean()))


def choose_threshold(evidence, best, right, max_false_other, max_false_background):
    """The lowest threshold of the logit with no more false alarms than that: half way to the best clip below, so that
    it lies on none. @throws ToolError if no command is left"""
    levels = np.unique(best[np.isfinite(best)])[::-1]  # from sure to unsure
    chosen = None
    for i, level in enumerate(levels):
        found = rates_at(evidence, best, right, level)
        if found.false_other > max_false_other or found.false_background > max_false_background:
            break
        chosen = level if i + 1 == len(levels) else 0.5 * (level + levels[i + 1])
    if chosen is None or rates_at(evidence, best, right, chosen).accuracy == 0.0:
        raise ToolError(f"{evidence.path}: no threshold keeps false alarms below {max_false_other:g} of other speech "
                        f"and {max_false_background:g} of background and accepts a command; allow more, or look at "
                        f"{name_some(evidence.names, 20)}")
    return float(chosen)


def held_out_rates(evidence, best, right, max_false_other, max_false_background):
    """Rates where each part of the speakers is judged by the threshold that the other parts choose.
    @param best, right  of cross-validated logits
    @throws ToolError as choose_threshold()"""
    accepted = np.zeros(len(best), bool)
    for fold in sorted(set(evidence.folds)):
        held_out = evidence.folds == fold
        others = np.where(held_out, -np.inf, best)
        level = choose_threshold(evidence, others, right & ~held_out,
                                 max_false_other * (~held_out & evidence.truth.is_other).sum()
                                 / evidence.truth.is_other.sum(),
                                 max_false_background * (~held_out & evidence.truth.is_background).sum()
                                 / evidence.truth.is_background.sum())
        accepted |= held_out & (best >= level)
    return rates_at(evidence, np.where(accepted, 1.0, -1.0), right, 0.0)
