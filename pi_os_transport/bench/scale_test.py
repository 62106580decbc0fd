#!/usr/bin/python3
"""The graph of a vehicle over π-OS: it starts, loses nothing, does not grow, and ends."""

import os
import sys
import time
import unittest

import rostest

PREFIXES = [prefix for prefix in os.environ.get('CMAKE_PREFIX_PATH', '').split(':') if prefix]
sys.path[:0] = [os.path.join(prefix, 'lib', 'pi_os_transport') for prefix in PREFIXES]
import transport_bench as bench  # noqa: E402  (from the devel or install space, where the nodes are)
from transport_bench import fleet  # noqa: E402

SOAK = os.environ.get('PI_EDGE_SOAK') == '1'
NODES, TOPICS, LINKS, SECONDS = (60, 600, 1500, 3600) if SOAK else (12, 60, 150, 3)
# Allocators take more at the start than later. What is lost per message would be far more: 10 million messages in an
# hour.
GROWTH_MB = 5.0
CALLS = 2  # connections of calls to the master and of other nodes come and go


class ScaleTest(unittest.TestCase):

    def test_a_graph_starts_loses_nothing_and_ends(self):
        flows = fleet.plan_flows(NODES, TOPICS, LINKS)
        self.assertEqual(LINKS, sum(len(flow.subscribers) for flow in flows))
        with bench.Master() as master:
            group = fleet.Fleet(master, bench.MODES['pi_os'], flows, NODES, bench.find_library())
            self.addCleanup(group.abandon)
            group.start()
            time.sleep(SECONDS / 10)  # the traffic itself
            begin_mb, descriptors = group.memory_mb(), group.descriptors()
            time.sleep(SECONDS)
            grown_mb, after = group.memory_mb() - begin_mb, group.descriptors()
            totals = group.stop()
            self.assertGreater(totals['received'], LINKS)
            self.assertEqual((0, 0, 0), tuple(totals[key] for key in ('missing', 'repeated', 'damaged')), totals)
            for old, new in zip(descriptors, after):
                self.assertLessEqual(sum(new.values()), sum(old.values()) + CALLS, {'more': new - old, 'before': old})
            self.assertLess(grown_mb, GROWTH_MB)
            group.close()


if __name__ == '__main__':
    rostest.rosrun('pi_os_transport', 'scale', ScaleTest)
