"""A folder in place of /, for checks."""

import tempfile
import unittest
from pathlib import Path


class FakeRoot(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.root = Path(folder.name)

    def put(self, path, text=""):
        file = self.root / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")
        return file

    def expect(self, level, result, *parts):
        """Its level, and what its line must hold."""
        self.assertEqual(level, result.level, result.line())
        for part in parts:
            self.assertIn(part, result.line())
        if level != "OK":
            self.assertTrue(result.advice, result.line())
