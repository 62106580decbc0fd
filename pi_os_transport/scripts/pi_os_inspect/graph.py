"""What the master and the nodes tell of the graph, by the API that every node has."""
import dataclasses
import http.client
import os
import socket
import urllib.parse
import xml.parsers.expat
import xmlrpc.client

CALLER = '/pi_os'
NODE_ANSWER_S = 3.0
# What comes of a server that is not there, leaves, or answers something else.
CALL_ERRORS = (OSError, ValueError, TypeError, http.client.HTTPException, xmlrpc.client.Error,
               xml.parsers.expat.ExpatError)


class GraphError(Exception):
    """The master does not answer; the text says what to do."""


class Timeout(xmlrpc.client.Transport):
    def make_connection(self, host):
        connection = super().make_connection(host)
        connection.timeout = NODE_ANSWER_S
        return connection


def proxy(uri):
    return xmlrpc.client.ServerProxy(uri, transport=Timeout())


@dataclasses.dataclass
class Node:
    name: str
    uri: str = ''
    pid: int = None        # None: it does not answer
    bus: list = None       # entries of getBusInfo
    services: tuple = ()   # names of those that it serves

    def is_local(self):
        """True if its address is one of this device."""
        host = urllib.parse.urlsplit(self.uri).hostname or ''
        try:
            addresses = {info[4] for info in socket.getaddrinfo(host, None)}
        except OSError:
            return False
        for address in addresses:
            with socket.socket(socket.AF_INET6 if len(address) == 4 else socket.AF_INET, socket.SOCK_DGRAM) as probe:
                try:
                    probe.bind((address[0], 0))  # only an own address can be bound
                    return True
                except OSError:
                    continue
        return False


def call(function, *arguments):
    answer = function(CALLER, *arguments)
    if not isinstance(answer, list) or len(answer) != 3 or answer[0] != 1:
        raise GraphError('%.200s' % ascii(answer))
    return answer[2]


def call_for(kind, function, *arguments):
    """As call(), for a value of the type `kind`."""
    value = call(function, *arguments)
    if not isinstance(value, kind):
        raise GraphError('%.200s' % ascii(value))
    return value


def bus_entries(info):
    """Those entries of getBusInfo that are some: their first five members are id and texts."""
    return [entry for entry in info if isinstance(entry, list) and len(entry) >= 5 and
            all(isinstance(member, str) for member in entry[1:5])]


def read(uri=None):
    """All nodes by name. @raise GraphError if there is no master"""
    uri = uri or os.environ.get('ROS_MASTER_URI', 'http://localhost:11311')
    master = proxy(uri)
    try:
        publishers, subscribers, services = call(master.getSystemState)
    except CALL_ERRORS as error:
        raise GraphError('no master answers at %s (%s): start roscore, or set ROS_MASTER_URI' % (uri, error))
    nodes = {name: Node(name) for table in (publishers, subscribers, services) for _, names in table for name in names}
    for service, names in services:
        for name in names:
            nodes[name].services += (service,)
    for node in nodes.values():
        try:
            node.uri = call_for(str, master.lookupNode, node.name)
            slave = proxy(node.uri)
            node.pid = call_for(int, slave.getPid)
            node.bus = bus_entries(call_for(list, slave.getBusInfo))
        except (*CALL_ERRORS, GraphError):
            continue  # it has died, is on a device that cannot be reached, or is no node
    return nodes


def part_stale(nodes, states):
    """Takes the address from those that are dead and whose address another node has since: only their registration is
    left. Of several names at one address the living one is that which the node itself tells (rospy) or its library
    (states of processes)."""
    at = {}
    for node in nodes.values():
        if node.pid is not None:
            at.setdefault((node.uri, node.pid), []).append(node)
    names = {state['pid']: state['node'] for state in states}
    for (uri, pid), group in at.items():
        if len(group) < 2:
            continue
        try:
            living = call_for(str, proxy(uri).getName)
        except (*CALL_ERRORS, GraphError):  # roscpp has no getName
            living = names.get(pid)
        if any(node.name == living for node in group):
            for node in group:
                if node.name != living:
                    node.uri, node.pid, node.bus = '', None, None
