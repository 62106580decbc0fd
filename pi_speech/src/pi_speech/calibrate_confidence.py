"""Fits the weights of the confidence to clips of commands, other speech and background.

  recognize_files LIST.tsv --output results.tsv --evidence evidence.tsv --word-network none
  calibrate_confidence --evidence evidence.tsv --output confidence.yaml

The weights are those of a logistic regression with a ridge: is the candidate what was said? Figures are
cross-validated: each clip is judged by weights and a threshold that come from the speakers of the other parts,
crc32(speaker) % 5. The bias is moved so
that the lowest threshold that keeps both limits of false alarms, less the margin, becomes --threshold, that of the
recogniser.
Exit status: 0; 1 if a file cannot be used; 2 for a wrong command line.
"""

import argparse
import os
from pathlib import Path

import numpy as np

from pi_speech import plots
from pi_speech.calibration import (FOLDS, choose_threshold, clip_scores, cross_validated_logits, fit_all, held_out_rates,
                                   load_evidence, rates_at)
from pi_speech.errors import ToolError, status_of
from pi_speech.evaluate_commands import add_labels
from pi_speech.logistic_regression import Logistic
from pi_speech.truth import Labels

def number_between(low, high):
    """A type for argparse: low < number < high."""
    def convert(text):
        value = float(text)
        if not low < value < high:
            raise argparse.ArgumentTypeError(f"{text}, must be between {low:g} and {high:g}")
        return value
    convert.__name__ = "number"
    return convert


def parse(arguments):
    parser = argparse.ArgumentParser(prog="calibrate_confidence", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--evidence", type=Path, required=True, metavar="EVIDENCE.tsv",
                        help="of recognize_files --evidence --word-network none")
    parser.add_argument("--output", type=Path, required=True, metavar="confidence.yaml", help="file to write")
    parser.add_argument("--plot", type=Path, metavar="FILE.png", help="draw right commands over false alarms")
    parser.add_argument("--max-false-other", type=number_between(0, 1), default=0.06,
                        help="share of clips of other speech that may be accepted; default: %(default)s")
    parser.add_argument("--max-false-background", type=number_between(0, 1), default=0.03,
                        help="the same of background; default: %(default)s")
    parser.add_argument("--margin", type=float, default=0.1,
                        help="part of both limits that is kept free for speakers not heard yet, in [0, 1); default: "
                        "%(default)s")
    parser.add_argument("--threshold", type=number_between(0, 1), default=0.5,
                        help="confidence at which the recogniser accepts; default: %(default)s")
    parser.add_argument("--ridge", type=number_between(0, 1e9), default=10.0,
                        help="weight of the squares of the weights; default: %(default)s")
    add_labels(parser)
    parsed = parser.parse_args(arguments)
    if not 0.0 <= parsed.margin < 1.0:
        parser.error(f"--margin {parsed.margin:g}, must be in [0, 1)")
    return parsed


class Calibrated:
    """The weights and how well they do."""

    def __init__(self, path, arguments):
        labels = Labels(arguments.other, arguments.background, arguments.commands)
        self.evidence = load_evidence(path, labels, arguments.word_column, arguments.speaker_column)
        self.best, self.right = clip_scores(self.evidence, cross_validated_logits(self.evidence, arguments.ridge))
        free = 1.0 - arguments.margin
        self.threshold = choose_threshold(self.evidence, self.best, self.right, free * arguments.max_false_other,
                                          free * arguments.max_false_background)
        self.rates = rates_at(self.evidence, self.best, self.right, self.threshold)
        self.held_out = held_out_rates(self.evidence, self.best, self.right, free * arguments.max_false_other,
                                       free * arguments.max_false_background)
        fitted = fit_all(self.evidence, arguments.ridge)
        wanted = float(np.log(arguments.threshold / (1.0 - arguments.threshold)))
        self.model = Logistic(fitted.weights, fitted.bias + wanted - self.threshold)

    def summary(self):
        truth, rates = self.evidence.truth, self.held_out
        return (f"{int(truth.is_command.sum())} commands: {100 * rates.accuracy:.1f} % accepted and right, "
                f"{100 * float(self.right[truth.is_command].mean()):.1f} % right in all; "
                f"false alarms: {100 * rates.false_other:.1f} % of {int(truth.is_other.sum())} of other speech, "
                f"{100 * rates.false_background:.1f} % of {int(truth.is_background.sum())} of background")


def yaml_text(calibrated, arguments):
    lines = ["# Weights of the confidence that a command was said, by calibrate_confidence: logistic regression, ridge "
             f"{arguments.ridge:g}.",
             f"# Confidence {arguments.threshold:g} is where false alarms keep below {arguments.max_false_other:g} of "
             f"other speech and {arguments.max_false_background:g} of",
             f"# background, less a margin of {100 * arguments.margin:g} %. Figures are cross-validated over speakers, "
             f"in {FOLDS} parts.",
             "", f"# From {Path(calibrated.evidence.path).name}:",
             *(f"#   {part}" for part in calibrated.summary().split("; ")), f"bias: {calibrated.model.bias:.6g}",
             *(f"{feature}: {weight:.6g}" for feature, weight in zip(calibrated.evidence.names,
                                                                     calibrated.model.weights))]
    return "\n".join(lines) + "\n"


def plot(calibrated, path):
    """@throws ToolError"""
    pyplot = plots.pyplot()
    figure, axes = pyplot.subplots(figsize=(7, 5))
    best, right = calibrated.best, calibrated.right
    levels = np.sort(best[np.isfinite(best)])[::-1]
    points = [rates_at(calibrated.evidence, best, right, level) for level in levels]
    accuracy = [100 * point.accuracy for point in points]
    for field, title, style in (("false_other", "other speech", "-"), ("false_background", "background", "--")):
        line, = axes.plot([100 * getattr(point, field) for point in points], accuracy, style, label=title,
                          drawstyle="steps-post")
        axes.plot([100 * getattr(calibrated.rates, field)], [100 * calibrated.rates.accuracy], "o",
                  color=line.get_color())
    axes.set(xlim=(0, 50), ylim=(0, 102), xlabel="false alarms [% of clips]", ylabel="commands accepted and right [%]",
             title="cross-validated over speakers (dots: the threshold chosen from all)")
    axes.grid(alpha=0.3)
    axes.legend(frameon=False, fontsize=9)
    plots.save(figure, path)


def write_complete(path, content):
    """The file appears when it is complete; what is no file, as /dev/stdout, is written to as it is.
    @throws ToolError"""
    try:
        if path.exists() and not path.is_file():
            path.write_text(content)
            return
        partial = path.with_name(path.name + ".partial")
        partial.write_text(content)
        os.replace(partial, path)
    except OSError as error:
        raise ToolError(f"{path}: cannot be written: {error.strerror or error}") from error


def run(arguments):
    calibrated = Calibrated(arguments.evidence, arguments)
    print(f"confidence: {calibrated.summary()}")
    if arguments.plot:
        plot(calibrated, arguments.plot)
    write_complete(arguments.output, yaml_text(calibrated, arguments))


def main(arguments=None):
    """@return the exit status"""
    return status_of("calibrate_confidence", lambda: run(parse(arguments)))
