"""What the master and the nodes tell of the graph, by the API that every node has."""
import dataclasses
import os
import socket
import urllib.parse
import xmlrpc.client

CALLER = '/pi_os'
NODE_ANSWER_S = 3.0


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
    code, text, value = function(CALLER, *arguments)
    if code != 1:
        raise GraphError(text)
    return value


def read(uri=None):
    """All nodes by name. @raise GraphError if there is no master"""
    uri = uri or os.environ.get('ROS_MASTER_URI', 'http://localhost:11311')
    master = proxy(uri)
    try:
        publishers, subscribers, services = call(master.getSystemState)
    except (OSError, xmlrpc.client.Error) as error:
        raise GraphError('no master answers at %s (%s): start roscore, or set ROS_MASTER_URI' % (uri, error))
    nodes = {name: Node(name) for table in (publishers, subscribers, services) for _, names in table for name in names}
    for service, names in services:
        for name in names:
            nodes[name].services += (service,)
    for node in nodes.values():
        try:
            node.uri = call(master.lookupNode, node.name)
            slave = proxy(node.uri)
            node.pid = call(slave.getPid)
            node.bus = call(slave.getBusInfo)
        except (OSError, xmlrpc.client.Error, GraphError):
            continue  # it has died, or is on a device that cannot be reached
    return nodes
