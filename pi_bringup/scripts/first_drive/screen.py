"""The display that the drive is shown on, and pictures of it."""

import os
import subprocess

from first_drive.errors import DemoError

LIMIT_S = 60  # of a program that looks at a window
RVIZ = " - RViz\""  # with the name of its configuration: before, the window is there and cannot be taken


class Screen:
    """The display of the user or, without DISPLAY, a virtual one."""

    def __init__(self, processes, output):
        self.output = output
        self.environment = processes.environment
        display = os.environ.get("DISPLAY", "")
        self.virtual = not display
        if self.virtual:
            # Two screens: without a window manager both windows would lie on top of each other.
            number = processes.start_announced(
                "Xvfb", ["Xvfb", "-screen", "0", "1600x900x24", "-screen", "1", "800x640x24", "-nolisten",
                         "tcp", "-displayfd"], output / "log" / "xvfb.log")
            self.rviz_display = ":%s.0" % number
            self.view_display = ":%s.1" % number
            self.environment["LIBGL_ALWAYS_SOFTWARE"] = "1"
        else:
            self.rviz_display = self.view_display = display
            if self._run(["xwininfo", "-root"], display).returncode != 0:
                raise DemoError("DISPLAY=%s cannot be opened; unset DISPLAY to use a virtual one" % display)

    def _run(self, command, display):
        try:
            return subprocess.run(command, env=dict(self.environment, DISPLAY=display), stdin=subprocess.DEVNULL,
                                  stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=LIMIT_S)
        except subprocess.TimeoutExpired:
            said = "%s did not end for %d s; is the computer too busy?" % (" ".join(command), LIMIT_S)
            return subprocess.CompletedProcess(command, 1, said)

    def _window(self, title, display):
        tree = self._run(["xwininfo", "-root", "-tree"], display).stdout
        return next((line.split()[0] for line in tree.splitlines() if title in line), None)

    def shows_rviz(self):
        return self._window(RVIZ, self.rviz_display) is not None

    def shoot(self, name, only=None):
        """Pictures of rviz and image_view, or of `only` one of them, as <kind>_<name>.png; returns the paths of those
        that could be taken."""
        pictures = []
        for title, display, kind in ((RVIZ, self.rviz_display, "rviz"),
                                     ("/left/image_rect", self.view_display, "image_view")):
            if only not in (None, kind):
                continue
            window = self._window(title, display)
            path = self.output / ("%s_%s.png" % (kind, name))
            if window is None:
                print("  warning: no window of %s on display %s" % (kind, display))
                continue
            # Packing the picture must not take time from what is measured.
            result = self._run(["nice", "-n", "15", "import", "-window", window, "+repage", str(path)], display)
            if result.returncode == 0 and path.exists():
                pictures.append(path)
            else:
                print("  warning: no picture of %s: %s" % (kind, result.stdout.strip()))
        return pictures
