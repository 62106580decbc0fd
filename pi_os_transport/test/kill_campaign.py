#!/usr/bin/python3 -B
"""Kills publishers and subscribers at random (SIGKILL) during traffic and judges the survivors.

    rosrun pi_os_transport kill_campaign.py --preload=<path of libpi_os_transport.so> --kills 300

Two topics carry messages of 64 B to 2 MB from four publishers to four subscribers, each a process. One publisher and
one subscriber live through the whole campaign; the others are killed in the middle of traffic, with a callback held
and a full queue, while stopped, or while they start, and come back under their name. After every kill each surviving
subscriber has to receive from each living publisher again, and no message between survivors may be lost, damaged or
out of order. In the end nothing may be left in /dev/shm or among the abstract sockets, the two old processes hold the
descriptors and memory they held after the warm-up, and no child is left.

Without --preload the same campaign runs over TCPROS. Starts a master of its own.
Exit status 0: all held; 1: the first violation is printed.
"""
import argparse
import contextlib
import os
import random
import re
import signal
import sys
import time

import core_harness
import rosgraph
import transport_harness as harness

TOPICS = 2
PUBLISHERS = 4   # publisher i writes topic i % TOPICS; publisher 0 is never killed
SUBSCRIBERS = 4  # each reads all topics; subscriber 0 is never killed
SIZES = 'rand:64:2000000'
RATE_HZ = 40     # per publisher
QUEUE = 10000    # far above what a stall of the machine lets pile up, so that no loss is roscpp's own drop-oldest
WARM_UP_KILLS = 10
FRESH = 3        # messages that a subscriber must get from each publisher after a kill

MAX_DESCRIPTOR_GROWTH = 6        # roscpp keeps XMLRPC connections to peers open; a leak would be one or more per kill
MAX_ANONYMOUS_GROWTH_KB = 6000   # allocator slack at messages of 2 MB
ROSCPP_LEAK_KB = 4               # per kill: roscpp keeps link, connection and socket object of a dead publisher that it
                                 # has tried to reach again, 2.5 kB each, also without the library
MAX_POOL_GROWTH_KB = 40000       # the pool keeps the size that the largest pile-up needed


class Violation(Exception):
    pass


class Campaign:
    def __init__(self, preload, kills, seed, say=print):
        self.preload = preload
        self.kills = kills
        self.random = random.Random(seed)
        self.say = say
        self.prefix = 'campaign_%d_%s' % (os.getpid(), 'pi_os' if preload else 'plain')
        self.topics = ['/%s_topic%d' % (self.prefix, i) for i in range(TOPICS)]
        self.publishers = {}
        self.subscribers = {}
        self.identities = {}   # publisher index -> id of its present life
        self.last_identity = 0
        self.done = {}         # kind of kill -> count
        self.checked = 0       # messages verified by subscribers before they died, and by the living ones at the end
        self.processes = []
        self.sockets = {}      # abstract sockets of the library that one of the processes held: inode -> name

    # ------------------------------------------------------------------------------------------------------ processes

    def start(self, kind, index):
        process = harness.Peer('%s_%s%d' % (self.prefix, kind, index), self.preload, threads=2)
        self.processes.append(process)
        return process

    def start_publisher(self, index):
        self.last_identity += 1
        self.identities[index] = self.last_identity
        peer = self.start('publisher', index).ready()
        self.publishers[index] = peer
        peer.call('advertise', topic=self.topics[index % TOPICS], queue=QUEUE, id=self.last_identity)
        self.publish(index)

    def publish(self, index):
        self.publishers[index].call('publish', count=0, rate=RATE_HZ, sizes=SIZES, background=True)

    def start_subscriber(self, index):
        peer = self.start('subscriber', index).ready()
        self.subscribers[index] = peer
        for i, topic in enumerate(self.topics):
            peer.call('subscribe', **{'as': i}, topic=topic, queue=QUEUE)

    def close(self):
        for process in self.processes:
            process.close()

    # --------------------------------------------------------------------------------------------------------- judging

    def judge(self, name, report):
        """No gap, damage or reordering in any flow, of the living and of the dead."""
        if report['corrupt']:
            raise Violation('%s received %d damaged messages: %s' % (name, report['corrupt'], report))
        for identity, flow in report['flows'].items():
            if flow['lost'] or flow['reordered']:
                raise Violation('%s: publisher %s: %d lost, %d out of order: %s'
                                % (name, identity, flow['lost'], flow['reordered'], flow))

    def reports(self, index):
        peer = self.subscribers[index]
        reports = [peer.call('report', sub=i) for i in range(TOPICS)]
        for report in reports:
            self.judge(peer.name, report)
        return reports

    def await_flow_from_everybody(self):
        """Every living subscriber receives from every living publisher messages that were sent after this call."""
        sent = {i: peer.call('publisher')['published'] for i, peer in self.publishers.items()}
        self.await_numbers({i: number + FRESH for i, number in sent.items()})

    @staticmethod
    def links_of(peer):
        """Of a node that may be in a bad way."""
        try:
            return peer.bus_info()
        except (rosgraph.MasterException, OSError) as error:
            return '%s: %s' % (type(error).__name__, error)

    def await_numbers(self, numbers):
        wanted = []
        for i, number in numbers.items():
            for peer in self.subscribers.values():
                peer.send('await_received', sub=i % TOPICS, id=self.identities[i], seq=number)
                wanted.append((peer, i))
        failed = []
        for peer, i in wanted:
            reply = peer.answer(2 * harness.DEADLINE_S * len(wanted))
            if not reply['ok']:
                failed.append('%s receives nothing new from %s: %s; links: %s'
                              % (peer.name, self.publishers[i].name, reply, self.links_of(peer)))
        if failed:
            raise Violation('\n'.join(failed))

    def await_links(self):
        """Every living subscriber has one link to each living publisher, of the expected transport.

        roscpp itself sometimes keeps a link to a publisher that died while it connected, and retries it for ever (seen
        with and without the library), so links to the dead are not judged.
        """
        expected = 'SHMROS' if self.preload else 'TCPROS'
        master = rosgraph.Master('/judge')
        wanted = sorted((master.lookupNode(peer.name), self.topics[i % TOPICS], expected)
                        for i, peer in self.publishers.items())
        living = {uri for uri, _, _ in wanted}
        for peer in self.subscribers.values():
            def links():
                return sorted((entry[1], entry[4], entry[3]) for entry in peer.bus_info()
                              if entry[2] == 'i' and entry[1] in living)
            harness.await_state(lambda: links() == wanted,
                                lambda: 'links of %s to living publishers: %s, expected %s'
                                % (peer.name, links(), wanted))

    def quiet(self):
        """Ends the traffic, checks that all of it arrived, and returns the footprint of the two old processes."""
        numbers = {i: peer.call('stop')['published'] for i, peer in self.publishers.items()}
        self.await_numbers(numbers)
        for index in self.subscribers:
            self.reports(index)
        old = (self.publishers[0], self.subscribers[0])
        for peer in old:
            peer.call('trim')
        return [harness.Footprint(peer.pid) for peer in old]

    # ----------------------------------------------------------------------------------------------------------- kills

    def kill_one(self):
        kind = self.random.choice(['traffic', 'traffic', 'held', 'stopped', 'newborn'])
        role = self.random.choice(['publisher', 'subscriber'])
        index = self.random.randrange(1, PUBLISHERS if role == 'publisher' else SUBSCRIBERS)
        peers = self.publishers if role == 'publisher' else self.subscribers
        peer = peers[index]
        pause = self.random.uniform(0, 0.1)  # the moment of a kill is random in time, not tied to an event
        if role == 'subscriber':
            self.checked += sum(report['received'] for report in self.reports(index))
            if kind == 'held':
                for i in range(TOPICS):
                    peer.call('hold', sub=i)
        elif kind == 'held':
            kind = 'traffic'  # a publisher has no callback to hold
        if kind == 'stopped':
            peer.signal(signal.SIGSTOP)
        time.sleep(pause)
        self.kill(peer)
        del peers[index]
        if kind == 'newborn':
            # The successor dies as well, somewhere between exec and its first messages.
            newborn = self.start(role, index)
            if self.random.random() < 0.7:
                newborn.ready()
                newborn.send('advertise' if role == 'publisher' else 'subscribe', topic=self.topics[index % TOPICS],
                             queue=QUEUE, id=0)
            time.sleep(self.random.uniform(0, 0.3))
            self.kill(newborn)
            self.done[role + ' newborn'] = self.done.get(role + ' newborn', 0) + 1
        self.done[role + ' ' + ('traffic' if kind == 'newborn' else kind)] = \
            self.done.get(role + ' ' + ('traffic' if kind == 'newborn' else kind), 0) + 1
        if role == 'publisher':
            self.start_publisher(index)
        else:
            self.start_subscriber(index)

    def kill(self, peer):
        self.sockets.update(sockets_of(peer.pid))
        peer.kill()

    def killed(self):
        return sum(self.done.values())

    def run(self):
        """Runs the campaign; raises Violation or AssertionError at the first thing that does not hold."""
        begun = time.monotonic()
        shm_before = set(os.listdir('/dev/shm'))
        try:
            for index in range(SUBSCRIBERS):
                self.start_subscriber(index)
            for index in range(PUBLISHERS):
                self.start_publisher(index)
            self.await_flow_from_everybody()
            self.await_links()
            before = None
            while self.killed() < self.kills:
                if before is None and self.killed() >= min(WARM_UP_KILLS, self.kills // 3):
                    self.await_links()
                    before = self.quiet()
                    for index in self.publishers:
                        self.publish(index)
                self.kill_one()
                self.await_flow_from_everybody()
                for index in self.subscribers:
                    self.reports(index)
                if self.killed() % 25 == 0:
                    self.say('%d kills, %.0f s' % (self.killed(), time.monotonic() - begun))
            self.await_links()
            after = self.quiet()
            self.judge_growth(before, after)
            self.checked += sum(report['received'] for index in self.subscribers for report in self.reports(index))
            said = [line for process in self.processes for line in process.warnings()]
            for process in self.processes:
                if process.alive():
                    self.kill(process)
            self.close()
            if self.preload and len(self.sockets) < self.kills:
                raise Violation('saw only %d sockets of the library in %d processes: this check is blind'
                                % (len(self.sockets), len(self.processes)))
            self.judge_leftovers(shm_before)
        finally:
            self.close()
        self.say('%d kills (%s) in %.0f s; %d messages checked, none lost, damaged or out of order between survivors'
                 % (self.killed(), ', '.join('%d %s' % (n, kind) for kind, n in sorted(self.done.items())),
                    time.monotonic() - begun, self.checked))
        for name, first, last in zip(('publisher', 'subscriber'), before, after):
            self.say('old %s after warm-up: %s; at the end: %s' % (name, first, last))
        self.say('warnings of the library: %d%s' % (len(said), ''.join('\n  ' + line for line in said[:5])))

    def judge_growth(self, before, after):
        old = (self.publishers[0], self.subscribers[0])
        # roscpp closes the descriptors of a link in its poll thread some time after the link is gone.
        for peer, first in zip(old, before):
            harness.await_state(lambda: len(harness.open_files(peer.pid)) <= first.files + MAX_DESCRIPTOR_GROWTH,
                                lambda: '%s: %d descriptors, %d after warm-up: %s'
                                % (peer.name, len(harness.open_files(peer.pid)), first.files,
                                   sorted(harness.open_files(peer.pid))))
        for peer, first, last in zip(old, before, after):
            if (last.anonymous > first.anonymous + MAX_ANONYMOUS_GROWTH_KB + ROSCPP_LEAK_KB * self.killed() or
                    last.memfd > first.memfd + MAX_POOL_GROWTH_KB):
                raise Violation('%s grew: after warm-up %s; at the end %s' % (peer.name, first, last))

    def judge_leftovers(self, shm_before):
        left = set(os.listdir('/dev/shm')) - shm_before
        if left:
            raise Violation('left in /dev/shm: %s' % sorted(left))
        now = library_sockets()
        left = {inode: name for inode, name in self.sockets.items() if now.get(inode) == name}
        if left:
            raise Violation('left in /proc/net/unix: %s' % left)
        children = children_of(os.getpid())
        if children:
            raise Violation('processes left: %s' % children)


def library_sockets():
    """The abstract unix sockets of the library on this machine, of whatever process: inode -> name."""
    with open('/proc/net/unix') as table:
        rows = [line.split() for line in table]
    return {row[6]: row[7] for row in rows if len(row) == 8 and row[7].startswith('@') and 'pi_os' in row[7]}


def sockets_of(pid):
    """Those of them that a process holds."""
    held = {match.group(1) for match in (re.match(r'socket:\[(\d+)\]', name) for name in harness.open_files(pid))
            if match}
    return {inode: name for inode, name in library_sockets().items() if inode in held}


def children_of(parent):
    """(pid, name, state) of every child, zombies included; a master that this program started is not one of them."""
    found = []
    for entry in os.listdir('/proc'):
        if entry.isdigit():
            try:
                with open('/proc/%s/stat' % entry) as stat:
                    text = stat.read()
            except (FileNotFoundError, ProcessLookupError):
                continue
            fields = text.rsplit(')', 1)[1].split()
            if int(fields[1]) == parent and int(entry) not in masters:
                found.append((int(entry), text[text.index('(') + 1:text.rindex(')')], fields[0]))
    return found


masters = set()


@contextlib.contextmanager
def own_master():
    """A pi_master for the nodes of a campaign, also where another master answers: when the successor of a killed node
    registers, rosmaster tells whoever has got the port of the dead one to shut down. With the random ports of 100 kills
    that hits an innocent node in one campaign of 20."""
    before = os.environ.get('ROS_MASTER_URI')
    master = core_harness.Core('pi_master')
    os.environ['ROS_MASTER_URI'] = master.uri
    masters.add(master.pid)
    try:
        yield
    finally:
        master.close()
        masters.discard(master.pid)
        if before is None:
            del os.environ['ROS_MASTER_URI']
        else:
            os.environ['ROS_MASTER_URI'] = before


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--preload', default='', help='path of libpi_os_transport.so; empty: TCPROS')
    parser.add_argument('--kills', type=int, default=300)
    parser.add_argument('--seed', type=int, default=1)
    options, _ = parser.parse_known_args()
    if options.preload and not os.path.isfile(options.preload):
        parser.error('--preload=%s does not exist: build the target pi_os_transport' % options.preload)
    try:
        with own_master():
            Campaign(options.preload, options.kills, options.seed, lambda line: print(line, flush=True)).run()
    except (Violation, AssertionError) as violation:
        print('VIOLATION (seed %d): %s' % (options.seed, violation), file=sys.stderr)
        return 1
    return 0


if __name__ == '__main__':
    sys.exit(main())
