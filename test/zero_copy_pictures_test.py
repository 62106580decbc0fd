#!/usr/bin/python3
"""Judge of zero_copy_pictures.test."""

import re
import time
import unittest
import xmlrpc.client

import rosgraph
import rostest

NODES = ['vio', 'ssd', 'obstacles', 'coordinator']
TOPIC = '/left/image_raw'
PICTURES = 20
TIMEOUT_S = 90.0
POLL_S = 0.2  # the slave API signals nothing


class ZeroCopyPictures(unittest.TestCase):

    def link(self, node):
        """What the node says of its link to the player; empty while there is none."""
        try:
            uri = rosgraph.Master('/judge').lookupNode('/' + node)
            _, _, links = xmlrpc.client.ServerProxy(uri).getBusInfo('/judge')
        except (rosgraph.MasterError, OSError):
            return ''
        return ' '.join('%s %s' % (link[3], link[6]) for link in links if link[4] == TOPIC and link[2] == 'i')

    def test_every_node_reads_pictures_where_they_were_written(self):
        deadline = time.monotonic() + TIMEOUT_S
        for node in NODES:
            while True:
                text = self.link(node)
                counts = re.search(r'(\d+) messages through shared memory, (\d+) read in place, (\d+) copied', text)
                if counts and int(counts.group(2)) >= PICTURES:
                    break
                self.assertLess(time.monotonic(), deadline, '%s: %s' % (node, text or 'no link'))
                time.sleep(POLL_S)
            self.assertTrue(text.startswith('SHMROS'), text)
            received, in_place, copied = (int(count) for count in counts.groups())
            # One may have arrived whose callback has not run, and queues drop what nobody has read.
            self.assertEqual(copied, 0, text)
            self.assertGreater(in_place, 0.5 * received, text)


if __name__ == '__main__':
    rostest.rosrun('pi_edge', 'zero_copy_pictures', ZeroCopyPictures)
