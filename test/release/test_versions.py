"""One version for all packages, and a changelog for it."""

import re
import unittest
import xml.etree.ElementTree as ElementTree
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
MANIFESTS = [ROOT / "package.xml", *sorted(ROOT.glob("pi_*/package.xml"))]
DEBIAN = re.match(r"pi-edge \((\S+)\)", (ROOT / "debian/changelog").read_text(encoding="utf-8")).group(1)


class Versions(unittest.TestCase):
    def test_every_package_has_that_of_the_debian_packages(self):
        self.assertEqual({DEBIAN}, {ElementTree.parse(path).getroot().findtext("version") for path in MANIFESTS})

    def test_every_changelog_begins_with_it_or_with_what_comes_next(self):
        for manifest in MANIFESTS:
            text = (manifest.parent / "CHANGELOG.rst").read_text(encoding="utf-8")
            newest = re.search(r"^(.+)\n-+$", text, re.MULTILINE).group(1)
            released = re.escape(DEBIAN) + r" \(\d{4}-\d\d-\d\d\)"
            self.assertRegex(newest, f"^(Forthcoming|{released})$", manifest.parent.name)


if __name__ == "__main__":
    unittest.main()
