"""Drives in processes of their own: rospy knows one graph in a process."""

import json
import signal
import subprocess
import sys

from first_drive.errors import DemoError


def drive_apart(program, words, folder, follow=False):
    """A drive with its report as report.txt in the folder. @param program  drive_campus, as the space has it.
    @param words  the command line but for --output. @param follow  show how it goes. @return its status"""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "drive_campus.json").unlink(missing_ok=True)
    with open(folder / "report.txt", "w", encoding="utf-8") as log:
        child = subprocess.Popen([sys.executable, str(program), *words, "--output", str(folder)],
                                 stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                                 text=True, encoding="utf-8", errors="replace")
        try:
            for line in child.stdout:
                log.write(line)
                follow = follow and not line.startswith("Drive ")  # its report
                if follow and line.startswith("  "):
                    print(line, end="")
            return child.wait()
        except BaseException:
            child.send_signal(signal.SIGINT)  # it ends its nodes
            child.wait()
            raise


def result_of(folder, status):
    """The tree of a drive in a process of its own. @throws DemoError with the first thing that it said went wrong."""
    try:
        return json.loads((folder / "drive_campus.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        text = (folder / "report.txt").read_text(encoding="utf-8", errors="replace").strip().splitlines()
        wrong = next((index for index, line in enumerate(text) if line.startswith("drive_campus: ")), len(text) - 1)
        reason = text[wrong] if text else "status %d" % status
        if reason.endswith(":") and wrong + 1 < len(text):  # then the first error of a log follows
            reason += " " + text[wrong + 1].strip()
        raise DemoError("no drive: %s" % reason) from None
