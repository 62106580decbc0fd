#!/usr/bin/python3 -B
"""Judge of introspection.test. It is a ROS node to read /diagnostics."""
import contextlib
import copy
import json
import os
import pathlib
import pwd
import queue
import re
import resource
import shutil
import signal
import socket
import subprocess
import sys
import threading
from random import Random

import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
import services_judge  # noqa: E402  (found through the line above)
import transport_harness as harness  # noqa: E402

sys.path.insert(0, os.path.join(os.path.dirname(os.path.realpath(__file__)), '..', '..', 'scripts'))
from pi_os_inspect import doctor, graph, processes, tables  # noqa: E402  (found through the line above)


class Introspection(services_judge.ServiceTest):

    def pi_os(self, *words, env=None):
        """What `pi_os words... --json` says of the nodes of this test."""
        run = subprocess.run([harness.program('pi_os')] + list(words) + ['--json'], stdout=subprocess.PIPE,
                             stderr=subprocess.PIPE, text=True, timeout=harness.DEADLINE_S,
                             env=dict(os.environ, **(env or {})))
        self.assertEqual(run.returncode, 0, run.stderr)
        self.complaints = run.stderr
        return json.loads(run.stdout)

    def state(self, peer):
        return next(state for state in self.pi_os('nodes') if state['node'] == peer.name)

    def finding(self, *names, env=None):
        """The one finding of the doctor about all these names."""
        found = [entry for entry in self.pi_os('doctor', env=env) if all(name in entry['what'] for name in names)]
        self.assertEqual(len(found), 1, found)
        self.assertTrue(found[0]['advice'])
        return found[0]

    def assert_finding(self, reason, text, *names, env=None):
        found = self.finding(*names, env=env)
        self.assertEqual(found['reason'], reason, found)
        self.assertIn(text, found['text'])

    def connect(self, talker, listener, **subscription):
        """A link over which a message has come."""
        topic = self.topic()
        talker.call('advertise', topic=topic, queue=100)
        listener.call('subscribe', topic=topic, queue=100, **subscription)
        talker.call('await_subscribers', n=1)
        talker.call('publish', count=1)
        listener.call('await_received', seq=1)
        return topic

    # ------------------------------------------------------------------------------------------------------ counters

    def test_a_link_in_shared_memory(self):
        talker, listener = self.peers('talker', 'listener')
        topic = self.topic()
        talker.call('advertise', topic=topic, queue=100)
        listener.call('subscribe', topic=topic, queue=100)
        self.link(talker, listener, topic)
        talker.call('publish', count=100, rate=500, sizes=100000)
        listener.call('await_received', seq=100)
        out = next(entry for entry in self.state(talker)['publications'] if entry['topic'] == topic)
        into = next(entry for entry in self.state(listener)['subscriptions'] if entry['topic'] == topic)
        self.assertEqual((out['transport'], out['subscriber'], out['reason']), ('SHMROS', listener.name, ''))
        self.assertEqual((into['transport'], into['publisher'], into['reason']), ('SHMROS', talker.name, ''))
        self.assertEqual(out['memory'] + out['tcp'], 100)
        self.assertEqual(into['memory'], out['memory'])
        self.assertEqual(sum(into['latencies']), into['memory'])
        self.assertEqual((out['dropped'], out['waiting'], out['queue_size'], out['pool_full']), (0, 0, 100, 0))
        pool = self.state(talker)['pool']
        self.assertTrue(0 < pool['committed'] <= pool['limit'], pool)
        descriptors = self.state(talker)['descriptors']
        self.assertEqual(descriptors['limit'], resource.prlimit(talker.pid, resource.RLIMIT_NOFILE)[0])
        self.assertEqual(descriptors['open'], len(harness.open_files(talker.pid)) + 1)  # the connection of who asks
        self.assertEqual([entry for entry in self.pi_os('doctor') if topic in entry['what']], [])

    def assert_skipped(self, expected, size, talker=None, listener=None):
        """Of 20 arrays of the size, the listener did not fill so many with zeros before it overwrote them."""
        topic = self.topic('array')
        talker = talker or self.peer('talker')
        listener = listener or self.peer('listener')
        talker.call('advertise', topic=topic, queue=100)
        listener.call('subscribe', topic=topic, queue=100)
        talker.call('await_subscribers', n=1)
        talker.call('publish', count=20, sizes=size)
        self.assert_complete(listener.call('await_received', seq=20), 20)
        self.assertEqual(self.state(listener)['skipped_zero_fills'], expected)

    def test_arrays_that_are_overwritten(self):
        self.assert_skipped(20, 6220800)

    def test_arrays_that_are_overwritten_from_tcpros(self):
        self.assert_skipped(20, 1000000, talker=self.peer('talker', preload=''))

    def test_short_arrays_are_filled(self):
        self.assert_skipped(0, 65535)

    def test_arrays_are_filled_with_the_switch_off(self):
        self.assert_skipped(0, 6220800, listener=self.peer('listener', env={'PI_OS_SKIP_ZERO_FILL': '0'}))
        listener = self.peer('listener_of_parameter', args=['_pi_os/skip_zero_fill:=false'])
        self.assert_skipped(0, 6220800, talker=self.peer('another_talker'), listener=listener)

    def test_drops_and_queue_of_a_slow_subscriber(self):
        talker, = self.peers('talker')
        listener = self.peer('listener', threads=2)
        topic = self.topic()
        talker.call('advertise', topic=topic, queue=5)
        listener.call('subscribe', topic=topic, queue=500, hold=True)
        self.link(talker, listener, topic)
        listener.signal(signal.SIGSTOP)
        talker.call('publish', count=40, sizes=1000000)
        out = next(entry for entry in self.state(talker)['publications'] if entry['topic'] == topic)
        self.assertGreater(out['dropped'], 0, out)
        self.assertGreater(out['waiting'], 0, out)
        self.assertEqual(out['queue_size'], 5)
        listener.signal(signal.SIGCONT)

    def test_services(self):
        server, client = self.pair()
        self.start_calls(client, rate=500)
        client.call('await_calls', n=100)
        for peer, table, others in ((client, 'service_clients', []), (server, 'service_servers', [client.name])):
            self.assertEqual([(entry['connections'], entry['peers']) for entry in self.state(peer)[table]
                              if entry['service'] == self.service], [(1, others)])
        report = client.call('stop_calls')
        called = next(entry for entry in self.state(client)['service_clients'] if entry['service'] == self.service)
        served = next(entry for entry in self.state(server)['service_servers'] if entry['service'] == self.service)
        self.assertEqual(called['memory'] + called['tcp'], report['calls'])
        self.assertGreaterEqual(called['memory'], 100)
        self.assertEqual((served['memory'], served['tcp']), (called['memory'], called['tcp']))
        for entry in (called, served):
            self.assertEqual(sum(entry['durations']), entry['memory'])
            self.assertEqual(entry['failed'], 0)
        self.assertEqual([entry for entry in self.pi_os('doctor') if self.service in entry['what']], [])

    def test_single_shot_calls(self):
        server, client = self.pair()
        report = client.call('call', service=self.service, count=300)
        self.assertEqual((report['failed'], report['wrong']), (0, 0), report)
        called = next(entry for entry in self.state(client)['service_clients'] if entry['service'] == self.service)
        served = next(entry for entry in self.state(server)['service_servers'] if entry['service'] == self.service)
        self.assertEqual(called['memory'] + called['tcp'], 300)
        self.assertGreaterEqual(called['memory'], 200)    # the first ones go before the shared memory is there
        self.assertEqual(served['memory'], called['memory'])
        self.assertEqual((called['failed'], served['failed']), (0, 0))

    def test_a_node_that_stands_still_is_named(self):
        talker, = self.peers('talker')
        talker.signal(signal.SIGSTOP)
        try:
            self.pi_os('nodes')
            self.assertIn('gave no answer', self.complaints)
        finally:
            talker.signal(signal.SIGCONT)
        self.assertEqual(self.state(talker)['node'], talker.name)

    # ------------------------------------------------------------------------------------------------------- reasons

    def test_library_not_preloaded(self):
        for without in ('talker', 'listener'):
            with self.subTest(without=without):
                pair = {name: self.peer('%s_%s' % (name, without), preload='' if name == without else None)
                        for name in ('talker', 'listener')}
                topic = self.connect(pair['talker'], pair['listener'])
                self.assert_finding('not_preloaded', pair[without].name + ' runs without the library', topic)
                for peer in pair.values():
                    peer.close()

    def test_rospy(self):
        talker, = self.peers('talker')
        python = self.peer('python', kind='rospy', preload='')
        topic = self.connect(talker, python)
        self.assert_finding('python', python.name, topic)

    def test_a_registration_of_the_dead_at_the_address_of_the_living(self):
        for kind, how in (('test_peer', {'env': {'PI_OS_ENABLE': '0'}}), ('rospy', {'preload': ''})):
            with self.subTest(kind=kind):
                talker, = self.peers('talker_' + kind)
                listener = self.peer('listener_' + kind, kind=kind, **how)
                topic = self.connect(talker, listener)
                for living in (talker, listener):
                    uri = graph.call(graph.proxy(os.environ['ROS_MASTER_URI']).lookupNode, living.name)
                    for dead in ('/aa_dead', '/zz_dead'):  # sorted before and behind
                        dead += living.name.strip('/')
                        master = graph.proxy(os.environ['ROS_MASTER_URI'])
                        self.assertEqual(master.registerSubscriber(dead, '/topic_of_the_dead', '*', uri)[0], 1)
                        self.addCleanup(master.unregisterSubscriber, dead, '/topic_of_the_dead', uri)
                found = [entry['what'] for entry in self.pi_os('doctor') if topic in entry['what']]
                self.assertEqual(found, ['%s from %s to %s' % (topic, talker.name, listener.name)])
                for peer in (talker, listener):
                    peer.close()

    def test_switched_off(self):
        talker = self.peer('talker', env={'PI_OS_ENABLE': '0'})
        topic = self.connect(talker, *self.peers('listener'))
        self.assert_finding('disabled', talker.name, topic)

    def test_excluded(self):
        for option, value, text in (('PI_OS_EXCLUDE', '/tf,/topic_*', '"/topic_*"'),
                                    ('PI_OS_INCLUDE', '/tf', '"/tf"')):
            for side in ('talker', 'listener'):
                with self.subTest(option=option, side=side):
                    pair = {name: self.peer('%s_%s_%s' % (name, side, option),
                                            env={option: value} if name == side else {})
                            for name in ('talker', 'listener')}
                    topic = self.connect(pair['talker'], pair['listener'])
                    found = self.finding(topic)
                    self.assertEqual(found['reason'], 'excluded', found)
                    self.assertIn(text, found['text'])
                    self.assertIn(pair[side].name, found['text'])
                    for peer in pair.values():
                        peer.close()

    def test_udp_hint(self):
        talker, listener = self.peers('talker', 'listener')
        topic = self.connect(talker, listener, hints='udp')
        self.assert_finding('udp', listener.name, topic)

    def test_a_pool_that_is_full(self):
        talker = self.peer('talker', env={'PI_OS_POOL_LIMIT_MB': '1'})
        listener, = self.peers('listener')
        topic = self.topic()
        talker.call('advertise', topic=topic, queue=100)
        listener.call('subscribe', topic=topic, queue=100)
        self.link(talker, listener, topic)
        talker.call('publish', count=3, sizes=4000000)
        listener.call('await_received', seq=3)
        # Those that follow while the first still waits for TCPROS go there for the sake of order, and are not counted.
        self.assert_finding('pool_full', 'messages found the pool of %s full' % talker.name, topic)

    def test_small_messages(self):
        talker = self.peer('talker', env={'PI_OS_MIN_BYTES': '1000'})
        listener, = self.peers('listener')
        topic = self.topic()
        talker.call('advertise', topic=topic, queue=100)
        listener.call('subscribe', topic=topic, queue=100)
        self.link(talker, listener, topic)
        talker.call('publish', count=3, sizes=100)
        listener.call('await_received', seq=3)
        self.assert_finding('min_bytes', '1000 bytes', topic)

    @harness.needs_root
    def test_another_user(self):
        for path in (harness.program(harness.PACKAGE + '_test_peer'), self.preload):
            if not harness.readable_by_others(path):
                self.skipTest('%s is not readable by user nobody: build in a folder that others may enter' % path)
        user = pwd.getpwnam('nobody')
        logs = self.scratch()
        os.chown(logs, user.pw_uid, user.pw_gid)
        talker, = self.peers('talker')
        other = self.peer('other', env={'ROS_LOG_DIR': logs, 'HOME': logs},
                          prefix=['setpriv', '--reuid=%d' % user.pw_uid, '--regid=%d' % user.pw_gid, '--clear-groups'])
        topic = self.connect(talker, other)
        self.assert_finding('users', 'user nobody', topic)

    def test_another_libroscpp(self):
        listener, = self.peers('listener')
        original = next(line.split(None, 5)[5] for line in harness.mappings(listener.pid) if 'libroscpp.so' in line)
        soname = next(name for name in os.listdir(os.path.dirname(original))
                      if re.match(r'libroscpp\.so\.\d+[a-z]*$', name))
        folder = self.scratch()
        shutil.copy(original, os.path.join(folder, 'libroscpp.so.9.99.99'))
        os.symlink('libroscpp.so.9.99.99', os.path.join(folder, soname))
        talker = self.peer('talker', env={'LD_LIBRARY_PATH': folder})
        topic = self.connect(talker, listener)
        self.assert_finding('declined', folder, topic)

    @harness.needs_root
    def test_another_network_namespace(self):
        possible = subprocess.run(['unshare', '-n', 'true'], stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        if possible.returncode != 0:
            self.skipTest('no network namespace of its own here: %s' % possible.stdout.decode().strip())
        here, there = '10.213.79.1', '10.213.79.2'
        near, far = 'piosi%da' % (os.getpid() % 100000), 'piosi%db' % (os.getpid() % 100000)
        keeper = self.process(['unshare', '-n', 'sh', '-c', 'echo @{}; read line'], preload='')
        keeper.answer()
        inside = ['nsenter', '-t', str(keeper.pid), '-n']
        made = subprocess.run(['ip', 'link', 'add', near, 'type', 'veth', 'peer', 'name', far],
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        if made.returncode != 0:
            self.skipTest('no veth pair on this kernel: %s' % made.stdout.decode().strip())
        self.addCleanup(subprocess.run, ['ip', 'link', 'del', near], stderr=subprocess.DEVNULL)
        for command in (['ip', 'link', 'set', far, 'netns', str(keeper.pid)],
                        ['ip', 'addr', 'add', here + '/30', 'dev', near], ['ip', 'link', 'set', near, 'up'],
                        inside + ['ip', 'addr', 'add', there + '/30', 'dev', far],
                        inside + ['ip', 'link', 'set', far, 'up'], inside + ['ip', 'link', 'set', 'lo', 'up']):
            subprocess.run(command, check=True)
        with socket.socket() as probe:
            probe.bind((here, 0))
            port = probe.getsockname()[1]
        master = 'http://%s:%d' % (here, port)
        self.process(['env', '-u', 'ROS_HOSTNAME', 'rosmaster', '--core', '-p', str(port)], preload='',
                     env={'ROS_IP': here, 'ROS_MASTER_URI': master})

        def answers():
            try:
                with socket.create_connection((here, port), 1):
                    return True
            except OSError:
                return False
        harness.await_state(answers, 'master at ' + master)
        peers = [self.peer(name, prefix=['env', '-u', 'ROS_HOSTNAME'] + prefix, master=master,
                           env={'ROS_IP': address, 'ROS_MASTER_URI': master})
                 for name, address, prefix in (('talker', here, []), ('far', there, inside))]
        topic = self.connect(*peers)
        # Its address is not one of this namespace: from here it could as well be another device.
        self.assert_finding('other_device', peers[1].name, topic, env={'ROS_MASTER_URI': master})

    def test_a_service_without_the_library(self):
        self.service = self.topic('service')
        server = self.service_peer('server', preload='')
        client = self.service_peer('client')
        server.call('serve', service=self.service)
        client.call('await_service', service=self.service)
        self.assert_calls(client.call('call', service=self.service, count=3, persistent=True), 3)
        self.assert_finding('not_preloaded', server.name, self.service)

    def test_an_excluded_service(self):
        server, client = self.pair(env={'PI_OS_EXCLUDE': '/service_*'})
        self.assert_calls(client.call('call', service=self.service, count=3, persistent=True), 3)
        self.assert_finding('excluded', server.name, self.service)

    def test_no_master(self):
        run = subprocess.run([harness.program('pi_os'), 'doctor'], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                             text=True, timeout=harness.DEADLINE_S,
                             env=dict(os.environ, ROS_MASTER_URI='http://localhost:9'))
        self.assertEqual(run.returncode, 1)
        self.assertIn('no master answers at http://localhost:9', run.stderr)
        self.assertNotIn('Traceback', run.stderr)

    def synthetic(self, talker=None, listener=None, out=None, into=None):
        """Findings about a link over TCPROS between two processes with these states."""
        def state(name, changes, publications=(), subscriptions=()):
            entry = {'node': name, 'pid': os.getpid(), 'protocol': processes.PROTOCOL,
                     'pool': {'limit': 1 << 20, 'last_error': ''},
                     'options': {'enable': True, 'include': ['*'], 'exclude': [], 'min_bytes': 0},
                     'publications': list(publications), 'subscriptions': list(subscriptions), 'service_clients': [],
                     'service_servers': []}
            return dict(entry, **(changes or {}))
        states = [state('/talker', talker, publications=[{'topic': '/t', 'subscriber': '/listener',
                                                          'transport': 'TCPROS', 'reason': out or ''}]),
                  state('/listener', listener, subscriptions=[{'topic': '/t', 'publisher': '/talker',
                                                               'transport': 'TCPROS', 'reason': into or ''}])]
        nodes = {'/talker': graph.Node('/talker', 'http://localhost:1/', 1, []),
                 '/listener': graph.Node('/listener', 'http://localhost:2/', 2,
                                         [[1, 'http://localhost:1/', 'i', 'TCPROS', '/t', True]])}
        return doctor.Doctor(nodes, states).findings()

    def test_what_the_processes_have_noted(self):
        for noted, reason in (('other_user', 'users'), ('unreachable', 'namespaces'), ('no_memory', 'no_memory'),
                              ('peer_version', 'peer_version'), ('negotiating', 'negotiating'), ('broken', 'broken'),
                              ('', 'unknown')):
            found, = self.synthetic(into=noted)
            self.assertEqual(found.reason, reason)
            found, = self.synthetic(out=noted, into='negotiating' if noted else '')
            self.assertEqual(found.reason, reason)
        found, = self.synthetic(talker={'protocol': 2})
        self.assertEqual((found.reason, found.text),
                         ('peer_version', '/talker has version 2 of the protocol, /listener has %d' %
                          processes.PROTOCOL))

    def test_the_node_of_pi_core_is_what_it_is(self):
        nodes = {'/rosout': graph.Node('/rosout', 'http://localhost:1/', 1, [])}
        user = processes.user_name(os.geteuid())
        for program, reason in (('pi_core', 'pi_core'), ('rosout', 'not_preloaded')):
            judge = doctor.Doctor(nodes, [], lambda pid: processes.Process(pid, user, libraries=set(), program=program))
            self.assertEqual(judge.judge_node('/rosout')[0], reason)

    def test_quantiles_of_histograms(self):
        self.assertIsNone(tables.quantile_us([0] * 24, 0.5))
        counts = [0] * 24
        counts[0], counts[10] = 99, 1
        self.assertEqual(tables.quantile_us(counts, 0.5), 1.024)
        self.assertEqual(tables.quantile_us(counts, 0.99), 1.024)
        self.assertEqual(tables.quantile_us(counts, 1.0), 1.024 * 1024)

    def test_a_library_of_another_version(self):
        with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener:
            listener.settimeout(None)  # rospy sets one for all
            listener.bind('\0pi_os/' + os.urandom(16).hex())
            listener.listen()

            def close_each_at_once():  # other tests may ask too
                with contextlib.suppress(OSError):  # the listener's end
                    while True:
                        channel, _ = listener.accept()
                        channel.recv(100)
                        channel.close()
            closer = threading.Thread(target=close_each_at_once, daemon=True)
            closer.start()
            self.pi_os('nodes')
            listener.shutdown(socket.SHUT_RDWR)
            closer.join(harness.DEADLINE_S)
        self.assertIn('process %d closed the connection' % os.getpid(), self.complaints)
        self.assertNotIn('Traceback', self.complaints)

    # ------------------------------------------------------------------------------------------------------ hostile

    def parse(self, answer):
        """What the tool makes of it. @return None if it refuses it"""
        memory = os.memfd_create('answer')
        try:
            os.write(memory, answer)
            packet = processes.PACKET.pack(processes.PROTOCOL, processes.STATE, 0, 0, len(answer), 0, 0)
            return processes.parse(1, packet, [memory])
        except processes.Unanswered as error:
            self.assertTrue(str(error).isprintable(), error)
            return None
        finally:
            os.close(memory)

    def test_any_answer_is_shown_or_refused(self):
        talker, listener = self.peers('talker', 'listener')
        self.connect(talker, listener)
        honest = self.state(talker)
        self.assertIsNotNone(self.parse(json.dumps(honest).encode()))
        for answer in (b'', b'\xff', b'[' * 100000, b'[]', b'{"version": 1}', b'{"version": 1e400}',
                       json.dumps(dict(honest, version='\x1b[2J')).encode()):
            self.assertIsNone(self.parse(answer), answer[:40])
        shown = self.parse(json.dumps(dict(honest, node='/a\x1b[2J')).encode())
        self.assertEqual(shown['node'], '/a?[2J')

        random = Random(1)
        of_any_type = (None, -1, 2 ** 64, 1.5, True, '', '\x00', [], [0] * 65, [[]], {}, {'node': 1})
        of_type = {int: (0, 1, 2 ** 64 - 1), str: ('', '/other', '\x00\x1b', 'SHMROS'), bool: (False, True),
                   list: ([],)}
        refused = 0
        for _ in range(3000):
            state = copy.deepcopy(honest)
            wrong = random.random() < 0.5
            for holder, key in random.sample(self.places(state), 2):
                if wrong and random.random() < 0.3 and isinstance(holder, dict):
                    holder.pop(key, None)
                elif wrong or type(holder[key]) in of_type:
                    holder[key] = random.choice(of_any_type if wrong else of_type[type(holder[key])])
            found = self.parse(json.dumps(state).encode())
            refused += found is None
            if found is not None:
                for rows in (tables.node_rows([found]), tables.link_rows(tables.joined_links([found])),
                             tables.service_rows([found])):
                    self.assertTrue(rows)
                doctor.Doctor({}, [found]).findings()
        self.assertGreater(refused, 1000)
        self.assertLess(refused, 2000)

    def places(self, value):
        """All (holder, key) in nested lists and dictionaries."""
        found = []
        if isinstance(value, (dict, list)):
            for key in (value if isinstance(value, dict) else range(len(value))):
                found.append((value, key))
                found += self.places(value[key])
        return found

    def test_answers_of_nodes_that_are_none(self):
        for answer in (None, 1, [], [1, ''], [0, '', 1], [1, '', {}]):
            with self.assertRaises(graph.GraphError):
                graph.call_for(list, lambda *_, answer=answer: answer)
        self.assertEqual(graph.bus_entries([1, [], [1, 2, 3, 4, 5], [1, 'a', 'i', 'TCPROS', '/t'], 'abcdef']),
                         [[1, 'a', 'i', 'TCPROS', '/t']])

    # ------------------------------------------------------------------------------------------------------- others

    def test_tables(self):
        talker, listener = self.peers('talker', 'listener')
        topic = self.connect(talker, listener)
        for command, words in (('nodes', (talker.name, listener.name)), ('links', (topic, 'SHMROS')),
                               ('services', ('set_logger_level',)), ('doctor', ('findings',))):
            run = subprocess.run([harness.program('pi_os'), command], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                 text=True, timeout=harness.DEADLINE_S)
            self.assertEqual(run.returncode, 0, run.stderr)  # others on this device may be complained about
            self.assertNotIn('Traceback', run.stderr)
            for word in words:
                self.assertIn(word, run.stdout)

    def diagnose(self, of):
        """Starts `pi_os diagnostics`. @return queue of its messages, each as {name: status}"""
        arrived = queue.Queue()
        subscriber = rospy.Subscriber('/diagnostics', DiagnosticArray,
                                      lambda message: arrived.put({status.name: status for status in message.status}))
        self.addCleanup(subscriber.unregister)
        self.process([harness.program('pi_os'), 'diagnostics', '--of', of,
                      '__name:=' + self.unique('diagnostics')], preload='')
        return arrived

    def await_statuses(self, arrived, fits):
        """The first message that fits."""
        for _ in range(30):
            found = arrived.get(timeout=harness.DEADLINE_S)
            if fits(found):
                return found
        self.fail('nothing fits; the last message: %s' % found)

    def test_diagnostics_of_drops_beside_those_of_the_bridge(self):
        talker, listener = self.peers('talker', 'listener')
        topic = self.topic()
        talker.call('advertise', topic=topic, queue=5)
        listener.call('subscribe', topic=topic, queue=500)
        self.link(talker, listener, topic)
        name = 'pi_os: ' + talker.name
        arrived = self.diagnose('all')
        found = self.await_statuses(arrived, lambda statuses: name in statuses)
        self.assertEqual(found[name].level, DiagnosticStatus.OK, found[name])
        self.assertIn('pi_os_bridge: process', found)
        listener.signal(signal.SIGSTOP)
        try:
            talker.call('publish', count=40, sizes=1000000)
            self.await_statuses(arrived, lambda statuses: name in statuses and 'dropped' in statuses[name].message)
        finally:
            listener.signal(signal.SIGCONT)

    def test_diagnostics(self):
        talker = self.peer('talker', preload='')
        listener, = self.peers('listener')
        topic = self.connect(talker, listener)
        found = self.await_statuses(self.diagnose('nodes'), lambda statuses: any(topic in name for name in statuses))
        link = next(status for name, status in found.items() if topic in name)
        self.assertEqual(link.level, DiagnosticStatus.WARN)
        self.assertIn('LD_PRELOAD', link.message)
        self.assertEqual({value.key: value.value for value in link.values}['reason'], 'not_preloaded')
        node = found['pi_os: ' + listener.name]
        self.assertEqual(node.level, DiagnosticStatus.OK, node)
        self.assertEqual({value.key: value.value for value in node.values}['links on TCPROS'], '1')


if __name__ == '__main__':
    rospy.init_node('introspection_judge', anonymous=True, disable_signals=True)
    harness.main(Introspection, plain=False, needs_library=True)
