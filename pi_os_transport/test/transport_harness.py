"""What the rostests of pi_os_transport share: nodes steered over pipes, their links, their resources.

A judge is a python3 unittest that is no ROS node itself. It starts its peers as child processes (test_peer.cpp,
rospy_peer.py), sends each one command per line, and waits for the answer or for an event with a deadline. Every peer
is a child of the judge and is ended by it; a peer also ends when its stdin closes.

A test class runs once plain and once with the library in LD_PRELOAD (rostest argument preload); the plain run shows
that what is asserted is TCPROS's own behaviour. SHM names the transport that getBusInfo has to show for a link whose
two ends are preloaded: SHMROS, or TCPROS in the plain run.
"""
import argparse
import json
import os
import queue
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import unittest
import xml.etree.ElementTree as ElementTree
import xmlrpc.client

import rosgraph
import roslib.packages

PACKAGE = 'pi_os_transport'
DEADLINE_S = 30.0   # of one wait; reached only when something is broken, also under full CPU load
BUILT = 'built'      # value of preload that means the library built together with the test programs
GRAPH_POLL_S = 0.01  # roscpp and the slave API signal no event when a link changes

arguments = argparse.Namespace(preload='', first='')


def program(name):
    """Path of a program of this package (build space or source tree)."""
    return other_program(PACKAGE, name)


def other_program(package, name):
    found = roslib.packages.find_node(package, name)
    if not found:
        raise RuntimeError('program %s of package %s not found: build the target "tests" and source the devel space'
                           % (name, package))
    return found[0]


def built_library():
    """Path of the library that was built with the test programs: <devel>/lib/<package>/<program> beside <devel>/lib."""
    return os.path.join(os.path.dirname(os.path.dirname(program(PACKAGE + '_test_peer'))), 'libpi_os_transport.so')


def test_library(name):
    """Path of a library that tests preload to nodes beside the one under test: clock, jitter or latch_race."""
    return os.path.join(os.path.dirname(built_library()), 'lib%s_test_%s.so' % (PACKAGE, name))


def await_state(reached, what, timeout=DEADLINE_S):
    """Returns the first true value of reached(); raises AssertionError with what() or what after the deadline."""
    deadline = time.monotonic() + timeout
    while True:
        value = reached()
        if value:
            return value
        if time.monotonic() > deadline:
            raise AssertionError('not within %.0f s: %s' % (timeout, what() if callable(what) else what))
        time.sleep(GRAPH_POLL_S)


class Process:
    """A child process whose output is collected; lines that start with '@' are answers."""

    def __init__(self, command, preload='', env=None, prefix=(), pass_fds=()):
        environment = dict(os.environ)
        environment.pop('LD_PRELOAD', None)
        for key in [k for k in environment if k.startswith('PI_OS_')]:
            environment.pop(key)
        if preload:
            environment['LD_PRELOAD'] = ':'.join(filter(None, [arguments.first, preload]))
        environment.update(env or {})
        self.command = list(prefix) + list(command)
        self.popen = subprocess.Popen(self.command, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                      stderr=subprocess.PIPE, env=environment, pass_fds=pass_fds)
        self.pid = self.popen.pid
        self.lines = []
        self._answers = queue.Queue()
        self._readers = [threading.Thread(target=self._read, args=(stream,), daemon=True)
                         for stream in (self.popen.stdout, self.popen.stderr)]
        for reader in self._readers:
            reader.start()

    def _read(self, stream):
        for raw in stream:
            line = raw.decode('utf-8', 'replace').rstrip('\n')
            if line.startswith('@'):
                self._answers.put(json.loads(line[1:]))
            elif line:
                self.lines.append(re.sub('\x1b\\[[0-9;]*m', '', line))
        if stream is self.popen.stdout:
            self._answers.put(None)

    def answer(self, timeout=DEADLINE_S):
        try:
            reply = self._answers.get(timeout=timeout)
        except queue.Empty:
            raise AssertionError('%s gave no answer within %.0f s; its output:\n%s'
                                 % (self.command, timeout, '\n'.join(self.lines[-20:])))
        if reply is None:
            raise AssertionError('%s ended (%s); its output:\n%s'
                                 % (self.command, self.popen.poll(), '\n'.join(self.lines[-20:])))
        return reply

    def say(self, line):
        self.popen.stdin.write((line + '\n').encode())
        self.popen.stdin.flush()

    def alive(self):
        return self.popen.poll() is None

    def signal(self, number):
        self.popen.send_signal(number)

    def wait(self, timeout=DEADLINE_S):
        return self.popen.wait(timeout)

    def kill(self):
        """SIGKILL, and returns once the process is gone."""
        if self.alive():
            self.popen.kill()
        self.popen.wait()

    def close(self):
        self.kill()
        for stream in (self.popen.stdin, self.popen.stdout, self.popen.stderr):
            try:
                stream.close()
            except (BrokenPipeError, ValueError):
                pass

    def output(self, pattern):
        """Lines of output that match pattern (without colour codes)."""
        return [line for line in self.lines if re.search(pattern, line)]

    def warnings(self):
        """Warnings and errors of the library."""
        return self.output(r'(?i)(warn|error|fatal).*(pi_os|π-os)|(pi_os|π-os).*(warn|error|fatal)')


class Peer(Process):
    """A node that executes commands. call() = send() + answer() + check that it answered ok."""

    def __init__(self, name, preload='', env=None, prefix=(), kind='test_peer', threads=1, args=(),
                 master=None):
        self.name = '/' + name
        self._master_uri = master or rosgraph.get_master_uri()
        programs = {'test_peer': PACKAGE + '_test_peer', 'linked': PACKAGE + '_test_peer_linked',
                    'service_peer': PACKAGE + '_test_service_peer', 'rospy': 'rospy_peer.py',
                    'zero_copy': PACKAGE + '_test_zero_copy_peer'}
        command = [program(programs[kind]), str(threads), '__name:=' + name] + list(args)
        super().__init__(command, preload, env, prefix)

    def ready(self):
        self.answer()
        return self

    def send(self, verb, **values):
        self.say(' '.join([verb] + ['%s=%s' % (key, int(value) if isinstance(value, bool) else value)
                                    for key, value in values.items()]))

    def call(self, verb, **values):
        self.send(verb, **values)
        return self.result()

    def result(self, timeout=2 * DEADLINE_S):
        reply = self.answer(timeout)
        if not reply['ok']:
            raise AssertionError('%s: %s' % (self.name, reply))
        return reply

    def exit(self):
        """Ends the node as a user would: orderly ros::shutdown()."""
        self.say('exit')
        return self.wait()

    def bus_info(self):
        uri = rosgraph.Master('/judge', self._master_uri).lookupNode(self.name)
        code, message, info = xmlrpc.client.ServerProxy(uri).getBusInfo('/judge')
        assert code == 1, message
        return info

    def transports(self, topic, direction):
        """Transports of the links of one topic; direction 'o' at the publisher, 'i' at the subscriber."""
        return sorted(entry[3] for entry in self.bus_info() if entry[4] == topic and entry[2] == direction)

    def await_transports(self, topic, direction, expected, timeout=DEADLINE_S):
        expected = sorted(expected)
        await_state(lambda: self.transports(topic, direction) == expected,
                    lambda: '%s: links of %s (%s) are %s, expected %s; its output:\n%s'
                    % (self.name, topic, direction, self.transports(topic, direction), expected,
                       '\n'.join(self.lines[-10:])), timeout)


# -------------------------------------------------------------------------------------------------------- resources

def open_files(pid):
    """Targets of the open descriptors of a process."""
    found = []
    for fd in os.listdir('/proc/%d/fd' % pid):
        try:
            found.append(os.readlink('/proc/%d/fd/%s' % (pid, fd)))
        except FileNotFoundError:
            pass
    return found


def mappings(pid):
    with open('/proc/%d/maps' % pid) as maps:
        return [line.rstrip('\n') for line in maps]


def thread_count(pid):
    return len(os.listdir('/proc/%d/task' % pid))


def anonymous_kb(pid):
    """Private anonymous memory in use [kB]."""
    with open('/proc/%d/status' % pid) as status:
        return int(re.search(r'RssAnon:\s+(\d+)', status.read()).group(1))


def memfd_kb(pid):
    """Memory behind the memfds a process has open or mapped [kB], each file counted once."""
    files = {}
    for folder in ('fd', 'map_files'):
        base = '/proc/%d/%s' % (pid, folder)
        try:
            names = os.listdir(base)
        except PermissionError:
            continue
        for name in names:
            path = os.path.join(base, name)
            try:
                if '/memfd:' in os.readlink(path):
                    state = os.stat(path)
                    files[(state.st_dev, state.st_ino)] = state.st_blocks // 2
            except OSError:
                pass
    return sum(files.values())


class Footprint:
    """Descriptors, mappings and private memory of a process at one moment."""

    def __init__(self, pid):
        self.files = len(open_files(pid))
        self.maps = len(mappings(pid))
        self.anonymous = anonymous_kb(pid)
        self.memfd = memfd_kb(pid)

    def __repr__(self):
        return '%d descriptors, %d mappings, %d kB anonymous, %d kB memfd' % (
            self.files, self.maps, self.anonymous, self.memfd)


def end_process(pid):
    """SIGKILL to a process that may be gone."""
    try:
        os.kill(pid, signal.SIGKILL)
    except ProcessLookupError:
        pass


# ------------------------------------------------------------------------------------------------------------- cases

class TransportTest(unittest.TestCase):
    """Base of all judges. preload is '' in the plain run, else the path of the library."""

    preload = ''
    SHM = 'TCPROS'

    def setUp(self):
        self._topics = 0

    def peer(self, name, preload=None, **options):
        """Starts a node; preload None means that of this run."""
        peer = Peer(self.unique(name), self.preload if preload is None else preload, **options)
        self.addCleanup(peer.close)
        return peer.ready()

    def peers(self, *names, **options):
        """Starts several nodes at once."""
        started = []
        for name in names:
            peer = Peer(self.unique(name), self.preload, **options)
            self.addCleanup(peer.close)
            started.append(peer)
        return [peer.ready() for peer in started]

    def process(self, command, **options):
        started = Process(command, options.pop('preload', self.preload), **options)
        self.addCleanup(started.close)
        return started

    def idle_child(self, parent):
        """Process id of a child of a node that shares its descriptors and only waits."""
        pid = parent.call('fork', kind='idle')['pid']
        self.addCleanup(end_process, pid)
        return pid

    def unique(self, name):
        """Node or topic name of its own for each test and run: leftovers of another test cannot meddle."""
        return '%s_%s_%s' % (name, self.id().rsplit('.', 1)[1], 'pi_os' if self.preload else 'plain')

    def topic(self, name='topic'):
        return '/' + self.unique(name)

    def link(self, publisher, subscriber, topic, transport=None, of=1, publishers=1):
        """Waits until the only link of subscriber, and all `of` links of publisher, have the transport."""
        transport = transport or self.SHM
        subscriber.await_transports(topic, 'i', [transport] * publishers)
        publisher.await_transports(topic, 'o', [transport] * of)

    def assert_complete(self, report, count, identity=1, first=1):
        """All of first .. first + count - 1 of one publisher, in order, undamaged, each once."""
        flow = report['flows'].get(str(identity))
        self.assertIsNotNone(flow, 'nothing from publisher %s: %s' % (identity, report))
        self.assertEqual(report['corrupt'], 0, report)
        self.assertEqual((flow['received'], flow['first'], flow['last'], flow['lost'], flow['reordered']),
                         (count, first, first + count - 1, 0, 0), report)

    def assert_no_warning(self, *peers):
        for peer in peers:
            self.assertEqual(peer.warnings(), [], peer.name)

    def scratch(self):
        folder = tempfile.mkdtemp(prefix='pi_os_test_')
        self.addCleanup(shutil.rmtree, folder, True)
        return folder


def needs_root(test):
    return unittest.skipUnless(os.geteuid() == 0, 'needs root (another user id or a namespace of its own)')(test)


def readable_by_others(path):
    """True if a user without any group can read path, that is, every folder above lets others pass."""
    path = os.path.realpath(path)
    if not os.stat(path).st_mode & 0o004:
        return False
    while path != '/':
        path = os.path.dirname(path)
        if not os.stat(path).st_mode & 0o001:
            return False
    return True


def variants(case, plain=True):
    """The test class once per transport: <name>Plain and, with a library given, <name>Preloaded."""
    classes = []
    if plain or not arguments.preload:
        classes.append(type(case.__name__ + 'Plain', (case,), {}))
    if arguments.preload:
        classes.append(type(case.__name__ + 'Preloaded', (case,), {'preload': arguments.preload, 'SHM': 'SHMROS'}))
    return classes


def complete_results(result_file, result):
    """Writes into rosunit's result file, and into the log, what it leaves out: skipped tests and those with a failed
    subtest, which it shows as passed, and what happened outside a test, such as in setUpClass."""
    results = ElementTree.parse(result_file)

    def mark(test, tag, text):
        print('%s %s: %s' % (tag.upper(), test.id(), text), file=sys.__stderr__)
        name = getattr(test, 'test_case', test).id()
        case = next((case for case in results.iter('testcase')
                     if '%s.%s' % (case.get('classname'), case.get('name')) == name), None)
        if case is None:
            case = ElementTree.SubElement(results.getroot(), 'testcase', classname=__name__, name=name)
        which = test.id()[len(name):].strip()  # of the subtests
        message = text.strip().splitlines()[-1]
        ElementTree.SubElement(case, tag, message='%s: %s' % (which, message) if which else message).text = text

    for test, reason in result.skipped:
        mark(test, 'skipped', reason)
    for test, trace in result.failures + result.errors:
        if hasattr(test, 'test_case') or not isinstance(test, unittest.TestCase):
            mark(test, 'failure', trace)
    results.write(result_file, encoding='utf-8', xml_declaration=True)


def main(case, plain=True, needs_library=False):
    """Entry of every judge: main(CaseClass). needs_library: without one there is nothing to judge, the tests skip."""
    parser = argparse.ArgumentParser()
    parser.add_argument('--preload', default='')
    parser.add_argument('--first', default='', help="library to preload before that one: a sanitizer's, or the jitter")
    parser.add_argument('--case', default='', help='run only the tests whose name contains this')
    parser.parse_known_args(namespace=arguments)
    if arguments.preload == BUILT:
        arguments.preload = built_library()
    if arguments.preload and not os.path.isfile(arguments.preload):
        raise RuntimeError('preload=%s does not exist: build the target pi_os_transport, or leave preload empty for '
                           'TCPROS' % arguments.preload)
    if needs_library and not arguments.preload:
        case = unittest.skip('needs the library: pass preload:=<path of libpi_os_transport.so>')(case)
    suite = unittest.TestSuite()
    for variant in variants(case, plain):
        for test in unittest.defaultTestLoader.loadTestsFromTestCase(variant):
            if arguments.case in test.id():
                suite.addTest(test)
    import rosunit
    result_file = next((a.split(':', 1)[1] for a in sys.argv if a.startswith('--gtest_output=xml:')), None)
    if '--text' in sys.argv or result_file is None:
        result = unittest.TextTestRunner(verbosity=2).run(suite)
    else:
        result = rosunit.create_xml_runner(PACKAGE, case.__name__, result_file).run(suite)
        complete_results(result_file, result)
    sys.exit(0 if result.wasSuccessful() else 1)
