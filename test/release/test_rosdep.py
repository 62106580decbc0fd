"""Keys by which the package.xml files name what they need: rosdep finds each, and the Debian package that it means."""

import unittest
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import rospkg
import yaml

ROOT = Path(__file__).resolve().parents[2]
# In base.yaml and python.yaml of rosdistro, with a Debian package; looked up on 30 November 2026. A further key: look
# there first, then add it to rosdep.yaml.
KNOWN_TO_ROSDEP = {
    "boost", "chromium-browser", "eigen", "geographiclib", "iproute2", "libasound2-dev", "libceres-dev",
    "libespeak-ng1", "libevent-dev", "libopencv-dev", "libpcl-all-dev", "libsndfile1-dev", "libssl-dev",
    "libturbojpeg", "liburdfdom-tools", "nlohmann-json-dev", "ocl-icd-opencl-dev", "opencl-headers", "openssl",
    "protobuf-dev", "python3-matplotlib", "python3-numpy", "python3-opencv", "python3-pil", "python3-yaml", "yaml-cpp"}


class RosdepKeys(unittest.TestCase):
    def setUp(self):
        manifests = [ElementTree.parse(path).getroot()
                     for pattern in ("package.xml", "pi_*/package.xml", "examples/*/package.xml")
                     for path in ROOT.glob(pattern)]
        ours = {manifest.findtext("name") for manifest in manifests}
        self.keys = {entry.text for manifest in manifests for entry in manifest if "depend" in entry.tag} - ours
        self.rosdep = yaml.safe_load((ROOT / "rosdep.yaml").read_text(encoding="utf-8"))

    def test_each_key_is_a_ros_package_or_is_known(self):
        ros = set(rospkg.RosPack().list())
        self.assertEqual(set(), self.keys - ros - KNOWN_TO_ROSDEP - set(self.rosdep))

    def test_no_key_is_kept_that_nobody_uses(self):
        self.assertEqual(set(), set(self.rosdep) - self.keys)

    def test_rosdep_yaml_names_packages_that_are_installed_anyway(self):
        lines = (ROOT / "dependencies.txt").read_text(encoding="utf-8").splitlines()
        wanted = {line.split("#")[0].strip() for line in lines}
        for key, systems in self.rosdep.items():
            self.assertLessEqual(set(systems["debian"]), wanted, key)


if __name__ == "__main__":
    unittest.main()
