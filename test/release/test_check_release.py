"""What make release-check calls bit-identical."""

import importlib.machinery
import importlib.util
import shutil
import subprocess
import tempfile
import unittest
from pathlib import Path

SCRIPT = Path(__file__).resolve().parents[2] / "scripts/check_release"


def load():
    loader = importlib.machinery.SourceFileLoader("check_release", str(SCRIPT))
    module = importlib.util.module_from_spec(importlib.util.spec_from_loader("check_release", loader))
    loader.exec_module(module)
    return module


check_release = load()


def space(folder, **programs):
    """A space with copies of programs of this system: {name: program}, and a text that is not compared."""
    (folder / "lib").mkdir(parents=True)
    for name, program in programs.items():
        shutil.copy(shutil.which(program), folder / "lib" / name)
    (folder / "setup.sh").write_text(str(folder))
    return folder


class CheckRelease(unittest.TestCase):
    def setUp(self):
        self.folder = Path(self.enterContext(tempfile.TemporaryDirectory()))

    def test_equal_programs_are_identical_whatever_their_folder(self):
        first = space(self.folder / "one", node="true", other="false")
        second = space(self.folder / "in_another_folder", node="true")
        self.assertEqual(([], ["lib/node"]), check_release.compare(first, second, whole=False))

    def test_one_that_only_the_first_space_has_is_named(self):
        first = space(self.folder / "one", node="true", other="false")
        second = space(self.folder / "two", node="true")
        self.assertEqual((["lib/other"], ["lib/node"]), check_release.compare(first, second))

    def test_one_that_differs_and_one_that_is_missing_are_named(self):
        first = space(self.folder / "one", node="true", tool="true")
        second = space(self.folder / "two", node="true", tool="false", more="true")
        self.assertEqual((["lib/more", "lib/tool"], ["lib/more", "lib/node", "lib/tool"]),
                         check_release.compare(first, second))

    def test_a_section_that_no_package_holds_is_not_compared(self):
        first = space(self.folder / "one", node="true")
        second = space(self.folder / "two", node="true")
        note = self.folder / "note"
        note.write_text("GCC of another day")
        subprocess.run(["objcopy", "--add-section", ".comment=%s" % note, second / "lib/node"], check=True)
        self.assertEqual([], check_release.compare(first, second)[0])

    def test_it_names_what_it_cannot_compare(self):
        for words, named in ((["--packages", "pi_none"], "package pi_none is not there; it must be one of pi_bringup "),
                             (["--against", str(self.folder)], "%s holds neither packages nor" % self.folder)):
            done = subprocess.run([SCRIPT, "--work", self.folder / "work", *words], stderr=subprocess.PIPE, text=True,
                                  check=False)
            self.assertEqual(1, done.returncode)
            self.assertIn(named, done.stderr)


if __name__ == "__main__":
    unittest.main()
