"""What is said during a drive: the scenario's words at their places."""

import math

from . import words

RELEASE = "go"
REPEAT_S = 6.0  # after which somebody says again what did not help: a recogniser that was dead heard nothing


class Speaker:
    """@param spoken  the scenario's; gets "said", and an entry for every repetition. @param say  plays a sound file.
    @param records  of the observer."""

    def __init__(self, spoken, output, records, say):
        self._spoken = spoken
        self._output = output
        self._records = records
        self._say = say
        self._words = [[None, entry, words.sound_of(entry["clip"], output)] for entry in spoken]

    def notice(self, x, y, since_begin, now):
        """A word is due from when its place is reached."""
        for one in self._words:
            due, entry, _ = one
            if due is None:
                near = entry.get("near")
                here = (math.hypot(x - near[0], y - near[1]) <= entry["within"] if near
                        else since_begin >= entry.get("time", 0.0))
                if here:
                    one[0] = now + entry["delay"]

    def speak(self, now):
        """What is due, and the release again while the vehicle goes on standing. @return True: something was said."""
        spoken = False
        for due, entry, path in self._words:
            if due is not None and now >= due and entry.get("said") is None:
                self._utter(entry, path, now)
                spoken = True
        return spoken or self._repeat(now)

    def _repeat(self, now):
        said = [entry for entry in self._spoken if entry["text"] == RELEASE and entry.get("said") is not None]
        states = self._records.command_states
        if not said or now < said[-1]["said"] + REPEAT_S or not (states and states[-1]["stopped"]):
            return False
        self._utter(self._one_more(said[-1]["clip"], RELEASE), words.sound_of(said[-1]["clip"], self._output), now,
                    " again")
        return True

    def _one_more(self, clip, text):
        entry = {"clip": clip, "text": text, "delay": 0.0}
        self._spoken.append(entry)
        return entry

    def _utter(self, entry, path, now, how=""):
        entry["said"] = now
        print("  saying \"%s\"%s" % (entry["text"], how))
        self._say(path)

    def waits(self):
        """Whether a word is due and not said."""
        return any(due is not None and entry.get("said") is None for due, entry, _ in self._words)

    def hold(self, seconds):
        """What is due is said so much later."""
        for one in self._words:
            if one[0] is not None and one[1].get("said") is None:
                one[0] += seconds

    def prove(self, word, now):
        """Says a word that changes nothing."""
        self._utter(self._one_more(word, word), words.sound_of(word, self._output), now)
