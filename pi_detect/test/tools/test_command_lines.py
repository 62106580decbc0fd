#!/usr/bin/python3
"""What the programs print on the command line."""

import os
import subprocess
import tempfile
import unittest
from pathlib import Path

PROGRAMS = Path(os.environ["PROGRAMS"])
MODEL = Path(__file__).resolve().parents[2] / "config" / "models" / "street.yaml"
TIMEOUT_S = 120


def run(program, *arguments):
    """@return (exit status, both outputs)"""
    ended = subprocess.run([PROGRAMS / program, *arguments], stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                           text=True, timeout=TIMEOUT_S, check=False)
    return ended.returncode, ended.stdout


class CommandLines(unittest.TestCase):
    def test_every_tool_prints_its_help(self):
        for program in ("check_model", "detect_images", "bench_detect", "bench_live", "bench_obstacles",
                        "bench_tracking"):
            with self.subTest(program):
                status, text = run(program, "--help")
                self.assertEqual(status, 0, text)
                self.assertIn(program, text)
                self.assertIn("show this text", text)

    def test_a_wrong_option_is_named(self):
        status, text = run("bench_obstacles", "--scale", "2", "somewhere")
        self.assertEqual(status, 2)
        self.assertRegex(text, r"^bench_obstacles: .*--scale\b")

    def test_a_damaged_picture_is_named(self):
        pictures = Path(os.environ.get("PI_EDGE_DATA", "none")) / "detect" / "images_dev"
        if not pictures.is_dir():
            self.skipTest(f"no {pictures}; set PI_EDGE_DATA")
        whole = sorted(pictures.glob("*.jpg"))[0].read_bytes()
        with tempfile.TemporaryDirectory() as folder:
            cut, empty = Path(folder) / "cut.jpg", Path(folder) / "empty.jpg"
            cut.write_bytes(whole[:len(whole) // 2])
            empty.write_bytes(b"")
            found = Path(folder) / "found.json"
            status, text = run("detect_images", "--model", MODEL, "--output", found, "--quiet", "--direct", cut, empty)
            self.assertEqual(status, 1, text)
            self.assertRegex(text, rf"warning: {cut}: .*[Pp]remature end.*used\n")
            self.assertRegex(text, rf"warning: {empty}: no picture that OpenCV can read.*left out\n")
            self.assertTrue(found.is_file())


if __name__ == "__main__":
    unittest.main()
