"""Which log lines of a drive are errors."""

import sys
import unittest
from pathlib import Path
from types import SimpleNamespace

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))
from campus_drive import observer  # noqa: E402  (found through the line above)

OF_THE_SHADER = ("rviz/glsl120/indexed_8bit_image.vert\nrviz/glsl120/indexed_8bit_image.frag\n GLSL link result : \n"
                 "active samplers with a different type refer to the same texture image unit\n")


class Errors(unittest.TestCase):

    def test_only_what_rviz_says_of_its_shader_for_maps_is_none(self):
        def message(name, text):
            return SimpleNamespace(name=name, msg=text)
        self.assertTrue(observer.is_of_map_shader(message("/rviz", OF_THE_SHADER)))
        self.assertFalse(observer.is_of_map_shader(message("/vio", OF_THE_SHADER)))
        for other in (OF_THE_SHADER.replace("active samplers", "too many samplers"),
                      OF_THE_SHADER.replace("indexed_8bit_image.frag", "point.frag"), "rviz runs out of memory"):
            self.assertFalse(observer.is_of_map_shader(message("/rviz", other)))


if __name__ == "__main__":
    unittest.main()
