#!/usr/bin/python3 -B
"""Judge of linked_library.test."""
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import transport_harness as harness  # noqa: E402  (found through the line above)


class LinkedLibrary(harness.TransportTest):

    def check(self, talker, listener):
        topic = self.topic()
        talker.call('advertise', topic=topic, queue=100)
        listener.call('subscribe', topic=topic, queue=100)
        self.link(talker, listener, topic)
        talker.call('publish', count=50, sizes='100,200000')
        self.assert_complete(listener.call('await_received', seq=50), 50)
        self.assert_no_warning(talker, listener)

    def test_linked_to_linked(self):
        self.check(self.peer('talker', kind='linked', preload=''), self.peer('listener', kind='linked', preload=''))

    def test_linked_to_preloaded(self):
        self.check(self.peer('talker', kind='linked', preload=''), self.peer('listener'))

    def test_linked_and_preloaded_at_once(self):
        self.check(self.peer('talker', kind='linked'), self.peer('listener', kind='linked'))


if __name__ == '__main__':
    harness.main(LinkedLibrary, plain=False, needs_library=True)
