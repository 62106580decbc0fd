"""pi_edge demo is drive_campus --demo, with the arguments behind it."""

import subprocess
import unittest


def pi_edge(*words):
    return subprocess.run(["rosrun", "pi_bringup", "pi_edge", *words], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                          stderr=subprocess.STDOUT, text=True, check=False)


class Demo(unittest.TestCase):
    def test_its_options_are_those_of_drive_campus(self):
        shown = pi_edge("demo", "--help")
        self.assertEqual(0, shown.returncode, shown.stdout)
        self.assertIn("usage: drive_campus", shown.stdout)

    def test_its_arguments_are_passed_on(self):
        refused = pi_edge("demo", "--seed", "none")
        self.assertEqual(2, refused.returncode, refused.stdout)
        self.assertIn("drive_campus: error: argument --seed", refused.stdout)

    def test_other_commands_still_refuse_what_they_do_not_know(self):
        refused = pi_edge("doctor", "--nonsense")
        self.assertEqual(2, refused.returncode, refused.stdout)
        self.assertIn("unrecognized arguments: --nonsense", refused.stdout)


if __name__ == "__main__":
    unittest.main()
