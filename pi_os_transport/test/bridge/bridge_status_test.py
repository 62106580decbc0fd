#!/usr/bin/python3 -B
"""Judge of bridge_status.test. It plays the bridge itself, and is a ROS node to read /diagnostics."""
import copy
import json
import os
import pathlib
import queue
import socket
import struct
import subprocess
import sys
import threading

import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import transport_harness as harness  # noqa: E402  (found through the line above)

REQUEST = struct.pack('<IHH', 0x514f6970, 2, 3)
STATUS = {
    'version': 1, 'name': 'robot', 'instance': '17', 'listen': ['0.0.0.0:8814'], 'wire': 'sp', 'secure': 'off',
    'pool': {'committed': 3 << 20, 'limit': 512 << 20},
    'refused': {'unknown_peer': 0, 'wrong_version': 0, 'oversized': 0, 'malformed': 0, 'bad_session': 0,
                'untrusted': 0, 'no_service': 0},
    'peers': [{'address': '10.0.0.2:8814', 'name': 'base', 'identity': '', 'state': 'up', 'rtt_us': 230,
               'window': 65536, 'sent_bytes': 5000, 'received_bytes': 70}],
    'outgoing': [{'topic': '/image', 'publisher': '/camera', 'peer': '10.0.0.2:8814', 'subscribers': 2, 'messages': 10,
                  'bytes': 62200000, 'superseded': 1, 'rate_limited': 2, 'uncompressed': 0, 'lost': 0}],
    'incoming': [{'topic': '/cmd_vel', 'publisher': '/joy', 'subscriber': '/base', 'peer': '10.0.0.2:8814',
                  'carrying': 1, 'messages': 7, 'bytes': 336, 'dropped': 0, 'lost': 0, 'paused': 1}],
    'tunnels': [{'target': '10.0.0.2:34567', 'peer': '10.0.0.2:8814', 'state': 'open', 'sent_bytes': 12,
                 'received_bytes': 34}],
}


def memory_file(content):
    descriptor = os.memfd_create('status')
    os.write(descriptor, content)
    return descriptor


class FakeBridge:
    """Answers each request with the next of `answers`, the last one for ever. An answer is a status, raw (packet,
    content of the file or None), or None for a bridge that says nothing."""

    def __init__(self, name, *answers):
        self.requests = []
        self.answers = list(answers)
        self._held = []
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._listener.settimeout(None)  # rospy sets one for all, and accept() with one does not see a shutdown
        self._listener.bind('\0pi_os_bridge/%d/%s' % (os.geteuid(), name))
        self._listener.listen(8)
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _serve(self):
        while True:
            try:
                channel, _ = self._listener.accept()
            except OSError:
                return
            self.requests.append(channel.recv(64))
            answer = self.answers.pop(0) if len(self.answers) > 1 else self.answers[0]
            if answer is None:
                self._held.append(channel)
                continue
            packet, content = answer if isinstance(answer, tuple) else (REQUEST, json.dumps(answer).encode())
            if packet is not None:
                files = [] if content is None else [memory_file(content)]
                socket.send_fds(channel, [packet], files)
                for descriptor in files:
                    os.close(descriptor)
            channel.close()

    def close(self):
        try:
            self._listener.shutdown(socket.SHUT_RDWR)
        except OSError:
            pass
        self._thread.join(harness.DEADLINE_S)
        self._listener.close()
        for channel in self._held:
            channel.close()


def changed(**changes):
    """STATUS with changes of its tables: peers={'state': 'down'} changes the first peer."""
    status = copy.deepcopy(STATUS)
    for table, fields in changes.items():
        if isinstance(fields, dict):
            (status[table] if isinstance(status[table], dict) else status[table][0]).update(fields)
        else:
            status[table] = fields
    return status


class BridgeStatus(harness.TransportTest):

    def setUp(self):
        super().setUp()
        self.socket_name = self.unique('bridge') + '_%d' % os.getpid()

    def bridge(self, *answers):
        bridge = FakeBridge(self.socket_name, *answers)
        self.addCleanup(bridge.close)
        return bridge

    def pi_os(self, *arguments, environment=None):
        return subprocess.run([harness.program('pi_os'), *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                              timeout=harness.DEADLINE_S, universal_newlines=True,
                              env=dict(os.environ, **(environment or {})))

    def assert_fails(self, *parts):
        result = self.pi_os('status', '--socket', self.socket_name)
        self.assertEqual((result.returncode, result.stdout), (1, ''), result.stderr)
        self.assertEqual(result.stderr.count('\n'), 1, result.stderr)
        for part in ('socket "%s"' % self.socket_name,) + parts:
            self.assertIn(part, result.stderr)

    def row(self, text, first):
        """Cells of the only line that begins with `first`."""
        rows = [line.split() for line in text.splitlines() if line.split()[:1] == [first]]
        self.assertEqual(len(rows), 1, text)
        return rows[0]

    def test_json_is_what_the_bridge_said(self):
        bridge = self.bridge(STATUS)
        result = self.pi_os('status', '--json', '--socket', self.socket_name)
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertEqual(json.loads(result.stdout), STATUS)
        self.assertEqual(bridge.requests, [REQUEST])

    def test_tables_show_every_counter(self):
        self.bridge(changed(refused={'oversized': 4}))
        result = self.pi_os('status', environment={'PI_OS_BRIDGE': self.socket_name})
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertIn('robot: listening at 0.0.0.0:8814 (sp), 3.0 of 512 MiB', result.stdout)
        self.assertIn('refused frames: 4 oversized\n', result.stdout)
        self.assertEqual(self.row(result.stdout, '10.0.0.2:8814'),
                         ['10.0.0.2:8814', 'base', 'up', '230', '65.5k', '5k', '70'])
        self.assertEqual(self.row(result.stdout, '/image'),
                         ['/image', '/camera', '10.0.0.2:8814', '2', '10', '62.2M', '1', '2', '0'])
        self.assertEqual(self.row(result.stdout, '/cmd_vel'),
                         ['/cmd_vel', '/joy', '/base', '10.0.0.2:8814', '7', '336', '0', '0', 'paused'])
        self.assertEqual(self.row(result.stdout, '10.0.0.2:34567'),
                         ['10.0.0.2:34567', '10.0.0.2:8814', 'open', '12', '34'])

    def test_idle_bridge_has_empty_tables(self):
        self.bridge(changed(peers=[], outgoing=[], incoming=[], tunnels=[]))
        result = self.pi_os('status', '--socket', self.socket_name)
        self.assertEqual(result.returncode, 0, result.stderr)
        for table in ('refused frames', 'peers', 'outgoing', 'incoming', 'tunnels'):
            self.assertIn(table + ': none', result.stdout)

    def test_status_larger_than_a_socket_buffer(self):
        links = [dict(STATUS['outgoing'][0], topic='/topic_%d' % i) for i in range(5000)]
        self.bridge(changed(outgoing=links))
        result = self.pi_os('status', '--json', '--socket', self.socket_name)
        self.assertEqual(len(json.loads(result.stdout)['outgoing']), 5000)

    def test_watch_shows_growth(self):
        # Much growth: what happens beside it may stretch the second.
        later = changed(outgoing={'messages': 10 + 100000, 'lost': 300000}, refused={'malformed': 50000})
        self.bridge(STATUS, later)
        result = self.pi_os('watch', '--count', '2', '--socket', self.socket_name)
        self.assertEqual(result.returncode, 0, result.stderr)
        first, second = result.stdout.split('\n\nrobot: ')
        cells = self.row(first, '/image')
        self.assertEqual(cells[4][-1] + cells[8][-1], 'kk', first)
        self.assertAlmostEqual(float(cells[8][:-1]) / float(cells[4][:-1]), 3.0, delta=0.1)
        self.assertEqual(cells[5:8], ['0', '0', '0'])
        self.assertIn('malformed', first)
        self.assertEqual(self.row(second, '/image')[4:], ['0'] * 5)
        self.assertIn('refused frames per second: none', second)

    def test_watch_counts_a_restarted_bridge_from_zero(self):
        self.bridge(STATUS, changed(instance='18', outgoing={'messages': 0, 'bytes': 50000000}))
        result = self.pi_os('watch', '--count', '1', '--socket', self.socket_name)
        self.assertEqual(self.row(result.stdout, '/image')[4], '0')
        self.assertEqual(self.row(result.stdout, '/image')[5][-1], 'M', result.stdout)

    def test_no_bridge(self):
        self.assert_fails('no bridge answers', 'roslaunch pi_os_transport bridge.launch', '--socket')

    def test_silent_bridge(self):
        self.bridge(None)
        self.assert_fails('gave no answer within 2 s', 'restart it')

    def test_bridge_that_hangs_up(self):
        self.bridge((None, None))
        self.assert_fails('restart it')

    def test_answers_that_are_no_status(self):
        good = json.dumps(STATUS).encode()
        for packet, content, expected in ((REQUEST[:7], good, 'must be a status of version 2'),
                                          (b'\0' + REQUEST[1:], good, 'must be a status of version 2'),
                                          (REQUEST + b'\0', good, 'must be a status of version 2'),
                                          (REQUEST, None, 'with 0 files'),
                                          (REQUEST, b'', 'no JSON object'),
                                          (REQUEST, b'[1]', 'no JSON object'),
                                          (REQUEST, b'\xff{', 'no JSON object'),
                                          (REQUEST, b'{"version":2}', 'status of version 2, must be 1'),
                                          (REQUEST, b'{"version":1}', 'must be an object with name')):
            with self.subTest(packet=packet, content=content):
                bridge = FakeBridge(self.socket_name, (packet, content))
                try:
                    self.assert_fails(expected)
                finally:
                    bridge.close()

    @harness.needs_root
    def test_bridge_of_another_user(self):
        stranger = self.process(['setpriv', '--reuid=65534', '/usr/bin/python3', '-c', '''
import socket, sys
s = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
s.bind("\\0" + sys.argv[1])
s.listen(1)
print("@{}", flush=True)
sys.stdin.read()''', 'pi_os_bridge/%d/%s' % (os.geteuid(), self.socket_name)], preload='')
        stranger.answer()
        self.assert_fails('process of user 65534', 'must be of the same user')

    # ------------------------------------------------------------------------------------------------ diagnostics

    def diagnostics(self):
        """Starts the node. @return a function that waits for a message whose statuses satisfy a condition."""
        arrived = queue.Queue()
        subscriber = rospy.Subscriber('/diagnostics', DiagnosticArray, arrived.put)
        self.addCleanup(subscriber.unregister)
        node = self.process([harness.program('pi_os'), 'diagnostics', '--socket', self.socket_name,
                             '__name:=' + self.unique('diagnostics')], preload='')

        def await_status(name, level, text=''):
            seen = None
            for _ in range(30):
                message = arrived.get(timeout=harness.DEADLINE_S)
                self.assertGreater(message.header.stamp.to_sec(), 0)
                found = {status.name: status for status in message.status}
                seen = found.get('pi_os_bridge: ' + name)
                if seen is not None and seen.level == level and text in seen.message:
                    return found
            raise AssertionError('%s did not become %d "%s": %s; %s' % (name, level, text, seen, node.lines))
        return await_status

    def test_diagnostics_follow_the_bridge(self):
        ok, warn, error = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
        bridge = self.bridge(changed(refused={'oversized': 5}, outgoing={'lost': 9}))
        await_status = self.diagnostics()
        # What was lost and refused before the node came is no news.
        found = await_status('process', ok, '0.0.0.0:8814')
        self.assertEqual({status.level for status in found.values()}, {ok}, found)
        self.assertEqual({status.hardware_id for status in found.values()}, {'robot'})
        values = {pair.key: pair.value for pair in found['pi_os_bridge: peer 10.0.0.2:8814'].values}
        self.assertEqual((values['name'], values['rtt [us]']), ('base', '230'))
        for state in ('connecting', 'silent', 'hung', 'down'):
            bridge.answers = [changed(refused={'oversized': 5}, outgoing={'lost': 9}, peers={'state': state})]
            await_status('peer 10.0.0.2:8814', warn, 'is %s, must be up' % state)
        bridge.answers = [changed(refused={'oversized': 5}, outgoing={'lost': 12}, incoming={'lost': 1})]
        found = await_status('losses', warn, '4 messages lost')
        self.assertEqual(found['pi_os_bridge: peer 10.0.0.2:8814'].level, ok)
        self.assertEqual(found['pi_os_bridge: refused'].level, ok)
        bridge.answers = [changed(refused={'oversized': 5, 'bad_session': 2}, outgoing={'lost': 12})]
        await_status('refused', warn, '2 frames refused')
        bridge.close()
        found = await_status('process', error, 'no bridge answers')
        self.assertEqual(len(found), 1, found)
        self.bridge(STATUS)
        found = await_status('process', ok)
        self.assertEqual({status.level for status in found.values()}, {ok}, found)

    def test_warning_about_growth_ends(self):
        bridge = self.bridge(STATUS)
        await_status = self.diagnostics()
        await_status('losses', DiagnosticStatus.OK)
        bridge.answers = [changed(incoming={'lost': 3})]
        await_status('losses', DiagnosticStatus.WARN, '3 messages lost')
        await_status('losses', DiagnosticStatus.OK)


if __name__ == '__main__':
    rospy.init_node('bridge_status_judge', anonymous=True, disable_signals=True)
    harness.main(BridgeStatus, plain=False)
