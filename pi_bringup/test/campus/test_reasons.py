"""The reason that a report gives for a drive that did not take place: the first error, in one sentence."""

import sys
import tempfile
import unittest
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(PACKAGE / "scripts"))
from campus_drive import apart  # noqa: E402
from first_drive.errors import DemoError  # noqa: E402
from first_drive.processes import log_excerpt  # noqa: E402

INFO = "\x1b[0m[ INFO] [17.1] /vio: parameters: [a:1]\x1b[0m\n"
ERROR = "\x1b[31m[ERROR] [17.2] /vio: no calibration\x1b[0m\n"
LATER = "\x1b[31m[FATAL] [17.3] /ssd: the manager is gone\x1b[0m\n"
STARTED = "process[player-1]: started with pid [42]\n"
SAID = "recording_to_bag: /a.bag: not readable as a bag\n"
DIED = "====REQUIRED process [player-1] has died!\nprocess has died [pid 42, exit code 1]\n"
END = "shutting down processing monitor...\ndone\n"


class Reasons(unittest.TestCase):

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def first_of(self, log):
        path = self.folder / "roslaunch.log"
        path.write_text(log)
        return log_excerpt(path).splitlines()[0].strip()

    def test_the_first_error_of_a_node_comes_first(self):
        self.assertEqual("[ERROR] [17.2] /vio: no calibration", self.first_of(INFO + ERROR + INFO + DIED + LATER + END))
        self.assertEqual("[ERROR] [17.2] /vio: no calibration", self.first_of(ERROR + LATER * 30))

    def test_a_process_that_died_had_the_last_word(self):
        self.assertEqual(SAID.strip(), self.first_of(STARTED + SAID + INFO + STARTED + DIED + LATER + INFO + END))

    def test_a_log_without_errors_shows_its_end(self):
        path = self.folder / "end.log"
        path.write_text(INFO * 20 + END)
        self.assertEqual("done", log_excerpt(path).splitlines()[-2].strip())

    def reason_of(self, report, status=1):
        (self.folder / "report.txt").write_text(report)
        with self.assertRaises(DemoError) as caught:
            apart.result_of(self.folder, status)
        return str(caught.exception)

    def test_a_report_gives_its_reason_with_the_error_of_the_log(self):
        self.assertEqual("no drive: drive_campus: roslaunch ended; from the log: no calibration",
                         self.reason_of("starting\ndrive_campus: roslaunch ended; from the log:\n    no calibration\n"))
        self.assertEqual("no drive: drive_campus: no such file",
                         self.reason_of("starting\ndrive_campus: no such file\n"))

    def test_a_report_without_a_reason(self):
        self.assertEqual("no drive: killed", self.reason_of("starting\nkilled\n"))
        self.assertEqual("no drive: status 9", self.reason_of("", 9))


if __name__ == "__main__":
    unittest.main()
