"""Why a link or a service is on TCPROS, and what to do."""
import dataclasses
import fnmatch
import os

from . import graph, processes, tables

ADVICE = {
    'not_preloaded': 'start it with LD_PRELOAD=<prefix>/lib/libpi_os_transport.so (in a launch file <env '
                     'name="LD_PRELOAD" value="..."/>), or link the library',
    'python': 'nothing: π-OS is for roscpp nodes, rospy always uses TCPROS',
    'pi_core': 'nothing: the node /rosout of pi_core takes the log over TCPROS',
    'no_roscpp': 'link it against the shared libroscpp: a static one cannot be taken over',
    'declined': 'build pi_os_transport against the installed libroscpp; the warning in the log of the node says more',
    'disabled': 'leave out PI_OS_ENABLE=0 and the parameter pi_os/enable',
    'excluded': 'change PI_OS_INCLUDE, PI_OS_EXCLUDE or the parameters pi_os/include and pi_os/exclude',
    'udp': 'leave out udp() of its TransportHints',
    'users': 'run both under one user: shared memory is handed to nobody else',
    'namespaces': 'give both containers one network namespace (--network host, or container:<other>), or use the '
                  'bridge',
    'other_device': 'run pi_os_bridge on both devices: it carries links between them (shown as NNROS)',
    'peer_version': 'use one build of the library for both nodes',
    'no_memory': 'raise the limits of the process (ulimit -n, -v) or of its control group; its log says which failed',
    'negotiating': 'ask again in a moment; if it stays, one network thread is stopped or busy',
    'broken': 'restart both nodes: one wrote nonsense into the shared ring; a build of the library of its own?',
    'gone': 'see that the node runs and that its host name resolves here',
    'pool_full': 'raise PI_OS_POOL_LIMIT_MB of the node that sends',
    'min_bytes': 'lower PI_OS_MIN_BYTES of the node that sends, if small messages are to use shared memory too',
    'unknown': 'please report it with the output of pi_os links --json',
}


@dataclasses.dataclass
class Finding:
    """What is on TCPROS, why, and what to do."""
    what: str          # topic or service with the two nodes
    reason: str        # a key of ADVICE
    text: str
    partly: bool = False  # some messages only

    def advice(self):
        return ADVICE[self.reason]

    def line(self):
        return '%s: %s\n    %s' % (self.what, self.text, self.advice())


class Doctor:
    """Judges the links of one moment.

    @param nodes  graph.read()
    @param states  of the processes that answered, see processes.read_all()
    @param look  processes.look, or a stand-in for it
    """

    def __init__(self, nodes, states, look=processes.look):
        self.nodes = nodes
        self.states = {state['node']: state for state in states}
        self.by_uri = {node.uri: node.name for node in nodes.values() if node.uri}
        self.look = look
        self.seen = {}

    def process(self, name):
        if name not in self.seen:
            node = self.nodes.get(name)
            state = self.states.get(name)
            pid = state['pid'] if state else node.pid if node and node.pid and node.is_local() else None
            self.seen[name] = self.look(pid) if pid else None
        return self.seen[name]

    def findings(self):
        found = []
        for node in sorted(self.nodes.values(), key=lambda entry: entry.name):
            for entry in node.bus or ():
                # [id, peer, direction, transport, topic, connected, ...]: the subscriber's end names the publisher.
                if len(entry) < 5 or entry[2] != 'i' or entry[3] not in ('TCPROS', 'UDPROS'):
                    continue
                publisher = self.by_uri.get(entry[1], entry[1])
                if publisher != node.name:
                    found.append(self.judge_link(entry[4], publisher, node.name, entry[3]))
        found += self.partial_links()
        found += self.services()
        return found

    def judge_link(self, topic, publisher, subscriber, transport):
        what = '%s from %s to %s' % (topic, publisher, subscriber)
        if transport == 'UDPROS':
            return Finding(what, 'udp', '%s asks for UDP' % subscriber)
        reason, text = self.judge(topic, publisher, subscriber)
        if reason is None:
            entry = next((link for link in tables.joined_links(self.states.values())
                          if (link['topic'], link['publisher'], link['subscriber']) == (topic, publisher, subscriber)),
                         None)
            reason, text = self.recorded(entry['reason_subscriber'] if entry else '',
                                         entry['reason_publisher'] if entry else '', publisher, subscriber)
        return Finding(what, reason, text)

    def judge(self, name, giver, taker):
        """(key of ADVICE, text) from what is known of the two nodes; (None, '') if it shows nothing."""
        for node in (giver, taker):
            reason, text = self.judge_node(node)
            if reason:
                return reason, text
        for node in (giver, taker):
            options = self.states[node]['options']
            if not options['enable']:
                return 'disabled', 'the library is switched off in %s' % node
            hit = next((pattern for pattern in options['exclude'] if fnmatch.fnmatchcase(name, pattern)), None)
            if hit is not None:
                return 'excluded', '%s excludes it by the pattern "%s"' % (node, hit)
            if not any(fnmatch.fnmatchcase(name, pattern) for pattern in options['include']):
                return 'excluded', '%s includes only %s' % (node, ', '.join('"%s"' % p for p in options['include']))
        if self.states[giver]['protocol'] != self.states[taker]['protocol']:
            return 'peer_version', '%s has version %s of the protocol, %s has %s' % (
                giver, self.states[giver]['protocol'], taker, self.states[taker]['protocol'])
        return None, ''

    def judge_node(self, name):
        """What speaks against one node, for it has not answered; (None, '') if it has."""
        if name in self.states:
            return None, ''
        node = self.nodes.get(name)
        if node is None or node.pid is None:
            return 'gone', '%s is registered but does not answer' % name
        if not node.is_local():
            return 'other_device', '%s runs on another device or in a container with its own address (%s)' % (name,
                                                                                                              node.uri)
        process = self.process(name)
        if process is None:
            return 'namespaces', '%s (%s) is not to be seen from here: it runs in another container' % (name, node.uri)
        if process.user != processes.user_name(os.geteuid()):
            return 'users', '%s runs under user %s, you under %s' % (name, process.user,
                                                                     processes.user_name(os.geteuid()))
        if process.network is not None and process.network != os.stat('/proc/self/ns/net').st_ino:
            return 'namespaces', '%s runs in another network namespace' % name
        if process.program == 'pi_core':
            return 'pi_core', '%s is the node of pi_core' % name
        if process.has('libpython') or os.path.basename(process.has('python3')).startswith('python3'):
            if not process.has('libroscpp.so'):
                return 'python', '%s is a rospy node' % name
        if not process.has(processes.LIBRARY):
            return 'not_preloaded', '%s runs without the library' % name
        if not process.has('libroscpp.so'):
            return 'no_roscpp', '%s has the library, but no shared libroscpp' % name
        return 'declined', '%s has the library, which stepped aside beside %s' % (name, process.has('libroscpp.so'))

    def recorded(self, of_taker, of_giver, giver, taker):
        """From the reasons that the two processes have noted."""
        reason = of_taker if of_taker not in ('', 'negotiating') else of_giver or of_taker
        texts = {'udp': ('udp', '%s asks for UDP' % taker),
                 'other_user': ('users', '%s and %s run under different users' % (giver, taker)),
                 'unreachable': ('namespaces', '%s cannot reach the socket of %s: another network namespace'
                                 % (taker, giver)),
                 'peer_version': ('peer_version', '%s and %s have libraries of different versions' % (giver, taker)),
                 'peer_silent': ('not_preloaded', 'the other end offers no shared memory'),
                 'no_memory': ('no_memory', 'there was no memory or no descriptor for the link'),
                 'negotiating': ('negotiating', '%s and %s are still agreeing on it' % (giver, taker)),
                 'broken': ('broken', 'the shared ring broke')}
        return texts.get(reason, ('unknown', 'nothing explains it (%s, %s)' % (of_taker, of_giver)))

    def partial_links(self):
        found = []
        for link in tables.joined_links(self.states.values()):
            if link['transport'] != 'SHMROS':
                continue
            what = '%s from %s to %s' % (link['topic'], link['publisher'], link['subscriber'])
            if link['pool_full']:
                state = self.states[link['publisher']]
                found.append(Finding(what, 'pool_full', '%d messages found the pool of %s full (limit %.0f MiB: %s)'
                                     % (link['pool_full'], link['publisher'], state['pool']['limit'] / 2.0 ** 20,
                                        state['pool']['last_error'] or 'too small'), partly=True))
                continue
            least = self.states.get(link['publisher'], {}).get('options', {}).get('min_bytes', 0)
            if link['tcp'] > 0 and least > 0:
                found.append(Finding(what, 'min_bytes', '%d messages were smaller than the %d bytes of %s, or came '
                                     'before the link stood' % (link['tcp'], least, link['publisher']), partly=True))
        return found

    def services(self):
        providers = {service: node.name for node in self.nodes.values() for service in node.services}
        found = []
        for client, state in sorted(self.states.items()):
            for entry in state['service_clients']:
                server = providers.get(entry['service'])
                what = 'service %s from %s to %s' % (entry['service'], client, server or 'nobody')
                if entry['pool_full']:
                    found.append(Finding(what, 'pool_full', '%d requests found the pool of %s full'
                                         % (entry['pool_full'], client), partly=True))
                if not server or not entry['reason'] or (entry['reason'] == 'negotiating' and entry['memory']):
                    continue
                reason, text = self.judge(entry['service'], server, client)
                if reason is None and entry['reason'] == 'negotiating':
                    continue  # the first calls of each connection go over TCPROS while the rings are made
                if reason is None:
                    reason, text = self.recorded(entry['reason'], '', server, client)
                found.append(Finding(what, reason, text))
        return found


def examine(master_uri=None):
    """(findings, states, complaints). @raise graph.GraphError"""
    nodes = graph.read(master_uri)
    states, complaints = processes.read_all()
    graph.part_stale(nodes, states)
    # Others on this device may use another master.
    states = [state for state in states if state['node'] in nodes and nodes[state['node']].pid in (state['pid'], None)]
    return Doctor(nodes, states).findings(), states, complaints
