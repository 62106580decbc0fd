"""Pictures of the screen, with programs that stand in for those of X."""

import contextlib
import io
import os
import sys
import tempfile
import unittest
from pathlib import Path
from types import SimpleNamespace
from unittest import mock

PACKAGE = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(PACKAGE / "scripts"))
from first_drive import screen  # noqa: E402


class Pictures(unittest.TestCase):
    def setUp(self):
        self.folder = Path(self.enterContext(tempfile.TemporaryDirectory()))
        self.enterContext(mock.patch.object(screen, "LIMIT_S", 1))
        self.enterContext(mock.patch.dict(os.environ, DISPLAY=":1", PATH=f"{self.folder}:{os.environ['PATH']}"))

    def program(self, name, script):
        path = self.folder / name
        path.write_text("#!/bin/sh\n" + script, encoding="utf-8")
        path.chmod(0o755)

    def screen(self):
        return screen.Screen(SimpleNamespace(environment=dict(os.environ)), self.folder)

    def shoot(self):
        """@return the pictures, and what was said"""
        with contextlib.redirect_stdout(io.StringIO()) as said:
            pictures = self.screen().shoot("it", only="rviz")
        return pictures, said.getvalue()

    def test_a_window_that_rviz_has_not_filled_yet_does_not_count(self):
        self.program("xwininfo", "echo ' 0x1 \"RViz\"'\n")
        self.assertFalse(self.screen().shows_rviz())
        self.assertEqual(([], "  warning: no window of rviz on display :1\n"), self.shoot())
        self.program("xwininfo", "echo ' 0x1 \"vehicle.rviz - RViz\"'\n")
        self.assertTrue(self.screen().shows_rviz())

    def test_a_program_that_hangs_costs_the_picture(self):
        self.program("xwininfo", "echo ' 0x1 \"vehicle.rviz - RViz\"'\n")
        self.program("import", "exec sleep 1000\n")
        pictures, said = self.shoot()
        self.assertEqual([], pictures)
        self.assertRegex(said, "no picture of rviz: .*import -window 0x1 .*did not end for 1 s; is the computer too busy")

    def test_the_picture_is_named(self):
        self.program("xwininfo", "echo ' 0x1 \"vehicle.rviz - RViz\"'\n")
        self.program("import", 'for picture; do :; done; echo >"$picture"\n')
        self.assertEqual(([self.folder / "rviz_it.png"], ""), self.shoot())


if __name__ == "__main__":
    unittest.main()
