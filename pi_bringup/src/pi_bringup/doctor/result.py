"""What a check found, and how checks are run: each with a limit of time."""

import queue
import threading
import traceback
from dataclasses import asdict, dataclass

OK, WARN, FAIL = "OK", "WARN", "FAIL"
LEVELS = (OK, WARN, FAIL)


@dataclass
class Result:
    check: str
    level: str
    text: str          # what is
    advice: str = ""   # what to do

    def line(self):
        return f"{self.level:<4} {self.check}: {self.text}" + (f"; {self.advice}" if self.advice else "")

    def as_dict(self):
        return asdict(self)


def ok(check, text):
    return Result(check, OK, text)


def warn(check, text, advice):
    return Result(check, WARN, text, advice)


def fail(check, text, advice):
    return Result(check, FAIL, text, advice)


def worst(results):
    return max((result.level for result in results), key=LEVELS.index, default=OK)


def run_check(name, function, limit_s):
    """Results of a check. One that takes too long is left behind and counts as failed, as one that raises does."""
    answers = queue.Queue()

    def work():
        try:
            found = function()
            answers.put(found if isinstance(found, list) else [found])
        except Exception as error:  # pylint: disable=broad-except
            place = traceback.extract_tb(error.__traceback__)[-1]
            answers.put([fail(name, f"the check itself failed: {type(error).__name__}: {error} "
                              f"({place.filename.rsplit('/', 1)[-1]}:{place.lineno})", "report it")])

    threading.Thread(target=work, daemon=True).start()
    try:
        return answers.get(timeout=limit_s)
    except queue.Empty:
        return [fail(name, f"not done within {limit_s:.0f} s", "look at what it asks; the computer may be overloaded")]
