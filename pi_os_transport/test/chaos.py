#!/usr/bin/python3 -B
"""Does to a graph of nodes everything that a bad day can do to it, and judges those who live through it.

    make chaos ARGS="--kills 10000 --seed 1"

Four publishers and four subscribers, each a process, exchange messages of 64 B to 2 MB. In rounds a random choice of
them is killed (SIGKILL) in the middle of traffic, with a callback held and a full queue, while stopped, or while its
successor starts. Every few rounds something else happens: see chaos_disturbances.py. One publisher and one subscriber
live through all of it. After every round each living subscriber has to receive from each living publisher again, and
no message between survivors may be lost, damaged or out of order. Every now and then, and in the end, the two old
processes must hold the descriptors and memory that they held after the warm-up; in the end nothing may be left in
/dev/shm, among the abstract sockets, or of children.

The seed fixes what is done to whom and how long the pauses are, not how the processes are scheduled meanwhile.
Exit status 0: all held; 1: the first violation is printed, with the seed.

With --sweep: every kill, not some, see chaos_sweep.py; -h beside it shows its options.
"""
import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time

import chaos_disturbances
import chaos_sweep
import hostile_peers
import kill_campaign
import transport_harness as harness
from kill_campaign import Violation

CHECK_EVERY = 1000        # kills between two looks at the old processes
DISTURB_EVERY = 12        # rounds between two disturbances
PAUSE_S = 0.04            # longest random pause before a kill
NEWBORN_PAUSE_S = 0.15    # longest life of a node that dies while it starts
KINDS = ['traffic', 'traffic', 'held', 'stopped']
INSIDE = 'PI_OS_CHAOS_NAMESPACE'  # set once /dev/shm is the campaign's own


class Chaos(kill_campaign.Campaign):
    def __init__(self, preload, options, say):
        super().__init__(preload, options.kills, options.seed, say)
        self.deadline = time.monotonic() + 60 * options.minutes
        self.nodes = options.nodes
        self.verbose = options.verbose
        self.sizes = [size for size in chaos_disturbances.SIZES if size <= options.largest_mb << 20]
        self.disturbed = {}    # kind -> how often
        self.hostile = {}      # kind of hostile peer -> how often
        self.turns = {}
        self.topics_made = 0
        self.warned = []
        self.rounds = 0
        self.dead = []
        self.clock = tempfile.NamedTemporaryFile(prefix='pi_os_chaos_clock_')
        self.set_clock(0)

    # ------------------------------------------------------------------------------------- what the disturbances use

    def set_clock(self, offset_ns):
        self.clock.seek(0)
        self.clock.write(chaos_disturbances.CLOCK.pack(offset_ns))
        self.clock.flush()

    def start(self, kind, index, env=None, prefix=()):
        preload = ':'.join(library for library in (harness.test_library('clock'), self.preload) if library)
        process = harness.Peer('%s_%s%d' % (self.prefix, kind, index), preload, threads=2, prefix=prefix,
                               env=dict(env or {}, PI_OS_TEST_CLOCK=self.clock.name))
        self.processes.append(process)
        return process

    def peers(self, role):
        return self.publishers if role == 'publisher' else self.subscribers

    def everybody(self):
        return list(self.publishers.values()) + list(self.subscribers.values())

    def victims(self):
        return ([('publisher', i) for i in range(1, kill_campaign.PUBLISHERS)] +
                [('subscriber', i) for i in range(1, kill_campaign.SUBSCRIBERS)])

    def choose_victim(self):
        return self.random.choice(self.victims())

    def turn(self, kinds):
        """The next one of a list, round and round."""
        self.turns[id(kinds)] = self.turns.get(id(kinds), -1) + 1
        return kinds[self.turns[id(kinds)] % len(kinds)]

    def next_topic(self):
        self.topics_made += 1
        return self.topics_made

    def count(self, kind):
        self.done[kind] = self.done.get(kind, 0) + 1

    def count_hostile(self, kind):
        self.hostile[kind] = self.hostile.get(kind, 0) + 1

    def kill(self, peer):
        super().kill(peer)
        self.dead.append(peer)

    def bury(self):
        """Closes the pipes of the dead. Not as they die: a child that one has left would keep who closes them."""
        for peer in self.dead:
            self.warned += peer.warnings()
            peer.close()
            self.processes.remove(peer)
        self.dead = []

    def strike(self, role, index, kind):
        peer = self.peers(role)[index]
        if role == 'subscriber':
            self.checked += sum(report['received'] for report in self.reports(index))
            if kind == 'held':
                for topic in range(kill_campaign.TOPICS):
                    peer.call('hold', sub=topic)
        elif kind == 'held':
            kind = 'traffic'  # a publisher has no callback to hold
        if kind == 'stopped':
            peer.signal(signal.SIGSTOP)
        time.sleep(self.random.uniform(0, PAUSE_S))  # the moment of a kill is random in time, not tied to an event
        self.kill(peer)
        del self.peers(role)[index]
        self.count('%s %s' % (role, kind))

    def replace(self, victims, newborns=0.0, **limits):
        """Kills [(role, index, kind)] and starts successors under their names; some of those die as they start."""
        for victim in victims:
            self.strike(*victim)
        dying = [(role, index) for role, index, _ in victims if self.random.random() < newborns]
        starting = [(role, index, self.start(role, index)) for role, index in dying]
        for role, index, newborn in starting:
            if self.random.random() < 0.5:
                newborn.ready()
                newborn.send('advertise' if role == 'publisher' else 'subscribe',
                             topic=self.topics[index % kill_campaign.TOPICS], queue=kill_campaign.QUEUE, id=0)
        for role, index, newborn in starting:
            time.sleep(self.random.uniform(0, NEWBORN_PAUSE_S / len(starting)))
            self.kill(newborn)
            self.count(role + ' newborn')
        successors = [(role, index, self.start(role, index, **limits)) for role, index, _ in victims]
        for role, index, peer in successors:
            peer.ready()
            self.peers(role)[index] = peer
            if role == 'publisher':
                self.last_identity += 1
                self.identities[index] = self.last_identity
                peer.call('advertise', topic=self.topics[index % kill_campaign.TOPICS], queue=kill_campaign.QUEUE,
                          id=self.last_identity)
                self.publish(index)
            else:
                for topic in range(kill_campaign.TOPICS):
                    peer.call('subscribe', **{'as': topic}, topic=self.topics[topic], queue=kill_campaign.QUEUE)

    # -------------------------------------------------------------------------------------------------------- the plan

    def round(self):
        victims = self.random.sample(self.victims(), self.random.randint(3, len(self.victims())))
        self.replace([victim + (self.random.choice(KINDS),) for victim in victims], newborns=0.35)
        self.rounds += 1

    def judge_survivors(self):
        self.bury()
        self.await_flow_from_everybody()
        for index in self.subscribers:
            self.reports(index)

    def disturb(self, kind):
        function = chaos_disturbances.DISTURBANCES.get(kind) or chaos_disturbances.RARE[kind]
        if self.verbose:
            self.say('%6.0f s, %d kills: %s' % (time.monotonic() - self.begun, self.killed(), kind))
        self.disturbed[kind] = self.disturbed.get(kind, 0) + function(self)
        self.judge_survivors()

    def schedule(self):
        """Every kind in turn, in an order that changes each time."""
        while True:
            kinds = [kind for kind in chaos_disturbances.DISTURBANCES if self.possible(kind)]
            self.random.shuffle(kinds)
            yield from kinds

    def possible(self, kind):
        return kind != 'full /dev/shm' or INSIDE in os.environ

    def campaign(self):
        rare = [(self.kills * (number + 1) // (len(chaos_disturbances.RARE) + 1), kind)
                for number, kind in enumerate(chaos_disturbances.RARE)]
        schedule = self.schedule()
        missing = {kind for kind in chaos_disturbances.DISTURBANCES if self.possible(kind)}
        next_check = CHECK_EVERY
        before = None
        while self.killed() < self.kills or missing or rare:
            self.round()
            self.judge_survivors()
            few_rounds_left = self.kills < 4 * DISTURB_EVERY * len(missing)
            if self.rounds % DISTURB_EVERY == 0 or (missing and few_rounds_left):
                kind = next(schedule)
                self.disturb(kind)
                missing.discard(kind)
            while rare and self.killed() >= rare[0][0]:
                self.disturb(rare.pop(0)[1])
            if before is None and self.killed() >= min(kill_campaign.WARM_UP_KILLS, self.kills // 3):
                before = self.check(None)
            if self.killed() >= next_check:
                now = self.check(before)
                next_check = self.killed() + CHECK_EVERY
                self.say('%d kills, %.0f s; old publisher: %s; old subscriber: %s'
                         % (self.killed(), time.monotonic() - self.begun, *now))
            if time.monotonic() > self.deadline:
                self.say('the time is over')
                break
        return before, self.check(before)

    def check(self, before):
        """Quiet, then a look at the two old processes; the traffic goes on after it."""
        self.await_links()
        now = self.quiet()
        if before is not None:
            self.judge_growth(before, now)
        for index in self.publishers:
            self.publish(index)
        return now

    def run(self):
        self.begun = time.monotonic()
        shm_before = set(os.listdir('/dev/shm'))
        try:
            for index in range(kill_campaign.SUBSCRIBERS):
                self.start_subscriber(index)
            for index in range(kill_campaign.PUBLISHERS):
                self.start_publisher(index)
            self.await_flow_from_everybody()
            before, after = self.campaign()
            self.checked += sum(report['received'] for index in self.subscribers for report in self.reports(index))
            for process in list(self.processes):
                self.sockets.update(kill_campaign.sockets_of(process.pid) if process.alive() else {})
                process.close()
                self.warned += process.warnings()
            if self.preload and len(self.sockets) < self.killed() // 3:
                raise Violation('saw only %d sockets of the library in %d kills: this check is blind'
                                % (len(self.sockets), self.killed()))
            self.judge_leftovers(shm_before)
        finally:
            self.close()
            self.clock.close()
        self.report(before, after)

    def report(self, before, after):
        took = time.monotonic() - self.begun
        self.say('\n%d kills in %.0f s (%.1f per second), seed as given' % (self.killed(), took, self.killed() / took))
        for kind, number in sorted(self.done.items()):
            self.say('  %6d  SIGKILL: %s' % (number, kind))
        for kind, number in sorted(self.disturbed.items()):
            self.say('  %6d  %s' % (number, kind))
        for kind in list(chaos_disturbances.DISTURBANCES):
            if not self.possible(kind):
                self.say('    none  %s: needs root, for a /dev/shm of its own' % kind)
        if self.preload:
            kinds = len(hostile_peers.HostileSubscriber.KINDS) + len(hostile_peers.HostilePublisher.KINDS)
            self.say('  %6d  kinds of hostile peers, of %d' % (len(self.hostile), kinds))
        for name, first, last in zip(('publisher', 'subscriber'), before, after):
            self.say('old %s after warm-up: %s; at the end: %s' % (name, first, last))
        self.say('warnings of the library: %d' % len(self.warned))
        self.say('%d messages checked: 0 hangs, 0 corrupt, 0 lost between survivors, 0 out of order, '
                 '0 leaked segments, sockets, descriptors or processes' % self.checked)


def with_own_dev_shm():
    """Starts this program again where /dev/shm is a small file system of its own, so that it can be filled. Returns if
    that cannot be had."""
    command = ['unshare', '--mount', 'sh', '-c', 'mount -t tmpfs -o size=256k none /dev/shm && exec "$0" "$@"']
    if INSIDE in os.environ or subprocess.run(command + ['true'], stdout=subprocess.DEVNULL,
                                              stderr=subprocess.DEVNULL).returncode != 0:
        return
    os.environ[INSIDE] = '1'
    sys.stdout.flush()
    os.execvp(command[0], command + [sys.executable, '-B'] + sys.argv)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--preload', default=harness.BUILT,
                        help='path of libpi_os_transport.so; empty: TCPROS; default: the one that was built')
    parser.add_argument('--kills', type=int, default=10000)
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--minutes', type=float, default=60, help='ends after that, however many kills it has been')
    parser.add_argument('--nodes', type=int, default=200, help='of the largest graph')
    parser.add_argument('--largest-mb', type=int, default=256, help='of a message')
    parser.add_argument('--verbose', action='store_true', help='says what it does next')
    parser.add_argument('--sweep', action='store_true', help='kills at every stop instead: see chaos_sweep.py')
    options, _ = parser.parse_known_args([word for word in sys.argv[1:] if '--sweep' not in sys.argv or word != '-h'])
    if options.preload == harness.BUILT:
        options.preload = harness.built_library()
    if options.preload and not os.path.isfile(options.preload):
        parser.error('--preload=%s does not exist: build the target pi_os_transport' % options.preload)
    with_own_dev_shm()
    if options.sweep:
        return chaos_sweep.main(options.preload, sys.argv[1:])
    try:
        with kill_campaign.own_master():
            Chaos(options.preload, options, lambda line: print(line, flush=True)).run()
    except (Violation, AssertionError, RuntimeError, OSError) as violation:
        print('VIOLATION (seed %d): %s: %s' % (options.seed, type(violation).__name__, violation), file=sys.stderr)
        return 1
    return 0


if __name__ == '__main__':
    sys.exit(main())
