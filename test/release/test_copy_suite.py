"""What a build of packages takes along."""

import shutil
import subprocess
import tempfile
import unittest
from pathlib import Path

SCRIPT = Path(__file__).resolve().parents[2] / "scripts/copy_suite"


class CopySuite(unittest.TestCase):
    def test_without_a_history_all_but_what_a_build_makes(self):
        with tempfile.TemporaryDirectory() as scratch:
            suite, copy = Path(scratch, "suite"), Path(scratch, "copy")
            for name in ("scripts", "debian", "build", "install"):
                (suite / name).mkdir(parents=True)
                (suite / name / "file").write_text(name)
            shutil.copy(SCRIPT, suite / "scripts")
            (suite / "debian/node.postinst").symlink_to("file")
            subprocess.run([suite / "scripts/copy_suite", copy], check=True)
            self.assertEqual(["debian", "debian/file", "debian/node.postinst", "scripts", "scripts/copy_suite",
                              "scripts/file"], sorted(str(path.relative_to(copy)) for path in copy.rglob("*")))
            self.assertTrue((copy / "debian/node.postinst").is_symlink())


if __name__ == "__main__":
    unittest.main()
