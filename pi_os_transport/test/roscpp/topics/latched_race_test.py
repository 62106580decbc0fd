#!/usr/bin/python3 -B
"""Judge of latched_race.test."""
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
import transport_harness as harness  # noqa: E402  (found through the line above)
from latched_race import RACES, Race  # noqa: E402


class LatchedRace(harness.TransportTest):

    def check(self, listener, transport, sizes=1000):
        race = Race(self, self.peer)
        race.run(listener, lambda: self.link(race.talker, listener, race.topic, transport), sizes=sizes)

    def test_shared_memory(self):
        self.check(self.peer('listener'), self.SHM)

    def test_large_messages_in_shared_memory(self):
        race, listener = Race(self, self.peer), self.peer('listener')
        race.run(listener, lambda: self.link(race.talker, listener, race.topic), races=max(RACES // 20, 5),
                 sizes=2000000)

    def test_tcpros(self):
        self.check(self.peer('listener', preload=''), 'TCPROS')

    def test_within_the_process(self):
        race = Race(self, self.peer)
        race.run(race.talker, lambda: race.talker.await_transports(race.topic, 'o', ['INTRAPROCESS']), sizes=1000)


if __name__ == '__main__':
    harness.main(LatchedRace)
