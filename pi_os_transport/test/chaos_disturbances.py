"""What else than kills the campaign of chaos.py does to its nodes. Each disturbance is a function of the campaign that
returns once its own effect has been judged; the campaign then waits for messages between all survivors."""
import os
import re
import resource
import signal
import struct
import time

import hostile_peers
import kill_campaign

HUGE = 256 << 20
SIZES = [0, 1, 3, 4, 5, 63, 64, 65, 4095, 4096, 4097, 65536, 1 << 20, 16 << 20, 64 << 20, HUGE]
STORM_ROUNDS = 25
DAY_NS = 24 * 3600 * 10**9


def stop_and_continue(campaign):
    """Any of the nodes, those that live through the campaign as well."""
    chosen = campaign.random.sample(campaign.everybody(), campaign.random.randint(1, 3))
    for peer in chosen:
        peer.signal(signal.SIGSTOP)
    time.sleep(campaign.random.uniform(0.01, 0.4))  # how long is random, not tied to an event
    for peer in chosen:
        peer.signal(signal.SIGCONT)
    return len(chosen)


def fork_and_exec(campaign):
    """Children that run another program or end at once, and one that outlives its parent."""
    chosen = campaign.random.sample(campaign.everybody(), 2)
    for peer in chosen:
        for kind, status in (('exec', 7), ('exit', 3)):
            reply = peer.call('fork', kind=kind)
            if reply['status'] != status:
                raise kill_campaign.Violation('%s: its child ended with %s: %s' % (peer.name, status, reply))
    role, index = campaign.choose_victim()
    child = campaign.peers(role)[index].call('fork', kind='idle')['pid']
    try:
        campaign.replace([(role, index, 'forked')])
        campaign.await_flow_from_everybody()
    finally:
        os.kill(child, signal.SIGKILL)
    return 2 * len(chosen) + 1


def descriptor_exhaustion(campaign):
    """A node that can open nothing, or next to nothing, while others want links to it. roscpp does not recover from all
    of what fails there, so it is killed in the end; everybody else must not notice."""
    role, index = campaign.choose_victim()
    victim = campaign.peers(role)[index]
    highest = max(int(fd) for fd in os.listdir('/proc/%d/fd' % victim.pid))
    _, hard = resource.prlimit(victim.pid, resource.RLIMIT_NOFILE)
    resource.prlimit(victim.pid, resource.RLIMIT_NOFILE, (highest + 1 + campaign.random.randrange(0, 8), hard))
    others = [(other, campaign.random.randrange(1, kill_campaign.SUBSCRIBERS)) for other in ('publisher', 'subscriber')]
    campaign.replace([(other, i, 'traffic') for other, i in others if (other, i) != (role, index)])
    time.sleep(campaign.random.uniform(0, 0.3))
    if not victim.alive():
        raise kill_campaign.Violation('%s ended without descriptors: %s' % (victim.name, victim.lines[-5:]))
    resource.prlimit(victim.pid, resource.RLIMIT_NOFILE, (hard, hard))
    campaign.replace([(role, index, 'exhausted')])
    return 1


def memory_limits(campaign):
    """A publisher whose pool, file size or address space is limited: it falls back to TCPROS, message by message or for
    good, and says so once."""
    index = campaign.random.randrange(1, kill_campaign.PUBLISHERS)
    with open('/proc/%d/status' % campaign.publishers[index].pid) as status:
        peak_kb = int(re.search(r'VmPeak:\s+(\d+)', status.read()).group(1))
    limits = [dict(env={'PI_OS_POOL_LIMIT_MB': '1'}), dict(prefix=['prlimit', '--fsize=500000'])]
    if campaign.preload:
        limits.append(dict(prefix=['prlimit', '--as=%d' % ((peak_kb - 300000) * 1024)]))  # no room for the pool
    campaign.replace([('publisher', index, 'traffic')], **campaign.random.choice(limits))
    campaign.await_flow_from_everybody()
    campaign.replace([('publisher', index, 'limited')])
    return 1


def full_dev_shm(campaign):
    """Not one byte is left in /dev/shm while nodes start, send and die."""
    path = '/dev/shm/chaos_%d' % os.getpid()
    with open(path, 'wb', buffering=0) as filler:
        try:
            while filler.write(bytes(4096)):
                pass
        except OSError:  # full
            pass
    try:
        campaign.replace([('publisher', campaign.random.randrange(1, kill_campaign.PUBLISHERS), 'traffic'),
                          ('subscriber', campaign.random.randrange(1, kill_campaign.SUBSCRIBERS), 'traffic')])
        campaign.await_flow_from_everybody()
    finally:
        os.remove(path)
    return 1


def clock_jump(campaign):
    """The wall clock of all nodes goes forward or back by up to a day, while nodes come and go."""
    for _ in range(2):
        campaign.set_clock(campaign.random.randint(-DAY_NS, DAY_NS))
        campaign.replace([campaign.choose_victim() + ('traffic',)])
        campaign.await_flow_from_everybody()
    campaign.set_clock(0)
    return 3


def message_sizes(campaign):
    """From nothing to 256 MB, through a link of their own; then both ends are killed, the second within a message."""
    topic = '/%s_sizes%d' % (campaign.prefix, campaign.next_topic())
    talker, listener = campaign.start('talker', 0), campaign.start('listener', 0)
    talker.ready().call('advertise', topic=topic, queue=3, id=1)
    listener.ready().call('subscribe', topic=topic, queue=3)
    talker.call('await_subscribers', n=1)
    for number, size in enumerate(campaign.sizes, 1):
        talker.call('publish', count=1, sizes=size)
        report = listener.call('await_received', seq=number)
        campaign.judge(listener.name, report)
    if report['bytes'] != sum(campaign.sizes):
        raise kill_campaign.Violation('%s received %d bytes of %d'
                                      % (listener.name, report['bytes'], sum(campaign.sizes)))
    talker.call('publish', count=2, sizes=campaign.sizes[-1], background=True)
    time.sleep(campaign.random.uniform(0, 0.5))
    for peer, kind in campaign.random.sample([(talker, 'publisher huge'), (listener, 'subscriber huge')], 2):
        campaign.kill(peer)
        campaign.count(kind)
    return len(campaign.sizes)


def subscription_storm(campaign):
    """Subscribes, unsubscribes, advertises and unadvertises as fast as it can, and dies within."""
    peer = campaign.start('storm', 0).ready()
    said = 0
    for round_ in range(STORM_ROUNDS):
        peer.send('subscribe', **{'as': round_ % 3}, topic=campaign.random.choice(campaign.topics), queue=10)
        peer.send('unsubscribe', sub=round_ % 3)
        peer.send('advertise', **{'as': round_ % 2}, topic='/%s_storm' % campaign.prefix, queue=10, id=9)
        peer.send('unadvertise', pub=round_ % 2)
        said += 4
    for _ in range(campaign.random.randrange(said // 2, said)):
        peer.result()
    campaign.kill(peer)
    campaign.count('storm')
    return said


def hostile_subscriber(campaign):
    """Every kind in turn, against the publisher that lives through the campaign."""
    if not campaign.preload:
        return 0
    kind = campaign.turn(hostile_peers.HostileSubscriber.KINDS)
    peer = hostile_peers.HostileSubscriber(campaign.publishers[0].name, campaign.topics[0],
                                           campaign.random.getrandbits(32))
    peer.misbehave(kind)
    campaign.count_hostile('subscriber: ' + kind)
    return 1


def hostile_publisher(campaign):
    """Every kind in turn, against all subscribers."""
    if not campaign.preload:
        return 0
    kind = campaign.turn(hostile_peers.HostilePublisher.KINDS)
    peer = hostile_peers.HostilePublisher(campaign.topics[0], campaign.random.getrandbits(32))
    peer.misbehave(kind, len(campaign.subscribers))
    campaign.count_hostile('publisher: ' + kind)
    return 1


def many_nodes(campaign):
    """A graph of its own, of as many nodes as the vehicle never has: all of them get everything, then all die."""
    per_topic = 10
    publishers = 2
    graph = []
    for index in range(campaign.nodes):
        graph.append((campaign.start('node', index), '/%s_graph%d' % (campaign.prefix, index // per_topic)))
        if len(graph) % per_topic == 0 or index + 1 == campaign.nodes:
            for peer, _ in graph[index - index % per_topic:]:
                peer.ready()
    speakers = {}
    for index, (peer, topic) in enumerate(graph):
        if index % per_topic < publishers:
            peer.call('advertise', topic=topic, queue=100, id=index + 1)
            speakers.setdefault(topic, []).append((peer, index + 1))
    listeners = [(peer, topic) for index, (peer, topic) in enumerate(graph) if index % per_topic >= publishers]
    for peer, topic in listeners:
        peer.call('subscribe', topic=topic, queue=100)
    for topic, peers in speakers.items():
        for peer, _ in peers:
            peer.call('await_subscribers', n=sum(1 for _, other in listeners if other == topic))
    for peers in speakers.values():
        for peer, _ in peers:
            peer.send('publish', count=20, rate=20, sizes='rand:64:200000')
    for peers in speakers.values():
        for peer, _ in peers:
            peer.result()
    for peer, topic in listeners:
        for _, identity in speakers[topic]:
            report = peer.call('await_received', id=identity, seq=20)
        campaign.judge(peer.name, report)
        campaign.checked += report['received']
    for peer, _ in campaign.random.sample(graph, len(graph)):
        campaign.kill(peer)
        campaign.count('one of many')
    return campaign.nodes


DISTURBANCES = {
    'SIGSTOP and SIGCONT': stop_and_continue,
    'fork and exec': fork_and_exec,
    'descriptor exhaustion': descriptor_exhaustion,
    'memory limits': memory_limits,
    'full /dev/shm': full_dev_shm,
    'clock jumps': clock_jump,
    'subscribe and unsubscribe': subscription_storm,
    'hostile subscribers': hostile_subscriber,
    'hostile publishers': hostile_publisher,
}
RARE = {
    'message sizes up to 256 MB': message_sizes,
    'nodes at a time': many_nodes,
}
CLOCK = struct.Struct('<q')
