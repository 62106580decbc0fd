"""Asks the processes with the library for their state, and the kernel about those without.

A process with the library listens at an abstract socket pi_os/<token>. /proc/net/unix lists the sockets of this network
namespace; one packet asks a process, and it answers with a packet and a memfd that holds JSON. Only processes of the
same user are asked, as only they answer. Nothing happens in a node while nobody asks.
"""
import dataclasses
import json
import os
import pwd
import re
import socket
import struct

from . import shapes

PROTOCOL = 4                          # PROTOCOL_VERSION of the library
STATE_VERSION = 2
QUERY, STATE = 9, 10                  # types of packets
PACKET = struct.Struct('<IIIIQQQ')    # version, type, link, unused, values
SOCKET = re.compile(r'@(pi_os/[0-9a-f]{32})$')
LIBRARY = 'libpi_os_transport.so'
ANSWER_S = 2.0                        # roscpp's network thread answers within some milliseconds
MAX_STATE_BYTES = 256 << 20

HISTOGRAM = [int, 64]
OF_LINK = {'topic': str, 'type': str, 'transport': str, 'reason': str, 'memory?': int, 'tcp?': int, 'waiting?': int}
OF_SERVICE = {'service': str, 'memory': int, 'tcp': int, 'failed': int, 'pool_full': int, 'connections': int,
              'peers': [str], 'reason': str, 'durations': HISTOGRAM}
SHAPE = {'version': int, 'protocol': int, 'node': str, 'roscpp': str,
         'options': {'enable': bool, 'include': [str], 'exclude': [str], 'pool_limit_mb': int, 'min_bytes': int,
                     'skip_zero_fill': bool, 'bridge': str},
         'descriptors': {'open': int, 'limit': int},
         'pool': {'committed': int, 'limit': int, 'segments': int, 'live_slots': int, 'last_error': str},
         'skipped_zero_fills': int,
         'publications': [dict(OF_LINK, **{'subscriber': str, 'dropped?': int, 'queue_size?': int, 'pool_full?': int})],
         'subscriptions': [dict(OF_LINK, **{'publisher': str, 'uri': str, 'copied?': int, 'late?': int, 'missing?': int,
                                            'leased_bytes?': int, 'latencies?': HISTOGRAM})],
         'service_clients': [OF_SERVICE], 'service_servers': [OF_SERVICE]}


class Unanswered(Exception):
    """A process did not tell its state; the text says why."""


def sockets():
    """Names of the sockets in this network namespace at which processes with the library listen."""
    with open('/proc/net/unix') as table:
        names = (SOCKET.search(line.rstrip('\n')) for line in table)
        # Connections show as the socket that they came to.
        return sorted({name.group(1) for name in names if name})


def ask(name):
    """State of the process behind socket `name`. @raise Unanswered"""
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as channel:
        channel.settimeout(ANSWER_S)
        files = []
        try:
            channel.connect('\0' + name)
            pid, user, _ = struct.unpack('iII', channel.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12))
            if user != os.geteuid():
                raise Unanswered('process %d of user %s answers its own user only' % (pid, user_name(user)))
            channel.send(PACKET.pack(PROTOCOL, QUERY, 0, 0, 0, 0, 0))
            answer, files, _, _ = socket.recv_fds(channel, PACKET.size + 1, 1)
            return parse(pid, answer, files)
        except socket.timeout:
            raise Unanswered('%s gave no answer within %g s: its network thread is stopped or busy' % (name, ANSWER_S))
        except OSError as error:
            raise Unanswered('%s ended while it was asked (%s)' % (name, error))
        finally:
            for descriptor in files:
                os.close(descriptor)


def parse(pid, answer, files):
    if len(answer) != PACKET.size or len(files) != 1:
        raise Unanswered('process %d closed the connection in place of an answer: its library speaks another version '
                         'than %d of this tool; use those of one installation' % (pid, PROTOCOL))
    version, kind, _, _, size, _, _ = PACKET.unpack(answer)
    if (version, kind) != (PROTOCOL, STATE) or size > MAX_STATE_BYTES:
        raise Unanswered('process %d answered packet %d of version %d with %d bytes, must be a state of version %d'
                         % (pid, kind, version, size, PROTOCOL))
    text = b''
    while len(text) < size:
        part = os.pread(files[0], size - len(text), len(text))
        if not part:
            break
        text += part
    try:
        state = json.loads(text.decode())
        version = state['version']
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise Unanswered('process %d answered no JSON object with a version (%s)' % (pid, error))
    if version != STATE_VERSION:
        raise Unanswered('process %d answered a state of version %.40s, must be %d: use library and pi_os of one '
                         'installation' % (pid, ascii(version), STATE_VERSION))
    try:
        return dict(shapes.fit(state, SHAPE), pid=pid)
    except shapes.Misshapen as error:
        raise Unanswered('process %d answered a state that is none (%s): use library and pi_os of one installation'
                         % (pid, error))


def read_all():
    """(states of all processes that answer, why the others did not)"""
    states, complaints = [], []
    for name in sockets():
        try:
            states.append(ask(name))
        except Unanswered as error:
            complaints.append(str(error))
    return sorted(states, key=lambda state: state['node']), complaints


def user_name(user):
    try:
        return pwd.getpwuid(user).pw_name
    except KeyError:
        return str(user)


@dataclasses.dataclass
class Process:
    """What the kernel tells of a process of this device; fields are None where this user may not look."""
    pid: int
    user: str
    network: int = None      # inode of its network namespace
    libraries: set = None    # paths of the files it has mapped
    program: str = ''        # name of its executable

    def has(self, name):
        """The path of the mapped file whose name starts with `name`; '' if there is none or nobody may look."""
        return next((path for path in sorted(self.libraries or ()) if os.path.basename(path).startswith(name)), '')


def look(pid):
    """The process `pid`; None if there is none that this process can see."""
    folder = '/proc/%d' % pid
    try:
        found = Process(pid, user_name(os.stat(folder).st_uid))
    except OSError:
        return None
    try:
        found.program = os.path.basename(os.readlink(folder + '/exe'))
        found.network = os.stat(folder + '/ns/net').st_ino
        with open(folder + '/maps') as maps:
            found.libraries = {line.split(None, 5)[5].rstrip('\n') for line in maps if '/' in line}
    except OSError:
        pass
    return found
