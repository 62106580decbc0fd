#!/usr/bin/python3
"""Runs the Python unit tests of a folder and writes their results as JUnit XML, which "make check" counts.

  run_unittests.py FOLDER RESULTS.xml
"""

import argparse
import sys
import time
import unittest
from pathlib import Path
from xml.etree import ElementTree


class Results(unittest.TextTestResult):
    """Collects an element for each case."""

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self.suite = ElementTree.Element("testsuite", name="unittests")
        self._began = time.monotonic()

    def startTest(self, test):
        self._began = time.monotonic()
        super().startTest(test)

    def _add(self, test, tag="", text=""):
        """A case, with what went wrong: the last line in short, all of it as text."""
        classname, _, name = test.id().rpartition(".")
        case = ElementTree.SubElement(self.suite, "testcase", classname=classname, name=name,
                                      time=f"{time.monotonic() - self._began:.3f}")
        if tag:
            text = "".join(c for c in text if c.isprintable() or c == "\n").strip()
            ElementTree.SubElement(case, tag, message=text.splitlines()[-1] if text else "").text = text

    def addSuccess(self, test):
        super().addSuccess(test)
        self._add(test)

    def addSkip(self, test, reason):
        super().addSkip(test, reason)
        self._add(test, "skipped", reason)

    def addFailure(self, test, error):
        super().addFailure(test, error)
        self._add(test, "failure", self._exc_info_to_string(error, test))

    def addError(self, test, error):
        super().addError(test, error)
        self._add(test, "error", self._exc_info_to_string(error, test))

    def addSubTest(self, test, subtest, error):
        super().addSubTest(test, subtest, error)
        if error is not None:
            self._add(subtest, "failure", self._exc_info_to_string(error, test))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="holds test_*.py")
    parser.add_argument("results", type=Path, help="XML file to write")
    arguments = parser.parse_args()
    sys.dont_write_bytecode = True  # nothing is left in the sources
    tests = unittest.defaultTestLoader.discover(str(arguments.folder.resolve()))
    results = unittest.TextTestRunner(resultclass=Results, verbosity=2).run(tests)
    cases = {tag: len(results.suite.findall(f"testcase/{tag}")) for tag in ("error", "failure", "skipped")}
    results.suite.attrib.update(tests=str(len(results.suite)), errors=str(cases["error"]),
                                failures=str(cases["failure"]), skipped=str(cases["skipped"]))
    arguments.results.parent.mkdir(parents=True, exist_ok=True)
    ElementTree.ElementTree(results.suite).write(arguments.results, encoding="utf-8", xml_declaration=True)
    return 0 if results.wasSuccessful() and results.testsRun else 1


if __name__ == "__main__":
    sys.exit(main())
