"""Short scenarios in a closed loop, each on a graph of its own, as a vehicle team's CI would drive its own."""

import os
import signal
import subprocess
import tempfile
import unittest
from pathlib import Path
from xml.etree import ElementTree

SCENARIOS = ("short_straight", "short_blocked", "short_dark")


class ShortDrives(unittest.TestCase):
    def test_the_vehicle_does_what_the_scenarios_expect(self):
        self.drive(SCENARIOS, "serial")

    def test_a_stock_differential_base_does_too(self):
        self.drive(SCENARIOS[:2], "twist")

    def drive(self, scenarios, base):
        program = Path(os.environ["SPACE"]) / "lib" / "pi_bringup" / "scenario_suite"
        with tempfile.TemporaryDirectory() as folder:
            results = Path(folder) / "junit.xml"
            # Simulated time can wait: tests that run beside this one in real time cannot.
            suite = subprocess.Popen(
                ["nice", "-n", "19", "sh", "-c", '. "$0"/setup.sh && exec "$@"', os.environ["SPACE"], str(program),
                 *scenarios, "--base", base, "--output", str(Path(folder) / "drives"), "--junit", str(results)],
                stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
            try:
                said, _ = suite.communicate(timeout=500)
            except subprocess.TimeoutExpired:
                suite.send_signal(signal.SIGINT)  # ends its drive, and the nodes of that
                said, _ = suite.communicate(timeout=60)
            said += "\n".join(one.read_text() for one in sorted(Path(folder).glob("drives/*/report.txt")))
            self.assertEqual(0, suite.returncode, said)
            cases = ElementTree.parse(results).getroot().iter("testcase")
            bad = [[one.tag for one in case if one.tag in ("failure", "error")] for case in cases]
            self.assertEqual([[]] * len(scenarios), bad, said)
        self.assertIn("%d of %d drives passed, 0 with a collision" % (2 * (len(scenarios),)), said)


if __name__ == "__main__":
    unittest.main()
