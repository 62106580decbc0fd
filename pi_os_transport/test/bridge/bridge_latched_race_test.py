#!/usr/bin/python3 -B
"""Judge of bridge_latched_race.test."""
import functools
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import device_testbed  # noqa: E402  (found through the line above)
import transport_harness as harness  # noqa: E402
from latched_race import Race  # noqa: E402


class BridgeLatchedRace(device_testbed.DeviceTest):

    def test_through_the_bridge(self):
        self.start_bridges(self.vehicle, self.edge_a)
        race = Race(self, functools.partial(self.node, self.vehicle))
        listener = self.node(self.edge_a, 'listener')
        race.run(listener, lambda: self.await_links(race.talker, [listener], race.topic), sizes=1000)


if __name__ == '__main__':
    harness.main(BridgeLatchedRace)
