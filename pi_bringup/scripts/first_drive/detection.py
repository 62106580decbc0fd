"""pi_detect's part of the demo: objects in some pictures of a video."""

from .errors import DemoError
from .localisation import run_program

VIDEO = "/usr/share/doc/opencv-doc/examples/data/vtest.avi"  # pedestrians
EVERY = 100  # picture of it


def drawn_folder(output):
    return output / "detections"


def detect(started, prefix, output):
    """Runs the suite's own network. @return (lines for the report, pictures with boxes)"""
    program = prefix / "lib" / "pi_detect" / "detect_images"
    if not program.is_file():
        raise DemoError("%s is missing; build and install pi_detect" % program)
    log_path = output / "log" / "detect_images.log"
    log_path.unlink(missing_ok=True)
    overlay = drawn_folder(output)
    for old in overlay.glob("*.jpg"):
        old.unlink()
    printed = run_program(started, [program, VIDEO, "--every", EVERY, "--output", output / "detections.json",
                                    "--overlay", overlay, "--quiet"], log_path)
    lines = [line for line in printed.splitlines() if line.startswith("model ") or " objects, " in line]
    return lines, sorted(overlay.glob("*.jpg"))
