"""What the programs of drives share: their end by a signal or an error, and the check of their space."""

import argparse
import contextlib
import os
import signal
import sys
import traceback
from pathlib import Path

from .errors import DemoError, Interrupted

NAME = Path(sys.argv[0]).name
PREFIX = Path(sys.argv[0]).resolve().parents[2]  # devel or install space: a program is lib/pi_bringup/NAME in it
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def number_from(least):
    """Type of an option of argparse: a whole number."""
    def read(text):
        value = int(text)
        if value < least:
            raise argparse.ArgumentTypeError("%s, must be at least %d" % (text, least))
        return value
    read.__name__ = "number"  # for argparse's message
    return read


def positive(text):
    """Type of an option of argparse."""
    value = float(text)
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError("%s, must be above 0" % text)
    return value


def prepare_output(output):
    """Makes the folder of the report and its logs, and proves that it can be written to. @throws DemoError"""
    try:
        (output / "log").mkdir(parents=True, exist_ok=True)
        (output / "log" / (NAME + ".log")).touch()  # rospy's own log, opened by it later
    except OSError as error:
        raise DemoError("the report cannot be written to %s: %s; choose another folder with --output" %
                        (output, error.strerror)) from error


def main(act, failure=1):
    """Ends this process with the status of act(clean_up), a contextlib.ExitStack that is closed at the end.
    The status is `failure` behind an error, 128 + number behind a signal."""
    sys.stdout.reconfigure(line_buffering=True, errors="replace")
    status = _run(act, failure)
    sys.stdout.flush()
    os._exit(status)  # rospy leaves threads behind that would wait for nodes that are gone


def _run(act, failure):
    def interrupt(number, _):
        raise Interrupted(number)

    clean_up = contextlib.ExitStack()
    try:
        for number in SIGNALS:
            signal.signal(number, interrupt)
        if not (PREFIX / "setup.sh").is_file():
            raise DemoError("%s is no devel or install space, it has no setup.sh; start %s with rosrun" % (PREFIX, NAME))
        return act(clean_up)
    except DemoError as error:
        print("%s: %s" % (NAME, error), file=sys.stderr)
        return failure
    except Interrupted as interruption:
        print("\n%s: interrupted, ending the nodes" % NAME, file=sys.stderr)
        return 128 + interruption.number
    except Exception:
        traceback.print_exc()
        return failure
    finally:
        for number in SIGNALS:
            signal.signal(number, signal.SIG_IGN)  # the clean-up is bounded; a second Ctrl-C must not break it
        clean_up.close()
