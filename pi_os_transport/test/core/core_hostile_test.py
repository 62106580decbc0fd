#!/usr/bin/python3 -B
"""Judge of core_hostile.test."""
import os
import pathlib
import random
import signal
import socket
import subprocess
import sys
import threading

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import core_harness  # noqa: E402  (found through the line above)
import transport_harness as harness  # noqa: E402

MEGABYTE = 1 << 20


def call_with(value):
    return ('<methodCall><methodName>setParam</methodName><params><param><value>/x</value></param><param><value>/p'
            '</value></param><param>%s</param></params></methodCall>' % value)


class CoreHostile(core_harness.CoreTest):

    def setUp(self):
        super().setUp()
        self.master = self.core()

    def tearDown(self):
        self.assertEqual(self.master.call('getUri'), self.master.uri)  # alive and well
        self.assertEqual([line for line in self.master.lines if 'terminate' in line], [])

    def end(self, command, env=None):
        """(status, stderr) of a program that has to end by itself."""
        result = subprocess.run(command, env=dict(os.environ, ROS_LOG_DIR=self.scratch(), **(env or {})),
                                stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                                timeout=harness.DEADLINE_S)
        return result.returncode, result.stderr

    def test_nonsense(self):
        noise = random.Random(1)
        for count in range(200):
            with self.master.connect() as connection:
                connection.sendall(bytes(noise.randrange(256) for _ in range(noise.randrange(1, 500))))
                connection.shutdown(socket.SHUT_WR)
                while connection.recv(4096):
                    pass

    def test_mutilated_requests(self):
        noise = random.Random(2)
        proper = call_with('<value><struct><member><name>a</name><value><array><data><value><int>1</int></value>'
                           '<value>&lt;x&#65;</value></data></array></value></member></struct></value>').encode()
        for count in range(500):
            body = bytearray(proper)
            for _ in range(noise.randrange(1, 6)):
                at = noise.randrange(len(body))
                body[at:at + noise.randrange(4)] = bytes(noise.randrange(256) for _ in range(noise.randrange(4)))
            status, answer = self.master.post(bytes(body))
            self.assertEqual(status, 200)
            self.assertIn(b'</methodResponse>', answer)

    def test_deep_and_wide_values(self):
        deep = '<value><array><data>' * 100000 + '</data></array></value>' * 100000
        self.assertIn(b'nested deeper', self.master.post(call_with(deep))[1])
        wide = '<value><array><data>' + '<value/>' * 2000000 + '</data></array></value>'
        self.assertIn(b'more than 1000000 values', self.master.post(call_with(wide))[1])
        self.assertIn(b'declaration',
                      self.master.post('<!DOCTYPE a [<!ENTITY b "c">]>' + call_with('<value>&b;</value>'))[1])
        code, message, _ = self.master.api.setParam('/judge', '/a' * 1000, 1)
        self.assertEqual(code, -1)
        self.assertIn('namespaces', message)
        self.assertLess(self.master.resident_kb(), 64 * 1024)

    def test_too_long_requests(self):
        with self.master.connect() as connection:
            connection.sendall(b'POST / HTTP/1.1\r\nContent-Length: 99999999999\r\n\r\n')
            self.assertIn(b' 413 ', connection.recv(4096))
        with self.master.connect() as connection:
            connection.sendall(b'POST / HTTP/1.1\r\nX: ' + b'x' * 20000)
            self.assertIn(b' 431 ', connection.recv(4096))

    def test_half_requests_of_many_clients_take_bounded_memory(self):
        head = b'POST / HTTP/1.1\r\nContent-Length: 60000000\r\n\r\n'
        connections = []
        try:
            for _ in range(20):
                connection = self.master.connect()
                connections.append(connection)
                try:
                    connection.sendall(head + b' ' * (30 * MEGABYTE))
                except OSError:
                    pass  # refused
            self.assertEqual(self.master.call('getUri'), self.master.uri)
            self.assertLess(self.master.resident_kb(), 400 * 1024)
        finally:
            for connection in connections:
                connection.close()
        harness.await_state(lambda: self.master.resident_kb() < 16 * 1024,
                            lambda: '%d kB are still resident' % self.master.resident_kb())

    def test_slow_clients_delay_nobody(self):
        connections = [self.master.connect() for _ in range(100)]
        try:
            for number, connection in enumerate(connections):
                connection.sendall(b'POST / HTTP/1.1\r\nContent-Length: 100\r\n\r\n<met'[:number])
            self.assertEqual(self.master.call('getUri'), self.master.uri)
        finally:
            for connection in connections:
                connection.close()

    def test_clients_that_do_not_listen(self):
        self.master.call('setParam', '/big', 'x' * MEGABYTE)
        request = (b'<methodCall><methodName>getParam</methodName><params><param><value>/x</value></param><param>'
                   b'<value>/big</value></param></params></methodCall>')
        message = b'POST / HTTP/1.1\r\nContent-Length: %d\r\n\r\n' % len(request) + request
        connections = [self.master.connect() for _ in range(20)]
        try:
            for connection in connections:
                connection.sendall(message * 20)
            self.assertEqual(self.master.call('getUri'), self.master.uri)
            self.assertLess(self.master.resident_kb(), 300 * 1024)
        finally:
            for connection in connections:
                connection.close()

    def test_more_connections_than_descriptors(self):
        few = self.core(prefix=('prlimit', '--nofile=256:256'))
        connections = []
        try:
            for _ in range(400):
                connections.append(few.connect())
            self.assertEqual(few.call('getUri'), few.uri)
            node = self.node(few, 'node')
            node.call('advertise', topic=self.topic(), queue=1)
        finally:
            for connection in connections:
                connection.close()
        status, told = self.end(['prlimit', '--nofile=100:100', harness.program('pi_core'), '-p', '0'])
        self.assertEqual(status, 1)
        self.assertIn('ulimit -n', told)

    def test_clients_that_come_and_go(self):
        before = len(harness.open_files(self.master.pid))

        def knock():
            for _ in range(300):
                connection = self.master.connect()
                connection.send(b'POST / HT')
                connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b'\1\0\0\0\0\0\0\0')  # a reset
                connection.close()
        threads = [threading.Thread(target=knock) for _ in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        harness.await_state(lambda: len(harness.open_files(self.master.pid)) <= before + 1,
                            lambda: harness.open_files(self.master.pid))

    def test_port_in_use(self):
        port = str(self.master.address[1])
        status, told = self.end([harness.program('pi_core'), '-p', port])
        self.assertEqual(status, 1)
        self.assertRegex(told, 'pi_core: cannot listen on .* port %s: Address already in use; .*-p\n$' % port)
        self.assertEqual(len(told.strip().split('\n')), 1)

    def test_wrong_settings(self):
        for arguments, env, expected in ((['-p', 'x'], {}, '--port = "x"'), (['--nothing'], {}, '"--nothing"'),
                                         (['-p', '0'], {'ROS_HOSTNAME': 'http://a:1'}, 'ROS_HOSTNAME = "http://a:1"'),
                                         (['-p', '0', '--announce', '77'], {}, '--announce = 77')):
            status, told = self.end([harness.program('pi_core')] + arguments, env)
            self.assertEqual(status, 1)
            self.assertIn('pi_core: ' + expected, told)
            self.assertEqual(len(told.strip().split('\n')), 1)

    def test_without_a_log_folder(self):
        core = self.core(env={'ROS_LOG_DIR': '/proc/nowhere'})
        harness.await_state(lambda: core.output('/rosout is not written to a file: .*/proc/nowhere.*ROS_LOG_DIR'),
                            core.lines)
        self.assertEqual(core.call('lookupNode', '/rosout')[:7], 'http://')
        quiet = self.core(env={'ROS_LOG_DIR': '/proc/nowhere', 'ROSOUT_DISABLE_FILE_LOGGING': '1'})
        self.assertEqual(quiet.call('getUri'), quiet.uri)
        self.assertEqual(quiet.output('nowhere'), [])

    def test_ends_at_signals_and_on_request(self):
        for end in (signal.SIGINT, signal.SIGTERM, None):
            core = self.core()
            with core.connect() as connection:
                connection.send(b'POST / HT')
                if end:
                    core.signal(end)
                else:
                    self.assertEqual(core.api.shutdown('/judge', 'the test is over'), [1, 'shutdown', 0])
                self.assertEqual(core.wait(), 0)

    def test_a_log_that_nobody_writes_to(self):
        """A node that connects to /rosout_agg and says nonsense, and one that publishes nonsense on /rosout."""
        port = core_harness.xmlrpc.client.ServerProxy(self.master.call('lookupNode', '/rosout')).requestTopic(
            '/judge', '/rosout_agg', [['TCPROS']])[2][2]
        for nonsense in (b'GET / HTTP/1.1\r\n\r\n', b'\xff\xff\xff\xff', b'\4\0\0\0abcd', b'\0\0\0\0'):
            with socket.create_connection(('localhost', port), timeout=harness.DEADLINE_S) as connection:
                connection.sendall(nonsense)
                while connection.recv(4096):
                    pass
        with socket.socket() as server:
            server.bind(('localhost', 0))
            server.listen()
            server.settimeout(harness.DEADLINE_S)
            api = self.slave()
            api._server.register_function(
                lambda *_: [1, '', ['TCPROS', 'localhost', server.getsockname()[1]]], 'requestTopic')
            self.master.call('registerPublisher', '/rosout', 'rosgraph_msgs/Log', api.uri)
            for nonsense in (b'\xff\xff\xff\xff', b'\0\0\0\0\x03\0\0\0abc\xff\xff\xff\x7f'):
                connection, _ = server.accept()
                connection.settimeout(harness.DEADLINE_S)
                with connection:
                    connection.sendall(nonsense)
                    while connection.recv(4096):
                        pass
            self.master.call('unregisterPublisher', '/rosout', api.uri)


if __name__ == '__main__':
    harness.main(CoreHostile)
