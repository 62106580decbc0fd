"""Programs run as children, with a limit of time."""

import os
import signal
import subprocess
from dataclasses import dataclass


@dataclass
class Ended:
    started: bool         # False: there is no such program
    in_time: bool = True  # False: it was killed
    status: int = 0       # negative: of the signal
    output: str = ""      # both of its outputs

    @property
    def good(self):
        return self.started and self.in_time and self.status == 0

    def last_line(self):
        lines = [line.strip() for line in self.output.splitlines() if line.strip()]
        return lines[-1] if lines else ""

    def why(self):
        """In words, why it is not good."""
        if not self.started:
            return "is not installed"
        if not self.in_time:
            return "did not end in time"
        ended = f"signal {-self.status}" if self.status < 0 else f"status {self.status}"
        return (self.last_line() or "no output") + f" ({ended})"


def run(command, limit_s, environment=None, text=""):
    """Runs a program to its end or that of its time; its children end with it. @param text  its standard input."""
    variables = {key: value for key, value in os.environ.items() if key != "LD_PRELOAD"}
    variables.update(environment or {})
    try:
        process = subprocess.Popen([str(word) for word in command], env=variables, stdin=subprocess.PIPE,
                                   stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True,
                                   text=True, errors="replace")
    except OSError:
        return Ended(started=False)
    try:
        output, _ = process.communicate(text, timeout=limit_s)
        return Ended(True, True, process.returncode, output)
    except subprocess.TimeoutExpired:
        try:
            os.killpg(process.pid, signal.SIGKILL)
        except ProcessLookupError:
            pass
        process.wait()
        process.stdin.close()
        process.stdout.close()
        return Ended(True, False)
