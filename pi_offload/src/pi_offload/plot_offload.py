"""Draws what simulate found.

  simulate --scenario dense_light.yaml --policy all --lambda 2,5,10,20,50,100 --csv dense_light.csv
  plot_offload dense_light.csv [more.csv...] --output FOLDER

Per scenario: SCENARIO_frontier.png, power against missed deadlines with the prices of a miss as a line, and
SCENARIO_policies.png, power by its parts and misses of each policy. Exit status: 0; 1 if a file cannot be used; 2 for a
wrong command line.
"""

import argparse
import re
import sys
from pathlib import Path

from pi_offload.errors import ToolError
from pi_offload.simulation_table import read_cases

LEAST_PERCENT = 1e-3  # what is drawn for no miss at all: the axis is logarithmic


def pyplot():
    """@throws ToolError if matplotlib is not installed"""
    try:
        import matplotlib
        matplotlib.use("Agg")
        from matplotlib import pyplot as module
    except ImportError as error:
        raise ToolError("matplotlib is not installed (Debian: python3-matplotlib)") from error
    return module


def save(figure, path):
    """@throws ToolError"""
    try:
        figure.savefig(path, dpi=110, bbox_inches="tight")
    except (OSError, ValueError) as error:
        raise ToolError(f"{path}: {error}") from error
    finally:
        pyplot().close(figure)


def percent(case, name):
    return 100.0 * case.mean(name)


def families(cases):
    """Cases by policy, those with several prices in the order of the price."""
    by_policy = {}
    for case in cases:
        by_policy.setdefault(case.policy, []).append(case)
    for group in by_policy.values():
        group.sort(key=lambda case: case.price_j)
    return by_policy


def plot_frontier(scenario, cases, path):
    """Power against missed detections."""
    figure, axes = pyplot().subplots(figsize=(7.5, 5.0))
    for policy, group in families(cases).items():
        x = [max(percent(case, "detection_missed"), LEAST_PERCENT) for case in group]
        y = [case.mean("power_w") for case in group]
        spread = [case.deviation("power_w") for case in group]
        axes.errorbar(x, y, yerr=spread, fmt="o-" if len(group) > 1 else "o", capsize=2, label=policy)
        if len(group) > 1:
            for from_last, (case, at_x, at_y) in enumerate(reversed(list(zip(group, x, y)))):
                axes.annotate(f"{case.price_j:g} J", (at_x, at_y), xytext=(0, 14 if from_last % 2 == 0 else -20),
                              textcoords="offset points", ha="center", fontsize=8)
    axes.set_xscale("log")
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel(f"missed detections [%]; none is drawn at {LEAST_PERCENT:g}")
    axes.set_ylabel("power of the tasks [W]")
    axes.set_title(f"{scenario}: power against misses; bars: standard deviation over seeds")
    axes.grid(True, which="both", alpha=0.3)
    axes.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.01, 1.0))
    save(figure, path)


def plot_policies(scenario, cases, path):
    """Power by its parts, and misses below it."""
    labels = [case.policy + (f"\n{case.price_j:g} J" if len(group) > 1 else "")
              for group in families(cases).values() for case in group]
    cases = [case for group in families(cases).values() for case in group]
    figure, (power, misses) = pyplot().subplots(2, 1, sharex=True, figsize=(max(6.0, 1.0 * len(cases)), 6.0))
    at = range(len(cases))
    bottom = [0.0] * len(cases)
    for name, label in (("radio_w", "radio"), ("local_w", "vehicle, decided so"), ("fallback_w", "vehicle, fallback")):
        values = [case.mean(name) for case in cases]
        power.bar(at, values, bottom=bottom, label=label)
        bottom = [low + value for low, value in zip(bottom, values)]
    for x, top in zip(at, bottom):
        power.annotate(f"{top:.2f}", (x, top), ha="center", va="bottom", fontsize=8)
    power.set_ylabel("power [W]")
    power.margins(y=0.12)  # room for the figures
    power.set_title(scenario)
    power.legend(fontsize=8)
    for offset, name, label in ((-0.2, "detection_missed", "detection"), (0.2, "speech_missed", "speech")):
        values = [percent(case, name) for case in cases]
        misses.bar([x + offset for x in at], [max(value, LEAST_PERCENT) for value in values], width=0.4, label=label)
        for x, value in zip(at, values):
            misses.annotate(f"{value:.2g}", (x + offset, max(value, LEAST_PERCENT)), ha="center", va="bottom",
                            fontsize=7)
    misses.set_yscale("log")
    misses.set_ylim(0.5 * LEAST_PERCENT, 3.0 * misses.get_ylim()[1])
    misses.set_ylabel("missed deadlines [%]")
    misses.set_xticks(list(at))
    misses.set_xticklabels(labels, rotation=30, ha="right", fontsize=8)
    misses.legend(fontsize=8)
    save(figure, path)


def parse(arguments):
    parser = argparse.ArgumentParser(prog="plot_offload", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tables", type=Path, nargs="+", metavar="RUNS.csv", help="of simulate --csv")
    parser.add_argument("--output", type=Path, required=True, metavar="FOLDER", help="where the pictures go")
    return parser.parse_args(arguments)


def run(arguments):
    """@throws ToolError"""
    scenarios = {}
    for path in arguments.tables:
        for case in read_cases(path):
            known = scenarios.setdefault(case.scenario, [])
            if any(other.policy == case.policy and other.price_j == case.price_j for other in known):
                raise ToolError(f"{path}: {case.policy} with {case.price_j:g} J in {case.scenario} was in a table "
                                "before; give each one once")
            known.append(case)
    try:
        arguments.output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ToolError(f"--output {arguments.output}: {error.strerror or error}") from error
    for scenario, cases in scenarios.items():
        stem = re.sub(r"[^\w.+-]", "_", scenario)
        plot_frontier(scenario, cases, arguments.output / f"{stem}_frontier.png")
        plot_policies(scenario, cases, arguments.output / f"{stem}_policies.png")
        print(f"{arguments.output}: {stem}_frontier.png, {stem}_policies.png")


def main(arguments=None):
    """@return the exit status"""
    try:
        run(parse(arguments))
    except ToolError as error:
        print(f"plot_offload: {error}", file=sys.stderr)
        return 1
    return 0
