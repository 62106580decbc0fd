"""Reads the tables of recognize_files: one line per clip, tabs between columns, names in the first line."""

import math
from dataclasses import dataclass

import numpy as np

from pi_speech.errors import ToolError, name_some


@dataclass
class Table:
    """Columns of a file; all have as many rows, at least one."""

    path: str
    names: list   # of the columns, in order
    columns: dict  # name -> list of texts

    def __len__(self):
        return len(self.columns[self.names[0]])

    def numbers(self, name, low=-math.inf, high=math.inf, nan=False):
        """A column as floats. @throws ToolError naming file, line and value, if one is none or out of [low, high]"""
        values = np.empty(len(self))
        for row, text in enumerate(self.columns[name]):
            try:
                value = float(text)
            except ValueError:
                value = None
            good = value is not None and (low <= value <= high and math.isfinite(value) or nan and math.isnan(value))
            if not good:
                free = math.isinf(low) and math.isinf(high)
                bound = "a finite number" if free else f"a number in [{low:g}, {high:g}]"
                raise ToolError(f"{self.path}:{row + 2}: {name} = {text!r}, must be {bound}")
            values[row] = value
        return values

    def flags(self, name):
        """A column of yes and no as booleans. @throws ToolError"""
        for row, text in enumerate(self.columns[name]):
            if text not in ("yes", "no"):
                raise ToolError(f"{self.path}:{row + 2}: {name} = {text!r}, must be yes or no")
        return np.array([text == "yes" for text in self.columns[name]])


def read_table(path, needed):
    """@param needed  columns that must be there
    @throws ToolError if the file cannot be read, is empty, lacks a column, or a line has too few or too many"""
    try:
        with open(path, encoding="utf-8") as file:
            lines = file.read().splitlines()
    except OSError as error:
        raise ToolError(f"{path}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise ToolError(f"{path} is no text: {error}") from error
    if not lines:
        raise ToolError(f"{path} is empty: is it the output of recognize_files?")
    names = lines[0].split("\t")
    missing = [name for name in needed if name not in names]
    if missing:
        raise ToolError(f"{path} has no column {name_some(missing)}; its columns are {name_some(names, 20)}. Columns "
                        "of truth come from the list that recognize_files is given")
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ToolError(f"{path} has column {name_some(twice)} twice")
    rows = [line.split("\t") for line in lines[1:]]
    for number, row in enumerate(rows, 2):
        if len(row) != len(names):
            raise ToolError(f"{path}:{number}: {len(row)} columns, must be {len(names)} as in the first line")
    if not rows:
        raise ToolError(f"{path} has no clips, only the names of columns")
    return Table(str(path), names, {name: [row[i] for row in rows] for i, name in enumerate(names)})
