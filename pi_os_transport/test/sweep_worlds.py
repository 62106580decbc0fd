"""The worlds of chaos_sweep.py: survivors that live through all points, and one victim at a time.

A world starts its survivors, runs a victim to a stop or to its end, and judges the survivors: their messages go on
complete and in order, and they hold the descriptors and mappings that they held before. The victim of the next point is
the new process that takes the place of the dead one.
"""
import collections
import contextlib
import os
import random
import socket
import tempfile
import time

import core_harness
import device_testbed
import transport_harness as harness
from sweep_victim import DEADLINE_S, Holdings, Stop, Victim, Violation, pools

HUNG_LOSS_S = 2  # of traffic that a bridge may lose that was taken for hung, as in bridge_failures_test.py
FRESH = 3    # messages that a survivor must get after the end of a victim
VICTIM = 2   # publisher id of the victim; the survivor has 1
QUEUE = 20000  # far above what a stall of the machine lets pile up: no loss is roscpp's own drop-oldest
STEADY = 80  # messages of the steady state
SETTLED_S = 0.4  # longer than the period in which a subscriber asks its bridge
PATIENCE_S = 0.05  # between two looks whether pi_core lives

Traffic = collections.namedtuple('Traffic', 'sizes rate queue complete')
TRAFFIC = {
    'small': Traffic('64', 300, QUEUE, True),
    'mixed': Traffic('64,3000,100000', 200, QUEUE, True),
    'large': Traffic('300000', 60, QUEUE, True),
    'flood': Traffic('700000', 0, 1, False),  # drops its oldest
}
CALM = Traffic('64,3000,100000', 50, QUEUE, True)  # of survivors where the victim makes the traffic


class World:
    """Base of the worlds. Survivors: one publisher and its subscribers on self.topic."""

    def __init__(self, preload, kind, name):
        self.preload, self.kind = preload, kind
        self.traffic = TRAFFIC[kind.partition('/')[2] or 'mixed']
        self.name = 'sweep_%d_%s' % (os.getpid(), name)
        self.topic = '/%s_topic' % self.name
        self.open = contextlib.ExitStack()
        self.publisher = None
        self.subscribers = []
        self.watched = {}    # what -> process id
        self.baseline = {}
        self.lost = {}       # subscriber -> messages lost so far
        self.spared = 0      # losses that do not count
        self.checked = 0
        self.last_output = ''
        try:
            self.begin()
        except BaseException:
            self.open.close()
            raise

    def begin(self):
        """Starts the survivors and their traffic."""

    def close(self):
        with contextlib.suppress(AssertionError, OSError):
            self.checked += sum(peer.call('report')['received'] for peer in self.subscribers)
        self.open.close()

    def keep(self, thing):
        self.open.callback(thing.close)
        return thing

    def warm_up(self):
        """Two victims that live to their end, and one that dies: what is there once only is there behind them.
        @return the reports of the first two"""
        reports = [self.control(), self.control()]
        baseline = {what: [Holdings(pid)] for what, pid in self.watched.items()}
        self.settle(baseline)
        self.run(Stop(0, reports[1]['stops'][0] * 2 // 3))
        self.settle(baseline)
        self.baseline = baseline
        return reports

    def settle(self, seen=None):
        """Waits until what the survivors hold has not changed for a while. @param seen  gets every state of that while:
        a subscriber that asks its bridge again and again has two."""
        deadline = time.monotonic() + DEADLINE_S
        states = {what: [] for what in self.watched}
        since = time.monotonic()
        while time.monotonic() < since + SETTLED_S and time.monotonic() < deadline:
            for what, pid in self.watched.items():
                now = Holdings(pid)
                if all(now.exact != state.exact for state in states[what]):
                    states[what].append(now)
                    since = time.monotonic()
            time.sleep(harness.GRAPH_POLL_S)
        for what in seen or {}:
            seen[what] += states[what]

    def control(self):
        """A victim that nobody kills: a new process can take the place of the dead one."""
        report = self.run(None)
        if report['status'] != 0:
            raise Violation('a new %s ended with status %d: %s' % (self.kind, report['status'], self.last_output))
        return report

    def run(self, stop):
        """Runs a victim to `stop`, or to its end, and judges the survivors. @return the report of stop_at."""
        victim = self.start(stop)
        try:
            self.accompany(victim)
            report = victim.finish()
            self.last_output = victim.output()[-1500:]
            self.judge(report)
        finally:
            victim.close()
        return report

    def accompany(self, victim):
        """What others do while the victim lives."""

    def await_fresh(self, number=FRESH):
        sent = self.publisher.call('publisher')['published']
        for peer in self.subscribers:
            peer.send('await_received', id=1, seq=sent + number, timeout=DEADLINE_S)
        for peer in self.subscribers:
            reply = peer.answer(2 * DEADLINE_S)
            if not reply['ok']:
                raise Violation('%s receives nothing later than %d: %s' % (peer.name, sent, reply))
            self.judge_flow(peer, reply)

    def judge_flow(self, peer, reply):
        flow = reply['flows']['1']
        lost = flow['lost'] - self.lost.get(peer, 0)
        if reply['corrupt'] or flow['reordered'] or lost > self.most_lost(peer):
            raise Violation('%s: %d damaged, %d out of order or twice, %d lost' %
                            (peer.name, reply['corrupt'], flow['reordered'], flow['lost']))
        self.spared += lost > 0
        self.lost[peer] = flow['lost']

    def most_lost(self, peer):
        """@return the messages that one survivor may lose by this point"""
        del peer
        return 0

    def judge(self, report):
        del report
        self.judge_holdings()
        self.await_fresh()

    def judge_holdings(self):
        deadline = time.monotonic() + DEADLINE_S
        if not self.baseline:
            self.settle()
        for what, before in self.baseline.items():
            now = Holdings(self.watched[what])
            while all(now.exceeds(state) for state in before):
                if time.monotonic() > deadline:
                    raise Violation('%s holds %s; before: %s' % (what, now, before))
                time.sleep(harness.GRAPH_POLL_S)  # the kernel tells no third process that a descriptor is closed
                now = Holdings(self.watched[what])


class NodesWorld(World):
    """One device; the victim is a publisher or a subscriber beside survivors of the same topic."""

    def begin(self):
        self.role = self.kind.partition('/')[0]
        self.master = self.keep(core_harness.Core('pi_master'))
        env = self.master.environment
        self.publisher, subscriber = [
            self.keep(harness.Peer('%s_%s' % (self.name, role), self.preload, env=env, master=self.master.uri)).ready()
            for role in ('publisher', 'subscriber')]
        self.subscribers = [subscriber]
        self.watched = {'the publisher': self.publisher.pid, 'the subscriber': subscriber.pid,
                        'the master': self.master.pid}
        own = self.traffic if self.role == 'subscriber' else CALM
        self.publisher.call('advertise', topic=self.topic, queue=own.queue)
        subscriber.call('subscribe', topic=self.topic, queue=QUEUE)
        self.publisher.await_transports(self.topic, 'o', ['SHMROS'])
        self.publisher.call('publish', count=0, rate=own.rate, sizes=own.sizes, background=True)

    def start(self, stop):
        if self.role == 'publisher':
            lines = ['advertise topic=%s queue=%d id=%d' % (self.topic, self.traffic.queue, VICTIM),
                     'await_subscribers n=1', 'publish count=1 sizes=64',
                     'publish count=%d rate=%d sizes=%s' % (STEADY, self.traffic.rate, self.traffic.sizes),
                     'unadvertise']
        else:
            lines = ['subscribe topic=%s queue=%d' % (self.topic, QUEUE), 'await_received n=1',
                     'await_received n=%d' % STEADY, 'unsubscribe']
        return Victim([harness.program(harness.PACKAGE + '_test_peer'), '1', '__name:=%s_victim' % self.name], stop,
                      self.preload, '\n'.join(lines + ['exit', '']), self.master.environment)

    def judge(self, report):
        super().judge(report)
        strange = pools(self.subscribers[0].pid) - pools(self.publisher.pid)
        if strange:
            raise Violation('the subscriber maps memory of a dead publisher: inodes %s' % sorted(strange))
        if '"ok":false' in self.last_output:
            raise Violation('the victim did not get what it waited for: %s' % self.last_output)
        if self.role == 'publisher':
            flow = self.subscribers[0].call('forget', id=VICTIM)
            self.checked += flow['received']
            if flow['corrupt'] or flow['reordered'] or (self.traffic.complete and flow['lost']):
                raise Violation('messages of the victim: %s' % flow)
            # Messages before the link in shared memory went over TCPROS. Behind the second "publish" the victim leaves
            # in order, and the master may make the subscriber drop the link before it reads the rest, as over TCPROS.
            written = report['steps'].get('push.tail', 0) if self.last_output.count('"reply":"publish"') < 2 else 0
            if self.traffic.complete and flow['received'] < written:
                raise Violation('of %d messages that a dead publisher had written came: %s' % (written, flow))


def free_port():
    """Below those that the kernel gives to connections: while no master listens, one that tries to reach it, or another
    test's, could get that port."""
    for port in random.sample(range(12000, 30000), 100):
        with socket.socket() as probe, contextlib.suppress(OSError):
            probe.bind(('localhost', port))
            return port
    raise RuntimeError('none of 100 ports in [12000, 30000) is free')


class CoreWorld(World):
    """One device; the victim is pi_core. Linked nodes go on without it, and others find each other through the next."""

    def begin(self):
        self.port = free_port()
        self.uri = 'http://localhost:%d/' % self.port
        self.topics = 0
        self.logs = self.open.enter_context(tempfile.TemporaryDirectory(prefix='pi_os_sweep_'))
        self.env = {'ROS_MASTER_URI': self.uri, 'ROS_LOG_DIR': self.logs}
        master = self.successor()
        peers = [self.keep(harness.Peer('%s_%s' % (self.name, role), self.preload, env=self.env, master=self.uri))
                 for role in ('publisher', 'subscriber', 'speaker', 'listener')]
        self.publisher, subscriber, self.speaker, self.listener = [peer.ready() for peer in peers]
        self.subscribers = [subscriber]
        self.watched = {peer.name: peer.pid for peer in peers}
        self.publisher.call('advertise', topic=self.topic, queue=self.traffic.queue)
        subscriber.call('subscribe', topic=self.topic, queue=QUEUE)
        self.publisher.await_transports(self.topic, 'o', ['SHMROS'])
        self.publisher.call('publish', count=0, rate=self.traffic.rate, sizes=self.traffic.sizes, background=True)
        master.close()

    def successor(self):
        process = harness.Process([harness.program('pi_core'), '-p', str(self.port)], env=self.env)
        self.open.callback(process.close)
        return process

    def start(self, stop):
        return Victim([harness.program('pi_core'), '-p', str(self.port)], stop, env=self.env)

    def accompany(self, victim):
        self.meet(victim.ended)
        victim.terminate()
        if victim.finish()['killed']:
            successor = self.successor()
            try:
                if not self.meet(lambda: False):
                    raise Violation('two nodes did not find each other through a new pi_core')
            finally:
                successor.close()

    def meet(self, over):
        """Two nodes meet on a new topic, exchange a message and part. @return false if `over()` came before."""
        self.topics += 1
        topic = '%s_%d' % (self.topic, self.topics)
        self.speaker.send('advertise', topic=topic, queue=10, id=VICTIM)
        self.listener.send('subscribe', topic=topic, queue=10)
        successor = None
        for peer in (self.speaker, self.listener):
            if not self.answer(peer, over):
                successor = successor or self.successor()  # roscpp asks until a master answers
                peer.answer()
        met = False
        while not successor and not over() and not met:
            self.speaker.send('await_subscribers', n=1, timeout=0.1)
            met = self.speaker.answer()['ok']
        if met:
            self.speaker.call('publish', count=1)
            self.listener.call('await_received', n=1)
        self.listener.call('unsubscribe')
        self.speaker.call('unadvertise')
        if successor:
            successor.close()
        return met

    @staticmethod
    def answer(peer, over):
        """The answer of a peer; None if it is over before."""
        while True:
            try:
                return peer.answer(PATIENCE_S)
            except AssertionError:
                if not peer.alive():
                    raise
                if over():
                    return None


class BridgeWorld(World):
    """Two devices; the victim is one of the two bridges between them."""

    times_hung = 0  # that the other bridge took a victim for hung, before this one

    def begin(self):
        self.testbed = self.keep(device_testbed.devices.Testbed(('vehicle', 'edge')))
        vehicle, edge = self.testbed.devices.values()
        self.device, other = (vehicle, edge) if self.kind.startswith('bridge_out') else (edge, vehicle)
        self.other = other.start_bridge()
        self.publisher = device_testbed.DevicePeer(vehicle, self.name + '_publisher', self.preload).ready()
        self.near = device_testbed.DevicePeer(vehicle, self.name + '_near', self.preload).ready()
        self.far = device_testbed.DevicePeer(edge, self.name + '_far', self.preload).ready()
        self.subscribers = [self.near, self.far]
        self.watched = {'the publisher': self.publisher.pid, 'the subscriber beside it': self.near.pid,
                        'the subscriber on the other device': self.far.pid, 'the other bridge': self.other.pid}
        self.publisher.call('advertise', topic=self.topic, queue=self.traffic.queue)
        for peer in self.subscribers:
            peer.call('subscribe', topic=self.topic, queue=QUEUE)
        self.near.await_transports(self.topic, 'i', ['SHMROS'])
        self.far.await_transports(self.topic, 'i', ['TCPROS'])
        self.publisher.call('publish', count=0, rate=self.traffic.rate, sizes=self.traffic.sizes, background=True)

    def start(self, stop):
        self.times_hung = self.count_hung()
        program = os.path.join(device_testbed.devices.program_folder(), device_testbed.devices.BRIDGE_PROGRAM)
        return Victim([program], stop, env={key: value for key, value in self.device.environment().items()
                                            if key.startswith('ROS_')}, device=self.device)

    def accompany(self, victim):
        deadline = time.monotonic() + DEADLINE_S
        while not victim.ended() and self.far.transports(self.topic, 'i') != ['NNROS']:
            if time.monotonic() > deadline:
                raise Violation('the link is not over the bridges within %.0f s: %s' % (DEADLINE_S, victim.output()))
            time.sleep(harness.GRAPH_POLL_S)
        if not victim.ended():
            self.await_fresh(STEADY)
        victim.terminate()

    def judge(self, report):
        self.far.await_transports(self.topic, 'i', ['TCPROS'])
        super().judge(report)

    def most_lost(self, peer):
        # A victim that stands still on a busy machine is taken for hung before it is killed.
        hung = self.count_hung() > self.times_hung
        return HUNG_LOSS_S * self.traffic.rate if hung and peer is self.far else 0

    def count_hung(self):
        return sum('does not answer' in line for line in self.other.lines)


def world_of(kind):
    """The world of a victim: 'publisher/small', 'bridge_in', ..."""
    role = kind.partition('/')[0]
    return {'publisher': NodesWorld, 'subscriber': NodesWorld, 'pi_core': CoreWorld,
            'bridge_out': BridgeWorld, 'bridge_in': BridgeWorld}[role]


VICTIMS = ['publisher/small', 'publisher/mixed', 'publisher/large', 'publisher/flood', 'subscriber/small',
           'subscriber/mixed', 'subscriber/large', 'bridge_out/small', 'bridge_out/mixed', 'bridge_out/large',
           'bridge_in/small', 'bridge_in/mixed', 'bridge_in/large', 'pi_core']
