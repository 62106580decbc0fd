"""Each package of examples/ builds against the installed suite, and passes its own tests.

PI_EDGE_SPACE names another install space than the one of "make build", as /usr/lib/pi-edge of the Debian packages.
"""

import os
import subprocess
import tempfile
import unittest
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples"
SPACE = Path(os.environ.get("PI_EDGE_SPACE", ROOT / "install"))
OF_A_SPACE = ("CMAKE_PREFIX_PATH", "LD_LIBRARY_PATH", "PKG_CONFIG_PATH", "PYTHONPATH", "ROS_PACKAGE_PATH")


class Examples(unittest.TestCase):
    def run_in(self, folder, script, *arguments):
        """Runs a line of the shell with nothing set up but what it sets up itself."""
        environment = {name: value for name, value in os.environ.items() if name not in OF_A_SPACE}
        done = subprocess.run(["sh", "-ec", script, "sh", *(str(word) for word in arguments)], cwd=folder,
                              stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                              check=False, env=environment)
        self.assertEqual(0, done.returncode, "%s:\n%s" % (script, done.stdout[-8000:]))
        return done.stdout

    def test_each_builds_against_the_install_space_and_passes_its_tests(self):
        if not (SPACE / "setup.sh").is_file():
            self.skipTest("%s is no install space: make build" % SPACE)
        packages = sorted(manifest.parent for manifest in EXAMPLES.glob("*/package.xml"))
        self.assertEqual(5, len(packages))
        for package in packages:
            with self.subTest(package.name), tempfile.TemporaryDirectory() as folder:
                # -O0: what is judged here is that it builds and works.
                self.run_in(folder, '. "$1"/setup.sh && cmake -G Ninja -S "$2" -B build -DCMAKE_BUILD_TYPE=Debug '
                            '-DCMAKE_CXX_FLAGS="-O0 -Wall -Wextra -Werror" -DPYTHON_EXECUTABLE=/usr/bin/python3 '
                            '-DCMAKE_INSTALL_PREFIX=$PWD/install && cmake --build build --target all tests install',
                            SPACE, package)
                tests = self.run_in(folder, ". build/devel/setup.sh && ctest --test-dir build --output-on-failure")
                self.assertRegex(tests, r"100% tests passed, 0 tests failed out of 1")

    def test_the_odometer_joins_the_vehicle(self):
        if not (SPACE / "setup.sh").is_file():
            self.skipTest("%s is no install space: make build" % SPACE)
        nodes = self.run_in(ROOT, '. "$1"/setup.sh && ROS_PACKAGE_PATH="$2:$ROS_PACKAGE_PATH" roslaunch --nodes '
                            "pi_bringup vehicle.launch services:=example_odometer chassis:=false", SPACE, EXAMPLES)
        self.assertIn("\n/odometer\n", "\n" + nodes)


if __name__ == "__main__":
    unittest.main()
