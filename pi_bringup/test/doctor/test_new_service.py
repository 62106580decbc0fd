"""pi_edge new service, without building what it writes: test/new_service of the root package does."""

import tempfile
import unittest
from pathlib import Path
from xml.etree import ElementTree

from pi_bringup.new_service import NewServiceError, template_folder, write_service

TEMPLATE = template_folder(Path(__file__).resolve().parents[2])


class NewService(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def test_every_name_is_filled_in(self):
        package = write_service("lane_keeper", self.folder, TEMPLATE)
        files = [path for path in package.rglob("*") if path.is_file()]
        self.assertGreaterEqual(len(files), 15)
        for path in files:
            self.assertNotIn("NAME", path.name)
            self.assertNotRegex(path.read_text(), "@[A-Z]+@", path)
        self.assertEqual("lane_keeper", ElementTree.parse(package / "package.xml").findtext("name"))
        self.assertIn("class LaneKeeperRos", (package / "src/ros/lane_keeper_ros.h").read_text())
        self.assertTrue((package / "launch/lane_keeper.launch").exists())

    def test_names_of_threads_fit(self):
        package = write_service("a_name_that_is_long", self.folder, TEMPLATE)
        self.assertIn('thread_("a_name_that_is_")', (package / "src/ros/a_name_that_is_long_ros.cpp").read_text())

    def test_wrong_names(self):
        for name in ("", "Lane", "1lane", "lane-keeper", "lane__keeper", "lane/keeper", "_lane"):
            with self.subTest(name), self.assertRaisesRegex(NewServiceError, "NAME = %s, must be" % name):
                write_service(name, self.folder, TEMPLATE)

    def test_nothing_is_overwritten(self):
        write_service("lane", self.folder, TEMPLATE)
        with self.assertRaisesRegex(NewServiceError, "is there already"):
            write_service("lane", self.folder, TEMPLATE)

    def test_a_folder_that_cannot_be_written(self):
        with self.assertRaisesRegex(NewServiceError, "cannot be written"):
            write_service("lane", "/proc/self", TEMPLATE)

    def test_a_missing_template(self):
        with self.assertRaisesRegex(NewServiceError, "is missing"):
            write_service("lane", self.folder, self.folder / "none")


if __name__ == "__main__":
    unittest.main()
