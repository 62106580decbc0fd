"""pi_slam's part of the demo: a drive to play where there is no recording, and where the vehicle was on it."""

import re
import shutil

from .errors import DemoError
from .processes import log_excerpt


def run_program(started, command, log_path):
    """Waits for its end. @return what it printed. @throws DemoError if it failed."""
    process = started.start(command, log_path)
    if process.wait() != 0:
        raise DemoError("%s failed with status %d:\n%s" % (command[0], process.returncode, log_excerpt(log_path)))
    started.stop(process)
    return log_path.read_text(errors="replace")


def program(prefix, name):
    path = prefix / "lib" / "pi_slam" / name
    if not path.is_file():
        raise DemoError("%s is missing; build and install pi_slam" % path)
    return path


def convert(started, prefix, source, bag, *options):
    """Writes a recording or a video to `bag`. @return the bag. @throws DemoError"""
    log_path = bag.with_suffix(".log")
    log_path.unlink(missing_ok=True)
    run_program(started, [prefix / "lib/pi_bringup/recording_to_bag", "--force", *options, source, bag], log_path)
    return bag


def render_drive(started, prefix, seconds, output):
    """Renders a campus street with its cameras and IMU. @return the recording's folder."""
    folder = output / "drive"
    log_path = output / "log" / "render_sequence.log"
    log_path.unlink(missing_ok=True)
    run_program(started, [program(prefix, "render_sequence"), "--path", "campus_loop", "--duration", seconds,
                          "--start-standstill", "1", "--force", folder], log_path)
    return folder


def localise(started, prefix, recording, output):
    """Odometry and map offline. @return lines for the report."""
    log_path = output / "log" / "evaluate_sequence.log"
    log_path.unlink(missing_ok=True)
    trajectory = output / "localisation_tum.txt"
    printed = run_program(started, [program(prefix, "evaluate_sequence"), recording, "--map", "--output", trajectory,
                                    "--plot", output / "localisation.png"], log_path)
    wanted = re.compile(r"^(pairs|start|speed|map) |^odometry after|^time per| (total|ATE SE3) |^ +position")
    lines = [line for line in printed.splitlines() if wanted.search(line)]
    # The rows of odometry after each pair are what counts; those that follow repeat them at other rates.
    end = next((index + 1 for index, line in enumerate(lines) if "ATE SE3" in line), len(lines))
    return lines[:end]


def remove_drive(output):
    shutil.rmtree(output / "drive", ignore_errors=True)
