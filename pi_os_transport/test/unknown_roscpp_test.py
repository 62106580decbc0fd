#!/usr/bin/python3 -B
"""Judge of unknown_roscpp.test."""
import os
import re
import shutil

import transport_harness as harness


class UnknownRoscpp(harness.TransportTest):

    def library_path(self):
        """Folder with a copy of libroscpp under a version that does not exist."""
        found = {line.split(None, 5)[5] for line in self.maps if 'libroscpp.so' in line}
        original = found.pop()
        soname = next(name for name in os.listdir(os.path.dirname(original))
                      if re.match(r'libroscpp\.so\.\d+[a-z]*$', name))
        folder = self.scratch()
        shutil.copy(original, os.path.join(folder, 'libroscpp.so.9.99.99'))
        os.symlink('libroscpp.so.9.99.99', os.path.join(folder, soname))
        return folder

    def test_falls_back_to_tcp_with_one_warning(self):
        topic = self.topic()
        listener, = self.peers('listener')
        self.maps = harness.mappings(listener.pid)
        folder = self.library_path()
        talker = self.peer('talker', env={'LD_LIBRARY_PATH': folder})
        self.assertTrue([line for line in harness.mappings(talker.pid) if folder in line])
        talker.call('advertise', topic=topic, queue=100)
        listener.call('subscribe', topic=topic, queue=100)
        talker.call('await_subscribers', n=1)
        talker.call('publish', count=50, sizes='100,200000')
        self.assert_complete(listener.call('await_received', seq=50), 50)
        self.assertEqual(talker.transports(topic, 'o'), ['TCPROS'])
        said = talker.warnings()
        self.assertEqual(len(said), 1 if self.preload else 0, talker.lines)
        if self.preload:
            self.assertIn(folder, said[0])
        self.assertEqual(listener.warnings(), [])


if __name__ == '__main__':
    harness.main(UnknownRoscpp)
