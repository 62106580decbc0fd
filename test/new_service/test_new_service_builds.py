"""What pi_edge new service writes builds on top of the suite and passes its own tests."""

import os
import re
import subprocess
import tempfile
import unittest
from pathlib import Path


class NewServiceBuilds(unittest.TestCase):
    def run_step(self, *command, **environment):
        done = subprocess.run(command, cwd=self.folder, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                              stderr=subprocess.STDOUT, text=True, check=False, env=dict(os.environ, **environment))
        self.assertEqual(0, done.returncode, "%s:\n%s" % (" ".join(command), done.stdout[-8000:]))
        return done.stdout

    def test_it_builds_and_passes_its_tests_and_joins_the_vehicle(self):
        with tempfile.TemporaryDirectory() as folder:
            self.folder = folder
            self.run_step("rosrun", "pi_bringup", "pi_edge", "new", "service", "lane_keeper")
            package = Path(folder) / "lane_keeper"
            # -O0: what is judged here is that it builds and works.
            self.run_step("cmake", "-G", "Ninja", "-S", str(package), "-B", "build", "-DCMAKE_BUILD_TYPE=Debug",
                          "-DCMAKE_CXX_FLAGS=-O0 -Werror", "-DPYTHON_EXECUTABLE=/usr/bin/python3")
            self.run_step("cmake", "--build", "build", "--target", "all", "tests")
            tests = self.run_step("sh", "-c", ". build/devel/setup.sh && ctest --test-dir build --output-on-failure")
            self.assertRegex(tests, r"100% tests passed, 0 tests failed out of 3")
            nodes = self.run_step("sh", "-c", ". build/devel/setup.sh && roslaunch --nodes pi_bringup vehicle.launch "
                                  "services:=lane_keeper chassis:=false")
            self.assertEqual(1, len(re.findall(r"^/lane_keeper$", nodes, re.MULTILINE)), nodes)


if __name__ == "__main__":
    unittest.main()
