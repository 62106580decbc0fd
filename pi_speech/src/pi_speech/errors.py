"""The error that a tool reports in one line."""

import sys
from subprocess import CalledProcessError


class ToolError(Exception):
    """What cannot be done and why: names object, value and way out."""


def name_some(names, most=5):
    """The first few of a list, for an error."""
    names = list(names)
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def status_of(tool, run):
    """Calls it. @return the exit status: 0; 1 if something cannot be used or fails, which is told; 130 by Ctrl-C"""
    try:
        run()
        return 0
    except ToolError as error:
        said = error
    except CalledProcessError as error:
        said = f"{error.cmd[0]} ended with status {error.returncode}"
    except OSError as error:
        said = f"{error.filename}: {error.strerror}" if error.filename else error
    except KeyboardInterrupt:
        return 130
    print(f"{tool}: {said}", file=sys.stderr)
    return 1
