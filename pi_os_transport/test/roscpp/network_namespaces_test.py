#!/usr/bin/python3 -B
"""Judge of network_namespaces.test."""
import os
import pathlib
import socket
import subprocess
import sys
import xmlrpc.client

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import transport_harness as harness  # noqa: E402  (found through the line above)

HERE, THERE = '10.213.77.1', '10.213.77.2'


@harness.needs_root
class NetworkNamespaces(harness.TransportTest):

    def setUp(self):
        super().setUp()
        # A shell in a namespace of its own keeps it; the veth pair goes with it.
        possible = subprocess.run(['unshare', '-n', 'true'], stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        if possible.returncode != 0:
            self.skipTest('no network namespace of its own here: %s' % possible.stdout.decode().strip())
        self.keeper = self.process(['unshare', '-n', 'sh', '-c', 'echo @{}; read line'], preload='')
        self.keeper.answer()
        here, there = 'piost%da' % (os.getpid() % 100000), 'piost%db' % (os.getpid() % 100000)
        inside = ['nsenter', '-t', str(self.keeper.pid), '-n']
        made = subprocess.run(['ip', 'link', 'add', here, 'type', 'veth', 'peer', 'name', there],
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        if made.returncode != 0:
            self.skipTest('no veth pair on this kernel: %s' % made.stdout.decode().strip())
        self.addCleanup(subprocess.run, ['ip', 'link', 'del', here], stderr=subprocess.DEVNULL)
        for command in (['ip', 'link', 'set', there, 'netns', str(self.keeper.pid)],
                        ['ip', 'addr', 'add', HERE + '/30', 'dev', here], ['ip', 'link', 'set', here, 'up'],
                        inside + ['ip', 'addr', 'add', THERE + '/30', 'dev', there],
                        inside + ['ip', 'link', 'set', there, 'up'], inside + ['ip', 'link', 'set', 'lo', 'up']):
            subprocess.run(command, check=True)
        self.inside = inside
        # The master of rostest may listen on the loopback only.
        with socket.socket() as probe:
            probe.bind((HERE, 0))
            port = probe.getsockname()[1]
        self.master = 'http://%s:%d' % (HERE, port)
        self.process(['env', '-u', 'ROS_HOSTNAME', harness.program('pi_master'), '-p', str(port)], preload='',
                     env={'ROS_IP': HERE, 'ROS_MASTER_URI': self.master})
        harness.await_state(lambda: self.master_answers(), 'master at ' + self.master)

    def master_answers(self):
        try:
            return xmlrpc.client.ServerProxy(self.master).getPid('/judge')[0] == 1
        except OSError:
            return False

    def node(self, name, address, prefix=()):
        return self.peer(name, prefix=['env', '-u', 'ROS_HOSTNAME'] + list(prefix), master=self.master,
                         env={'ROS_IP': address, 'ROS_MASTER_URI': self.master})

    def test_link_across_namespaces_is_tcp(self):
        topic = self.topic()
        talker = self.node('talker', HERE)
        near = self.node('near', HERE)
        far = self.node('far', THERE, self.inside)
        self.assertNotEqual(os.readlink('/proc/%d/ns/net' % far.pid), os.readlink('/proc/%d/ns/net' % talker.pid))
        talker.call('advertise', topic=topic, queue=1000)
        for listener in (near, far):
            listener.call('subscribe', topic=topic, queue=1000)
        talker.call('await_subscribers', n=2)
        near.await_transports(topic, 'i', [self.SHM])
        talker.call('publish', count=200, rate=400, sizes='100,100000,0,500000')
        for listener in (near, far):
            self.assert_complete(listener.call('await_received', seq=200), 200)
        self.assertEqual(far.transports(topic, 'i'), ['TCPROS'])
        self.assertEqual(talker.transports(topic, 'o'), sorted([self.SHM, 'TCPROS']))


if __name__ == '__main__':
    harness.main(NetworkNamespaces)
