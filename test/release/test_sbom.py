"""What make sbom writes: the installed packages named, with all that they depend on."""

import json
import os
import subprocess
import unittest
from pathlib import Path

SBOM = Path(__file__).resolve().parents[2] / "scripts/make_sbom"


def run(*words):
    return subprocess.run([SBOM, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, check=False,
                          env=dict(os.environ, SOURCE_DATE_EPOCH="86400"))


class Sbom(unittest.TestCase):
    def test_it_lists_a_package_and_what_it_depends_on(self):
        found = json.loads(run("1.2.3", "libstdc++6").stdout)
        packages = {package["name"]: package for package in found["packages"]}
        self.assertEqual("1.2.3", packages["pi-edge"]["versionInfo"])
        version = subprocess.run(["dpkg-query", "-W", "-f", "${Version}", "libc6"], stdout=subprocess.PIPE, text=True,
                                 check=True).stdout
        self.assertEqual(version, packages["libc6"]["versionInfo"])
        self.assertIn({"spdxElementId": "SPDXRef-deb-libstdc-2b--2b-6", "relationshipType": "DEPENDS_ON",
                       "relatedSpdxElement": "SPDXRef-deb-libc6"}, found["relationships"])
        self.assertEqual("1970-01-02T00:00:00Z", found["creationInfo"]["created"])
        known = {package["SPDXID"] for package in found["packages"]} | {"SPDXRef-DOCUMENT"}
        self.assertEqual(len(known), len(packages) + 1)
        self.assertLessEqual({relation["relatedSpdxElement"] for relation in found["relationships"]}, known)

    def test_it_is_the_same_twice(self):
        self.assertEqual(run("1", "libstdc++6").stdout, run("1", "libstdc++6").stdout)

    def test_it_names_what_is_not_installed(self):
        done = run("1", "libc6", "no-such-package")
        self.assertEqual(1, done.returncode)
        self.assertIn("not installed here: no-such-package;", done.stderr)


if __name__ == "__main__":
    unittest.main()
