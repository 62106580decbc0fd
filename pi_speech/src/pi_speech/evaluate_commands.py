"""Judges the commands that recognize_files recognised by what was said.

  evaluate_commands out.tsv [--output FOLDER]
  evaluate_commands 20.tsv 10.tsv 0.tsv --label "20 dB" --label "10 dB" --label "0 dB" --output FOLDER

The truth is the column "word", which recognize_files takes over from its list. Prints how many commands were accepted
and right, wrong or rejected, false alarms on other speech and background, and the same per command. In the folder:
figures.json, and per file the curve over the threshold, the confusions and the latencies as pictures. Exit status: 0;
1 if a file cannot be used; 2 for a wrong command line.
"""

import argparse
import json
import re
from pathlib import Path

from pi_speech import evaluation_report as report
from pi_speech.errors import ToolError, name_some, status_of
from pi_speech.evaluation import load_results
from pi_speech.truth import Labels


def names(text):
    """Names with commas between them."""
    found = tuple(name.strip() for name in text.split(","))
    if not all(found):
        raise argparse.ArgumentTypeError(f"'{text}', must be names with commas between them")
    return found


def whole_number(low, high):
    """A type for argparse."""
    def convert(text):
        value = int(text)
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text}, must be in [{low}, {high}]")
        return value
    convert.__name__ = "whole number"
    return convert


def add_labels(parser):
    """Options that say what the column of truth means."""
    parser.add_argument("--word-column", default="word", help="column of truth; default: %(default)s")
    parser.add_argument("--speaker-column", default="speaker", help="default: %(default)s")
    parser.add_argument("--other", type=names, default=Labels.other,
                        help=f"words of truth that stand for other speech; default: {','.join(Labels.other)}")
    parser.add_argument("--background", type=names, default=Labels.background,
                        help=f"that stand for no speech; default: {','.join(Labels.background)}")
    parser.add_argument("--commands", type=names, default=(),
                        help="all commands there may be in the column of truth; default: all other words in it")


def parse(arguments):
    parser = argparse.ArgumentParser(prog="evaluate_commands", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path, nargs="+", metavar="OUT.tsv", help="of recognize_files")
    parser.add_argument("--label", action="append", default=[],
                        help="name of each file, in their order; with \"10 dB\" and so on the curve over noise is "
                        "drawn")
    add_labels(parser)
    parser.add_argument("--safety-word", default="stop", help="command with figures of its own; default: %(default)s")
    parser.add_argument("--draws", type=whole_number(100, 1000000), default=2000,
                        help="of speakers, for the intervals; default: %(default)s")
    parser.add_argument("--seed", type=whole_number(0, 2**32 - 1), default=1, help="of the draws; default: %(default)s")
    parser.add_argument("--output", type=Path, metavar="FOLDER", help="write figures and pictures")
    parsed = parser.parse_args(arguments)
    if parsed.label and len(parsed.label) != len(parsed.results):
        parser.error(f"--label is given {len(parsed.label)} times for {len(parsed.results)} files, must be once "
                     "for each")
    labels = parsed.label or [path.stem for path in parsed.results]
    twice = sorted({label for label in labels if labels.count(label) > 1})
    if twice:
        parser.error(f"two files are called {name_some(twice)}; tell them apart by --label")
    parsed.label = labels
    return parsed


def _write(folder, all_results, entries):
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "figures.json").write_text(json.dumps(report.plain(entries), indent=2) + "\n")
    except OSError as error:
        raise ToolError(f"--output {folder}: {error.strerror or error}") from error
    stems = set()
    for results, entry in zip(all_results, entries):
        stem = re.sub(r"[^\w.+-]", "_", entry["label"])
        while stem in stems:
            stem += "_"
        stems.add(stem)
        report.plot_curve(results, entry, folder / f"{stem}_roc.png")
        report.plot_confusion(entry, folder / f"{stem}_confusion.png")
        report.plot_latency(results, entry, folder / f"{stem}_latency.png")
    if len(entries) > 1:
        report.plot_comparison(entries, folder / "comparison.png")


def run(arguments):
    labels = Labels(arguments.other, arguments.background, arguments.commands)
    all_results = [load_results(path, labels, label, arguments.word_column, arguments.speaker_column)
                   for path, label in zip(arguments.results, arguments.label)]
    entries = [report.figures(results, arguments.safety_word, arguments.draws, arguments.seed)
               for results in all_results]
    print("\n\n".join(report.text(entry) for entry in entries))
    if len(entries) > 1:
        print("\n" + report.comparison(entries))
    if arguments.output:
        _write(arguments.output, all_results, entries)


def main(arguments=None):
    """@return the exit status"""
    return status_of("evaluate_commands", lambda: run(parse(arguments)))
