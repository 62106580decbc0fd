"""Reads the CSV of simulate: one line per scenario, policy, price of a miss and seed."""

import csv
import math
from dataclasses import dataclass

from pi_offload.errors import ToolError

KEYS = ("scenario", "policy", "lambda", "seed")
NEEDED = KEYS + ("power_w", "local_w", "fallback_w", "radio_w", "detection_missed", "speech_missed")


@dataclass
class Case:
    """A policy with its price of a miss in a scenario, over the seeds."""

    scenario: str
    policy: str
    price_j: float
    figures: dict  # name -> list of values, one per seed

    def mean(self, name):
        values = self.figures[name]
        return sum(values) / len(values)

    def deviation(self, name):
        """Standard deviation over the seeds; 0 with one seed."""
        values = self.figures[name]
        if len(values) < 2:
            return 0.0
        mean = self.mean(name)
        return math.sqrt(sum((value - mean) ** 2 for value in values) / (len(values) - 1))


def _number(path, line, name, text):
    try:
        value = float(text)
    except (TypeError, ValueError):
        value = math.nan
    if not math.isfinite(value) and text not in ("inf", "Infinity"):
        raise ToolError(f"{path}:{line}: {name} = {text!r}, must be a number")
    return value


def read_cases(path):
    """@return cases in the order of the file
    @throws ToolError if the file cannot be read, or is no table of simulate"""
    try:
        with open(path, encoding="utf-8", newline="") as file:
            reader = csv.DictReader(file)
            names = reader.fieldnames or []
            missing = [name for name in NEEDED if name not in names]
            if missing:
                raise ToolError(f"{path} has no column {', '.join(missing)}: is it of simulate --csv?")
            cases = {}
            for row in reader:
                if None in row or None in row.values():
                    raise ToolError(f"{path}:{reader.line_num}: not as many columns as in the first line")
                price = _number(path, reader.line_num, "lambda", row["lambda"])
                case = cases.setdefault((row["scenario"], row["policy"], price),
                                        Case(row["scenario"], row["policy"], price, {}))
                for name in names:
                    if name not in KEYS:
                        case.figures.setdefault(name, []).append(_number(path, reader.line_num, name, row[name]))
    except OSError as error:
        raise ToolError(f"{path}: {error.strerror or error}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise ToolError(f"{path} is no table: {error}") from error
    if not cases:
        raise ToolError(f"{path} has no runs, only the names of columns")
    return list(cases.values())
