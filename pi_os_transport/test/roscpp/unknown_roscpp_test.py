#!/usr/bin/python3 -B
"""Judge of unknown_roscpp.test."""
import os
import pathlib
import re
import shutil
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import transport_harness as harness  # noqa: E402  (found through the line above)


COMPANION = 'libpi_os_transport_roscpp.so'


class UnknownRoscpp(harness.TransportTest):

    def installed(self, peer):
        """The file of libroscpp in the process of a peer, and its soname."""
        found = {line.split(None, 5)[5] for line in harness.mappings(peer.pid) if 'libroscpp.so' in line}
        original = found.pop()
        return original, next(name for name in os.listdir(os.path.dirname(original))
                              if re.match(r'libroscpp\.so\.\d+[a-z]*$', name))

    def talk_with_roscpp(self, change, name):
        """Fifty messages from a talker whose libroscpp, of the file `name`, holds change(content of the true one).

        @return the talker, its topic, and the path of this libroscpp"""
        topic = self.topic()
        listener, = self.peers('listener')
        original, soname = self.installed(listener)
        library = os.path.join(self.scratch(), name)
        with open(original, 'rb') as source, open(library, 'wb') as copy:
            copy.write(change(source.read()))
        os.symlink(name, os.path.join(os.path.dirname(library), soname))
        talker = self.peer('talker', env={'LD_LIBRARY_PATH': os.path.dirname(library)})
        self.assertTrue([line for line in harness.mappings(talker.pid) if library in line])
        talker.call('advertise', topic=topic, queue=100)
        listener.call('subscribe', topic=topic, queue=100)
        talker.call('await_subscribers', n=1)
        talker.call('publish', count=50, sizes='100,200000')
        self.assert_complete(listener.call('await_received', seq=50), 50)
        self.assertEqual(talker.transports(topic, 'o'), ['TCPROS'])
        self.assertEqual(listener.warnings(), [])
        return talker, library

    def test_unknown_version_falls_back_to_tcp_with_one_warning(self):
        talker, library = self.talk_with_roscpp(lambda content: content, 'libroscpp.so.9.99.99')
        said = talker.warnings()
        self.assertEqual(len(said), 1 if self.preload else 0, talker.lines)
        if self.preload:
            self.assertIn('this node runs with %s, but the library was built for libroscpp.so.1.' % library, said[0])

    def test_lacking_function_falls_back_to_tcp_with_one_warning(self):
        # Other letters with the same hash: libroscpp itself still finds its function, by the changed name.
        self.assertEqual(33 * ord('c') + ord('o'), 33 * ord('d') + ord('N'))
        function, renamed = b'_ZN3ros12TransportTCP7connectERKNSt', b'_ZN3ros12TransportTCP7dNnnectERKNSt'

        def rename(content):
            self.assertEqual(content.count(function), 1)
            return content.replace(function, renamed)

        talker, library = self.talk_with_roscpp(rename, 'libroscpp.so.9.99.99')
        self.assertEqual(talker.warnings(), [])
        said = talker.output('unknown roscpp')
        self.assertEqual(len(said), 1 if self.preload else 0, talker.lines)
        if self.preload:
            self.assertIn('unknown roscpp: %s lacks %s' % (library, function.decode()), said[0])
            self.assertIn('stay on TCPROS', said[0])

    def copied_library(self, companion_bytes):
        """The library in a folder of its own, beside the first companion_bytes of its part for roscpp."""
        folder = self.scratch()
        library = shutil.copy(os.path.realpath(self.preload), folder)
        with open(os.path.join(os.path.dirname(os.path.realpath(self.preload)), COMPANION), 'rb') as original:
            content = original.read(companion_bytes)
        with open(os.path.join(folder, COMPANION), 'wb') as copy:
            copy.write(content)
        return library

    def companion_size(self):
        return os.path.getsize(os.path.join(os.path.dirname(os.path.realpath(self.preload)), COMPANION))

    def talk(self, library, name):
        """Fifty messages between two nodes with this library; @return the transports and the talker's warnings."""
        topic = self.topic(name)
        listener, talker = (self.peer(role + '_' + name, library) for role in ('listener', 'talker'))
        talker.call('advertise', topic=topic, queue=100)
        listener.call('subscribe', topic=topic, queue=100)
        talker.call('await_subscribers', n=1)
        talker.call('publish', count=50, sizes='100,200000')
        self.assert_complete(listener.call('await_received', seq=50), 50)
        return talker, topic

    def test_half_installed_library_falls_back_to_tcp_with_one_warning(self):
        if not self.preload:
            self.skipTest('without the library there is nothing to install by halves')
        size = self.companion_size()
        # Nothing, a torn and a whole ELF header, a page, most of it, all but the last byte.
        for length in (0, 1, 63, 64, 4096, size // 2, size - 4096, size - 1):
            with self.subTest(length=length):
                library = self.copied_library(length)
                talker, topic = self.talk(library, 'cut_%d' % length)
                self.assertEqual(talker.transports(topic, 'o'), ['TCPROS'])
                said = talker.warnings() + talker.output('its part for roscpp')
                self.assertEqual(len(said), 1, talker.lines)
                self.assertIn('its part for roscpp is incomplete: %s;'
                              % os.path.join(os.path.dirname(library), COMPANION), said[0])

    def test_copy_in_full_length_is_used(self):
        if not self.preload:
            self.skipTest('without the library there is nothing to copy')
        talker, topic = self.talk(self.copied_library(self.companion_size()), 'whole')
        talker.await_transports(topic, 'o', [self.SHM])
        self.assert_no_warning(talker)


if __name__ == '__main__':
    harness.main(UnknownRoscpp)
