"""Words of a drive without a graph: when they are said, and when again."""

import sys
import tempfile
import unittest
from pathlib import Path
from types import SimpleNamespace

PACKAGE = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(PACKAGE / "scripts"))
from campus_drive.speaker import REPEAT_S, Speaker  # noqa: E402


class Scene(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.sounds = {}
        for word in ("stop", "go", "yes"):
            self.sounds[word] = Path(folder.name) / (word + ".wav")
            self.sounds[word].touch()
        self.spoken = [
            {"clip": str(self.sounds["stop"]), "text": "stop", "near": [10.0, 0.0], "within": 2.0, "delay": 0.0},
            {"clip": str(self.sounds["go"]), "text": "go", "near": [10.0, 0.0], "within": 2.0, "delay": 5.0}]
        self.states = []
        self.said = []
        self.speaker = Speaker(self.spoken, Path(folder.name), SimpleNamespace(command_states=self.states),
                               lambda path: self.said.append(path.stem))

    def at(self, x, now):
        self.speaker.notice(x, 0.0, now, now)
        return self.speaker.speak(now)

    def stopped(self, stopped):
        self.states.append({"stopped": stopped})

    def test_words_are_said_at_their_places_once(self):
        self.assertFalse(self.at(7.0, 1.0))
        self.assertTrue(self.at(9.0, 2.0))
        self.assertTrue(self.speaker.waits(), "go is due")
        self.assertFalse(self.at(10.0, 6.9))
        self.assertTrue(self.at(10.0, 7.0))
        self.assertFalse(self.speaker.waits())
        self.assertEqual(self.said, ["stop", "go"])
        self.assertFalse(self.at(10.0, 100.0), "nothing is known to stand")

    def test_go_is_said_again_while_the_vehicle_is_stopped(self):
        self.at(10.0, 0.0)
        self.stopped(True)
        self.at(10.0, 5.0)
        self.assertFalse(self.at(10.0, 4.9 + REPEAT_S))
        self.assertTrue(self.at(10.0, 5.0 + REPEAT_S))
        self.assertFalse(self.at(10.0, 4.9 + 2 * REPEAT_S))
        self.assertTrue(self.at(10.0, 5.0 + 2 * REPEAT_S))
        self.stopped(False)
        self.assertFalse(self.at(10.0, 5.0 + 4 * REPEAT_S))
        self.assertEqual(self.said, ["stop", "go", "go", "go"])
        self.assertEqual([entry["text"] for entry in self.spoken if entry.get("said") is not None], self.said)

    def test_what_is_held_is_said_later(self):
        self.at(10.0, 0.0)
        self.speaker.hold(3.0)
        self.assertFalse(self.at(10.0, 7.9))
        self.assertTrue(self.at(10.0, 8.0))

    def test_a_proof_is_one_more_word(self):
        self.speaker.prove(str(self.sounds["yes"]), 3.0)
        self.assertEqual(self.said, ["yes"])
        self.assertEqual(self.spoken[-1]["said"], 3.0)


if __name__ == "__main__":
    unittest.main()
