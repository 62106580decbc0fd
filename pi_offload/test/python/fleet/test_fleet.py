"""Real clients and servers while sites are killed, cut off and upgraded: each task ends once, whatever the transport.

BENCH_FLEET names the program.
"""

import os
import subprocess
import unittest


class Fleet(unittest.TestCase):
    def test_each_task_ends_once(self):
        for transport in ("nats", "direct"):
            with self.subTest(transport):
                run = subprocess.run(
                    [os.environ["BENCH_FLEET"], "--transport", transport, "--vehicles", "20", "--sites", "2",
                     "--rate", "2", "--kills", "1", "--partition", "1", "--upgrade", "--duration", "9", "--bytes", "10000"],
                    stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=180)
                self.assertEqual(0, run.returncode, run.stdout)
                row = next(line for line in run.stdout.splitlines() if line.startswith("| %s |" % transport))
                cells = [cell.strip() for cell in row.split("|")]
                self.assertEqual([transport, "20"], cells[1:3])
                self.assertGreaterEqual(int(cells[5]), 300, run.stdout)
                self.assertEqual(["0", "0"], cells[10:12], run.stdout)  # not ended, ended twice


if __name__ == "__main__":
    unittest.main()
