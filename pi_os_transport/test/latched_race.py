"""What the tests of the race for a latched message share, on one device and between devices."""
import os

import transport_harness as harness

BRIEF = 10
RACES = 2000 if os.environ.get('PI_EDGE_SOAK') else BRIEF


class Race:
    """A publisher that stops between sending a latched message and remembering it, see peers/latch_race.cpp.

    The case is a TransportTest; start(name, preload) starts a node where the publisher is to run.
    """

    def __init__(self, case, start):
        self.case = case
        self.topic = case.topic('race')
        self.preload = ':'.join(filter(None, [harness.test_library('latch_race'), case.preload]))
        self.talker = start('talker', preload=self.preload)
        self.talker.call('advertise', topic=self.topic, latch=True, queue=100)

    def run(self, listener, await_link, races=RACES, **options):
        """Each race: a message, meanwhile the birth of the listener's link, and one more message as a barrier."""
        for held in range(1, 2 * (races if self.case.preload else BRIEF), 2):
            self.talker.call('publish', count=1, background=True, **options)
            self.talker.result()  # the message has been sent, and is not remembered yet
            listener.call('subscribe', topic=self.topic, queue=100, log=True)
            self.talker.call('join')
            await_link()
            self.talker.call('publish', count=1, **options)
            report = listener.call('await_received', seq=held + 1)
            self.case.assertEqual(report['corrupt'], 0, report)
            if self.case.preload:
                self.case.assertEqual(report['log'], [[1, held], [1, held + 1]], 'message %d' % held)
            else:
                self.case.assertNotIn([1, held], report['log'], 'stock roscpp no longer loses it: end this test')
            listener.call('unsubscribe')
            self.talker.call('await_subscribers', n=0)
