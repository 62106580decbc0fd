#!/usr/bin/python3 -B
"""Judge of switches.test."""
import pathlib
import sys

import rosgraph

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import transport_harness as harness  # noqa: E402  (found through the line above)


class Switches(harness.TransportTest):

    def check(self, transport, topic=None, talker_env=None, listener_env=None, talker_args=(), sizes='100,50000'):
        """The link has the transport when a message has arrived and once 100 more have; returns both nodes."""
        topic = topic or self.topic()
        talker = self.peer('talker', env=talker_env, args=talker_args)
        listener = self.peer('listener', env=listener_env)
        talker.call('advertise', topic=topic, queue=1000)
        listener.call('subscribe', topic=topic, queue=1000)
        talker.call('await_subscribers', n=1)
        if transport != 'TCPROS':
            self.link(talker, listener, topic, transport)
        talker.call('publish', count=100, rate=500, sizes=sizes)
        self.assert_complete(listener.call('await_received', seq=100), 100)
        self.assertEqual(talker.transports(topic, 'o'), [transport])
        self.assertEqual(listener.transports(topic, 'i'), [transport])
        return talker, listener

    def parameter(self, name, value):
        master = rosgraph.Master('/judge')
        master.setParam(name, value)
        self.addCleanup(master.deleteParam, name)

    def test_no_switch(self):
        self.check('SHMROS')

    def test_publisher_off(self):
        self.assert_no_warning(*self.check('TCPROS', talker_env={'PI_OS_ENABLE': '0'}))

    def test_subscriber_off(self):
        self.assert_no_warning(*self.check('TCPROS', listener_env={'PI_OS_ENABLE': '0'}))

    def test_excluded_topic(self):
        topic = self.topic('camera/image_raw')
        self.check('TCPROS', topic, talker_env={'PI_OS_EXCLUDE': '/tf*,/camera/*'})

    def test_topic_beside_the_excluded(self):
        self.check('SHMROS', self.topic('lidar/points'), talker_env={'PI_OS_EXCLUDE': '/tf*,/camera/*'})

    def test_topic_excluded_by_the_subscriber(self):
        self.check('TCPROS', self.topic('camera/image_raw'), listener_env={'PI_OS_EXCLUDE': '/camera/*'})

    def test_included_topic(self):
        self.check('SHMROS', self.topic('camera/image_raw'), talker_env={'PI_OS_INCLUDE': '/camera/*'})

    def test_topic_not_included(self):
        self.check('TCPROS', self.topic('lidar/points'), talker_env={'PI_OS_INCLUDE': '/camera/*,/imu*'})

    def test_exclude_wins_over_include(self):
        self.check('TCPROS', self.topic('camera/image_raw'),
                   talker_env={'PI_OS_INCLUDE': '/camera/*', 'PI_OS_EXCLUDE': '*image_raw*'})

    def test_small_messages_beside_large_ones_keep_the_order(self):
        self.check('SHMROS', talker_env={'PI_OS_MIN_BYTES': '10000'}, sizes='100,50000,0,9000,11000')

    def test_parameter_off(self):
        self.parameter('/pi_os/enable', False)
        self.check('TCPROS')

    def test_environment_wins_over_the_parameter(self):
        self.parameter('/pi_os/enable', False)
        self.check('SHMROS', talker_env={'PI_OS_ENABLE': '1'}, listener_env={'PI_OS_ENABLE': '1'})

    def test_parameter_of_one_node(self):
        self.check('TCPROS', talker_args=['_pi_os/enable:=false'])

    def test_excluded_by_parameter(self):
        self.parameter('/pi_os/exclude', '/camera/*')
        self.check('TCPROS', self.topic('camera/image_raw'))

    def check_bad_value(self, name, value):
        topic = self.topic()
        talker, listener = self.peer('talker', env={name: value}), self.peer('listener')
        talker.call('advertise', topic=topic, queue=100)
        listener.call('subscribe', topic=topic, queue=100)
        talker.call('await_subscribers', n=1)
        talker.call('publish', count=20, sizes='100,50000')
        self.assert_complete(listener.call('await_received', seq=20), 20)
        said = talker.output(name)
        self.assertEqual(len(said), 1, talker.lines)
        self.assertIn(value, said[0])
        self.assertEqual(listener.warnings(), [])

    def test_pool_limit_that_is_no_number(self):
        self.check_bad_value('PI_OS_POOL_LIMIT_MB', 'abc')

    def test_negative_pool_limit(self):
        self.check_bad_value('PI_OS_POOL_LIMIT_MB', '-5')

    def test_switch_that_is_neither_on_nor_off(self):
        self.check_bad_value('PI_OS_ENABLE', 'maybe')

    def test_threshold_that_is_no_number(self):
        self.check_bad_value('PI_OS_MIN_BYTES', '12kB')


if __name__ == '__main__':
    harness.main(Switches, plain=False, needs_library=True)
