"""Judges recognised commands by what was said."""

from dataclasses import dataclass

import numpy as np

from pi_speech.errors import ToolError
from pi_speech.tables import read_table
from pi_speech.truth import Truth, read_truth

REJECTED = "rejected"
DIFFERENT = "another"  # command that no clip is of
BY_CONFIDENCE = "confidence"  # a reason that begins so depends on the threshold


@dataclass
class Results:
    """What was recognised, one entry per clip."""

    label: str
    truth: Truth
    texts: np.ndarray        # the command that fits best; "" where there is none
    confidences: np.ndarray  # in [0, 1]
    accepted: np.ndarray
    possible: np.ndarray     # accepted, or rejected for the confidence only
    latencies_ms: np.ndarray  # nan where unknown
    speakers: np.ndarray     # None if the file has none

    @property
    def right(self):
        """Clips whose command fits best, accepted or not."""
        return self.truth.is_command & (self.texts == self.truth.words)


def load_results(path, labels, label, word_column="word", speaker_column="speaker"):
    """@throws ToolError"""
    table = read_table(path, ["text", "confidence", "accepted", "reason", "latency_ms", word_column])
    truth = read_truth(table.columns[word_column], labels, path)
    texts = np.array(table.columns["text"], dtype=object)
    accepted = table.flags("accepted")
    for row in np.flatnonzero(accepted & (texts == "")):
        raise ToolError(f"{path}:{row + 2}: accepted, but text is empty")
    by_confidence = np.array([reason.startswith(BY_CONFIDENCE) for reason in table.columns["reason"]])
    speakers = table.columns.get(speaker_column)
    return Results(label, truth, texts, table.numbers("confidence", 0.0, 1.0), accepted,
                   accepted | by_confidence & (texts != ""), table.numbers("latency_ms", nan=True),
                   None if speakers is None else np.array(speakers, dtype=object))


def share(part, of):
    """Share of the clips `of` that are `part`; nan if there are none."""
    count = int(np.count_nonzero(of))
    return float(np.count_nonzero(part & of)) / count if count else float("nan")


def rates(results, accepted=None):
    """The shares that matter, where `accepted` were (default: those of the file)."""
    accepted = results.accepted if accepted is None else accepted
    truth = results.truth
    return {
        "accuracy": share(accepted & results.right, truth.is_command),
        "wrong": share(accepted & ~results.right, truth.is_command),
        "rejected": share(~accepted, truth.is_command),
        "false_other": share(accepted, truth.is_other),
        "false_background": share(accepted, truth.is_background),
        "closed_accuracy": share(results.right, truth.is_command),
    }


def per_word(results):
    """Rates of each command, with the commands that it is taken for and how many others are taken for it."""
    truth, table = results.truth, {}
    for word in truth.commands:
        here = truth.words == word
        takes = results.accepted & (results.texts == word)
        wrong = results.accepted & here & (results.texts != word)
        names, counts = np.unique(results.texts[wrong].astype(str), return_counts=True)
        order = np.argsort(-counts, kind="stable")
        table[word] = {
            "clips": int(here.sum()),
            "recall": share(takes, here),
            "wrong": share(wrong, here),
            "rejected": share(~results.accepted, here),
            "precision": share(here, takes),
            "taken_for": {str(names[i]): int(counts[i]) for i in order},
        }
    return table


def one_command(results, word):
    """Recall of one command that matters more than the others, and what is taken for it."""
    truth = results.truth
    here = truth.words == word
    takes = results.accepted & (results.texts == word)
    known = np.isfinite(results.latencies_ms) & takes & here
    return {
        "word": word,
        "clips": int(here.sum()),
        "recall": share(takes, here),
        "taken_for_others": share(results.accepted & (results.texts != word), here),
        "rejected": share(~results.accepted, here),
        "false_commands": share(takes, truth.is_command & ~here),
        "false_other": share(takes, truth.is_other),
        "false_background": share(takes, truth.is_background),
        "latency_median_ms": float(np.median(results.latencies_ms[known])) if known.any() else float("nan"),
    }


def operating_curve(results):
    """Rates over the threshold of the confidence, from strict to lax: dict of arrays with `threshold`, `accuracy`,
    `wrong`, `false_other`, `false_background`. What was rejected for another reason stays rejected."""
    truth = results.truth
    order = np.argsort(-results.confidences, kind="stable")
    confidences = results.confidences[order]
    last = np.append(confidences[1:] != confidences[:-1], True)  # of equal confidences: they are accepted together

    def curve(part, of):
        count = np.count_nonzero(of)
        passed = np.cumsum((part & of & results.possible)[order])[last]
        values = passed / count if count else np.full(len(passed), np.nan)
        return np.concatenate([values[:1] * 0.0, values])

    everything = np.ones(len(order), bool)
    return {
        "threshold": np.concatenate([[np.nextafter(confidences[0], np.inf)], confidences[last]]),
        "accuracy": curve(results.right, truth.is_command),
        "wrong": curve(~results.right, truth.is_command),
        "false_other": curve(everything, truth.is_other),
        "false_background": curve(everything, truth.is_background),
    }


def confusion(results):
    """@return (names of rows, names of columns, counts). Rows: commands, "other speech", "background"; columns:
    commands, another one if there is any, rejected. Rows without clips are left out."""
    truth = results.truth
    columns = truth.commands + [DIFFERENT, REJECTED]
    said = np.where(truth.is_other, "other speech", np.where(truth.is_background, "background", truth.words))
    known = np.isin(results.texts, truth.commands)
    heard = np.where(~results.accepted, REJECTED, np.where(known, results.texts, DIFFERENT))
    rows = [name for name in truth.commands + ["other speech", "background"] if (said == name).any()]
    counts = np.array([[int(((said == row) & (heard == column)).sum()) for column in columns] for row in rows])
    if not counts[:, -2].any():
        counts = np.delete(counts, -2, axis=1)
        columns.remove(DIFFERENT)
    return rows, columns, counts


def by_speaker(results, draws, seed):
    """How far the figures would be others with other speakers: 95 % intervals by drawing speakers with replacement
    (Efron 1979), and the spread of accuracy over speakers.
    @return None if the file has no speakers"""
    if results.speakers is None:
        return None
    truth = results.truth
    speakers, index = np.unique(results.speakers.astype(str), return_inverse=True)
    parts = {
        "accuracy": (results.accepted & results.right, truth.is_command),
        "wrong": (results.accepted & ~results.right, truth.is_command),
        "false_other": (results.accepted, truth.is_other),
        "false_background": (results.accepted, truth.is_background),
    }
    drawn = np.random.default_rng(seed).multinomial(len(speakers), np.full(len(speakers), 1.0 / len(speakers)), draws)
    intervals, spread = {}, {}
    for name, (part, of) in parts.items():
        hits = np.bincount(index, part & of, len(speakers))
        totals = np.bincount(index, of, len(speakers))
        with np.errstate(invalid="ignore", divide="ignore"):
            values = (drawn @ hits) / (drawn @ totals)
        values = values[np.isfinite(values)]
        intervals[name] = [float(v) for v in np.percentile(values, [2.5, 97.5])] if len(values) else [np.nan, np.nan]
        if name == "accuracy" and totals.any():
            each = hits[totals > 0] / totals[totals > 0]
            spread = {"speakers": int((totals > 0).sum()),
                      **{f"p{p}": float(np.percentile(each, p)) for p in (10, 25, 50, 75, 90)}}
    return {"draws": draws, "seed": seed, "intervals_95": intervals, "accuracy_of_speakers": spread}
