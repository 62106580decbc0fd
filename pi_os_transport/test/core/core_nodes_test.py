#!/usr/bin/python3 -B
"""Judge of core_nodes.test."""
import glob
import os
import pathlib
import re
import signal
import subprocess
import sys
import unittest

import yaml

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import core_harness  # noqa: E402  (found through the line above)
import transport_harness as harness  # noqa: E402

LAUNCH = """
<launch>
  <param name="number" value="5"/>
  <rosparam>
    tree: {list: [1, 2.5, text, true], deep: {deeper: {deepest: ä}}}
  </rosparam>
  <group ns="group">
    <node name="relay" pkg="topic_tools" type="relay" args="/in out">
      <param name="own" value="private"/>
    </node>
  </group>
</launch>
"""


TOOL_DEADLINE_S = 4 * harness.DEADLINE_S  # for programs of Python, which load a hundred modules first


class CoreNodes(core_harness.CoreTest):

    def test_roslaunch_and_the_tools(self):
        core = self.core()
        path = os.path.join(self.scratch(), 'test.launch')
        with open(path, 'w') as file:
            file.write(LAUNCH)
        launch = self.process(['roslaunch', '--disable-title', path], env=core.environment)
        self.addCleanup(self.end, launch)
        harness.await_state(lambda: '/group/relay' in core.run('rosnode', 'list').split(), lambda: launch.lines,
                            TOOL_DEADLINE_S)
        self.assertEqual(core.run('rosparam', 'get', '/number').strip(), '5')
        tree = yaml.safe_load(core.run('rosparam', 'get', '/tree'))
        self.assertEqual(tree, {'list': [1, 2.5, 'text', True], 'deep': {'deeper': {'deepest': 'ä'}}})
        self.assertEqual(core.call('getParam', '/group/relay/own'), 'private')
        self.assertIn('/run_id', core.run('rosparam', 'list').split())
        self.assertEqual(core.call('getParam', '/rosversion'), core.run('rosversion', 'roslaunch').strip() + '\n')
        self.assertEqual(core.call('getParam', '/rosdistro'), core.run('rosversion', '-d').strip() + '\n')
        self.assertIn('/in', core.run('rosnode', 'info', '/group/relay'))
        core.run('rosnode', 'ping', '-c', '1', '/group/relay')
        core.run('rosnode', 'ping', '-c', '1', '/rosout')
        self.assertIn('/group/relay/get_loggers', core.run('rosservice', 'list').split())
        # Only its type: Debian's relay crashes when get_loggers is called, whoever the master is.
        self.assertEqual(core.run('rosservice', 'type', '/group/relay/get_loggers').strip(), 'roscpp/GetLoggers')
        publisher = self.process(['rostopic', 'pub', '-r', '20', '/in', 'std_msgs/String', 'data: hello'],
                                 env=core.environment)
        self.assertIn('hello', core.run('rostopic', 'echo', '-n', '1', '/group/out'))
        self.assertIn('std_msgs/String', core.run('rostopic', 'info', '/group/out'))
        publisher.close()  # killed: it stays registered
        self.assertIn('/in', [topic for topic, _ in core.call('getPublishedTopics', '')])
        core.run('sh', '-c', 'echo y | rosnode cleanup')
        self.assertNotIn('/in', [topic for topic, _ in core.call('getPublishedTopics', '')])
        launch.signal(signal.SIGINT)
        self.assertEqual(launch.wait(TOOL_DEADLINE_S), 0)
        harness.await_state(lambda: '/group/relay' not in core.run('rosnode', 'list').split(), lambda: core.lines,
                            TOOL_DEADLINE_S)

    @staticmethod
    def end(launch):
        """With its nodes, which else would live on."""
        if launch.alive():
            launch.signal(signal.SIGINT)
            launch.wait(TOOL_DEADLINE_S)

    def test_roscpp_and_rospy_find_each_other(self):
        core = self.core()
        topic = self.topic()
        for publisher, subscriber in (('test_peer', 'rospy'), ('rospy', 'test_peer'), ('test_peer', 'test_peer')):
            with self.subTest('%s to %s' % (publisher, subscriber)):
                listener = self.node(core, 'listener_' + publisher, kind=subscriber)
                talker = self.node(core, 'talker_' + subscriber, kind=publisher)
                listener.call('subscribe', topic=topic, queue=100)
                talker.call('advertise', topic=topic, queue=100)
                talker.call('await_subscribers', n=1)
                talker.call('publish', count=50, rate=500, sizes=100)
                self.assert_complete(listener.call('await_received', n=50), 50)
                talker.exit()
                listener.exit()

    def test_the_log_of_all_nodes(self):
        core = self.core()
        echo = self.process(['rostopic', 'echo', '/rosout_agg/msg'], env=core.environment)
        harness.await_state(lambda: any('rostopic' in link[1] for link in self.rosout(core).getBusInfo('/judge')[2]),
                            lambda: echo.lines, TOOL_DEADLINE_S)
        talker = self.process(['python3', '-c', 'import rospy, sys\n'
                               'rospy.init_node("speaker", anonymous=True)\n'
                               'for line in sys.stdin: rospy.logerr(line.strip())\n'], env=core.environment)
        harness.await_state(lambda: self.links_of_speaker(core), lambda: talker.lines, TOOL_DEADLINE_S)
        talker.say('said once')
        harness.await_state(lambda: echo.output('said once'), echo.lines)
        path, = glob.glob(os.path.join(core.environment['ROS_LOG_DIR'], '*-*', 'rosout.log'))
        self.assertIn(core.call('getParam', '/run_id'), path)
        self.assertTrue(os.path.samefile(path, os.path.join(core.environment['ROS_LOG_DIR'], 'latest', 'rosout.log')))
        with open(path) as log:
            lines = [line for line in log if 'said once' in line]
        self.assertEqual(len(lines), 1)
        self.assertRegex(lines[0], r'^\d+\.\d{9} ERROR /speaker_\S+ \[.*\] \[topics: /rosout\] said once$')
        self.assertIn('rosgraph_msgs/Log', core.run('rostopic', 'type', '/rosout_agg'))
        bag = os.path.join(self.scratch(), 'log.bag')
        recorder = self.process(['rosbag', 'record', '-O', bag, '--lz4', '/rosout_agg'], env=core.environment)
        harness.await_state(lambda: any('record' in link[1] for link in self.rosout(core).getBusInfo('/judge')[2]),
                            lambda: recorder.lines, TOOL_DEADLINE_S)
        talker.say('recorded')
        recorder.signal(signal.SIGINT)
        recorder.wait()

    @staticmethod
    def rosout(core):
        return core_harness.xmlrpc.client.ServerProxy(core.call('lookupNode', '/rosout'))

    def links_of_speaker(self, core):
        speakers = [name for topic, names in core.call('getSystemState')[0] if topic == '/rosout'
                    for name in names if 'speaker' in name]
        uris = [core.call('lookupNode', name) for name in speakers]
        return uris and any(link[1] in uris and link[5] for link in self.rosout(core).getBusInfo('/judge')[2])

    def test_stopped_node_delays_nobody_and_catches_up(self):
        core = self.core()
        stopped, awake = self.node(core, 'stopped'), self.node(core, 'awake')
        topic = self.topic()
        stopped.call('subscribe', topic=topic, queue=100)
        awake.call('subscribe', topic=topic, queue=100)
        stopped.signal(signal.SIGSTOP)
        self.addCleanup(stopped.signal, signal.SIGCONT)
        talker = self.node(core, 'talker')
        talker.call('advertise', topic=topic, queue=100)
        talker.call('await_subscribers', n=1)
        talker.call('publish', count=10, rate=500, sizes=100)
        self.assert_complete(awake.call('await_received', n=10), 10)
        stopped.signal(signal.SIGCONT)
        talker.call('await_subscribers', n=2)

    def test_killed_node_is_replaced_by_one_of_its_name(self):
        core = self.core()
        name = self.unique('same')
        # roscpp goes on registering from a thread for a while; rospy has done it all when init_node() returns.
        command = ['python3', '-c', 'import rospy\nrospy.init_node("%s")\nprint("ready", flush=True)\nrospy.spin()' % name]
        first = self.process(command, env=core.environment)
        harness.await_state(lambda: first.output('ready'), lambda: first.lines, TOOL_DEADLINE_S)
        second = self.process(command, env=core.environment)
        self.assertEqual(first.wait(TOOL_DEADLINE_S), 0)  # told to shut down
        harness.await_state(lambda: second.output('ready'), lambda: second.lines, TOOL_DEADLINE_S)
        self.assertTrue(second.alive())
        topic = self.topic()
        second.kill()
        third = self.node(core, 'same')
        third.call('advertise', topic=topic, queue=100)
        listener = self.node(core, 'listener')
        listener.call('subscribe', topic=topic, queue=100)
        third.call('await_subscribers', n=1)
        third.call('publish', count=5, rate=500, sizes=100)
        self.assert_complete(listener.call('await_received', n=5), 5)

    def test_parameter_callbacks_in_their_order(self):
        core = self.core()
        slave = self.slave()
        core.api.subscribeParam('/listener', slave.uri, '/p')
        told = []
        for number in range(50):
            core.call('setParam', '/p', number)
            told.append(('paramUpdate', '/p/', number))
            slave.await_told(told)
        slave.answers['paramUpdate'] = [-1, 'not subscribed', 0]
        core.call('setParam', '/p', 'last')
        told.append(('paramUpdate', '/p/', 'last'))
        slave.await_told(told)
        other = self.slave()
        core.api.subscribeParam('/other', other.uri, '/p')
        core.call('setParam', '/p', 'unheard')
        other.await_told([('paramUpdate', '/p/', 'unheard')])
        slave.await_told(told)

    def test_a_thousand_topics(self):
        core = self.core()
        slave = self.slave()
        topics = ['/topic_%d' % number for number in range(1000)]
        for topic in topics:
            core.call('registerSubscriber', topic, 'std_msgs/String', slave.uri)
        for topic in topics:
            self.assertEqual(core.api.registerPublisher('/talker', topic, 'std_msgs/String', 'http://localhost:1/'),
                             [1, 'Registered [/talker] as publisher of [%s]' % topic, [slave.uri]])
        with slave.changed:
            self.assertTrue(slave.changed.wait_for(lambda: len(slave.told) == len(topics), harness.DEADLINE_S))
        self.assertEqual(slave.told, [('publisherUpdate', topic, ['http://localhost:1/']) for topic in topics])
        for publishers in core.call('getSystemState')[0]:
            if publishers[0] in topics:
                self.assertEqual(publishers[1], ['/talker'])

    @unittest.skipUnless(os.path.exists('/proc/self/smaps_rollup'), 'the kernel does not tell of memory')
    def test_takes_little_memory(self):
        core = self.core()
        node = self.node(core, 'node')
        node.call('advertise', topic=self.topic(), queue=100)
        self.assertLess(core.resident_kb(), 4096)
        self.assertLess(core.proportional_kb(), 4096)
        self.assertEqual(harness.thread_count(core.pid), 1)

    def test_pi_master_serves_roslaunch_as_rosmaster(self):
        """roslaunch starts what is called rosmaster on PATH."""
        folder = self.scratch()
        os.symlink(harness.program('pi_master'), os.path.join(folder, 'rosmaster'))
        environment = dict(os.environ, PATH=folder + ':' + os.environ['PATH'], ROS_LOG_DIR=self.scratch(),
                           ROS_MASTER_URI='http://localhost:%d/' % free_port())
        environment.pop('LD_PRELOAD', None)
        launch = subprocess.Popen(['roslaunch', '--disable-title', '-'], env=environment, stdin=subprocess.PIPE,
                                  stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        self.addCleanup(launch.stdout.close)
        self.addCleanup(launch.kill)
        launch.stdin.write('<launch><node name="relay" pkg="topic_tools" type="relay" args="a b"/></launch>')
        launch.stdin.close()
        launch.stdin = None  # communicate() would flush it
        master = core_harness.xmlrpc.client.ServerProxy(environment['ROS_MASTER_URI'])

        def nodes():
            try:
                return master.lookupNode('/judge', '/relay')[0] == 1 and master.lookupNode('/judge', '/rosout')[0] == 1
            except OSError:
                return False
        harness.await_state(nodes, 'the nodes are not registered', TOOL_DEADLINE_S)
        self.assertEqual(os.path.basename(os.readlink('/proc/%d/exe' % master.getPid('/judge')[2])), 'pi_master')
        launch.send_signal(signal.SIGINT)
        output, _ = launch.communicate(timeout=TOOL_DEADLINE_S)
        self.assertEqual(launch.returncode, 0, output)
        self.assertFalse(re.search('(?i)traceback|escalating', output), output)


def free_port():
    with core_harness.socket.socket() as probe:
        probe.bind(('localhost', 0))
        return probe.getsockname()[1]


if __name__ == '__main__':
    harness.main(CoreNodes)
