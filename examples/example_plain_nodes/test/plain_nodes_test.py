#!/usr/bin/python3
"""Judge of plain_nodes.test: waits until the talker's link of /words has the transport of π-OS."""
import time
import unittest
import xmlrpc.client

import rosgraph
import rostest


def transports(node, topic):
    """Of the node's links of a topic, as "rosnode info" shows them."""
    master = rosgraph.Master("/judge")
    try:
        links = xmlrpc.client.ServerProxy(master.lookupNode(node)).getBusInfo("/judge")[2]
    except rosgraph.MasterException:
        return []  # it starts
    return [link[3] for link in links if link[4] == topic]


class PlainNodes(unittest.TestCase):
    def test_topic_goes_through_shared_memory(self):
        end = time.monotonic() + 30.0
        while transports("/talker", "/words") != ["SHMROS"] and time.monotonic() < end:
            time.sleep(0.05)  # no event tells of it
        self.assertEqual(["SHMROS"], transports("/talker", "/words"))


if __name__ == "__main__":
    rostest.rosrun("example_plain_nodes", "plain_nodes", PlainNodes)
