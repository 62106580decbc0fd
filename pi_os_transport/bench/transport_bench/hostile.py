"""Frames that no bridge should accept: recorded from real traffic and mutated, or made up."""

import collections
import random
import socket
import struct
import threading

from .devices import BRIDGE_PORT, SEGMENT_BYTES
from .modes import BenchError

ETHERNET_IPV4 = 0x0800
TCP = 6
SYN = 0x02

# As in src/bridge/wire_frame.h, docs/design/device_bridge.md.
GREETING = b'\0SP\0\0\x50\0\0'  # of a PUSH socket in nanomsg's pipeline
GREETING_BYTES = 8
LENGTH_BYTES = 8
MAGIC = 0x506f
WIRE_VERSION = 1
HEADER_BYTES = 32
HELLO = 1
MAX_PAYLOAD = 256 * 1024
HEADER = struct.Struct('<HBBIQIIQ')  # magic, version, type, id, session, count, reserved, offset
FIELD_BITS = (16, 8, 8, 32, 64, 32, 32, 64)
HELLO_FIXED = HEADER_BYTES + 26  # byte of a hello: 1 if the address that it says counts, not the one that it comes from
KINDS = ('bits', 'field', 'truncated', 'length', 'oversized', 'version', 'session', 'handshake', 'garbage')
STRANGER = 'stranger'  # a kind of its own: a hello in the name of another device


class Recorder:
    """Records, in the router, what the bridge of one device receives: the TCP streams to its port."""

    def __init__(self, testbed, device, port=BRIDGE_PORT):
        self._port = port
        self._streams = collections.defaultdict(dict)
        self._first = {}
        self._ended = threading.Event()
        with testbed.router.entered():
            self._socket = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(3))
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 24)
        self._socket.bind((device.name, 0))
        self._socket.settimeout(0.1)
        self._thread = threading.Thread(target=self._record, daemon=True)
        self._thread.start()

    def _record(self):
        while not self._ended.is_set():
            try:
                packet = self._socket.recv(1 << 17)
            except socket.timeout:
                continue
            if len(packet) < 34 or struct.unpack_from('>H', packet, 12)[0] != ETHERNET_IPV4 or packet[23] != TCP:
                continue
            begin = 14 + 4 * (packet[14] & 15)
            end = 14 + struct.unpack_from('>H', packet, 16)[0]
            source, target, number = struct.unpack_from('>HHI', packet, begin)
            if target != self._port:
                continue
            stream = (packet[26:30], source)
            if packet[begin + 13] & SYN:
                self._first[stream] = number + 1
            payload = packet[begin + 4 * (packet[begin + 12] >> 4):end]
            if payload:
                self._streams[stream].setdefault(number, payload)

    def stop(self):
        """Ends the recording. @return the frames of all streams that were seen from their beginning."""
        self._ended.set()
        self._thread.join()
        self._socket.close()
        frames = []
        for stream, first in self._first.items():
            frames += split_frames(_joined(self._streams[stream], first))
        return frames


def _joined(pieces, first):
    """The bytes of a stream up to the first gap."""
    stream = bytearray()
    position = first
    while position in pieces:
        stream += pieces[position]
        position = (position + len(pieces[position])) % (1 << 32)
    return bytes(stream)


def split_frames(stream):
    """Frames (header and payload) of one direction of a connection between bridges; an incomplete last one is left."""
    frames = []
    position = GREETING_BYTES
    while position + LENGTH_BYTES <= len(stream):
        length = int.from_bytes(stream[position:position + LENGTH_BYTES], 'big')
        if position + LENGTH_BYTES + length > len(stream):
            break
        frames.append(stream[position + LENGTH_BYTES:position + LENGTH_BYTES + length])
        position += LENGTH_BYTES + length
    return frames


def _framed(frame, length=None):
    return (len(frame) if length is None else length).to_bytes(LENGTH_BYTES, 'big') + frame


def connect(target):
    """A connection of the namespace that the caller has entered. It waits for nothing longer than half a second."""
    return socket.create_connection(target, timeout=0.5)


class Attacker:
    """Sends bad frames, each kind in turn, every one on a connection of its own. The seed decides all."""

    def __init__(self, device, address, frames, seed=1, port=BRIDGE_PORT):
        by_type = {}
        for frame in frames:
            if len(frame) >= HEADER_BYTES and HEADER.unpack_from(frame)[:2] == (MAGIC, WIRE_VERSION):
                by_type.setdefault(frame[3], []).append(frame)
        if len(by_type) < 3 or HELLO not in by_type:
            raise BenchError(f'only frames of types {sorted(by_type)} were recorded: too little to mutate')
        self.types = sorted(by_type)
        self._frames = by_type
        self._device, self._target = device, (address, port)
        self._random = random.Random(seed)
        self.sent = collections.Counter()  # by kind
        self.unended = 0                   # connections that the bridge kept open though nothing more could come

    def send(self, count, kinds=KINDS):
        for i in range(count):
            kind = kinds[i % len(kinds)]
            self._send_one(self._bytes(kind))
            self.sent[kind] += 1

    def _send_one(self, data):
        try:
            with self._device.entered():
                connection = connect(self._target)
        except ConnectionError:
            return  # ended before it was begun
        with connection:
            try:
                connection.sendall(data)
                connection.shutdown(socket.SHUT_WR)
                while connection.recv(4096):
                    pass
            except socket.timeout:
                self.unended += 1
            except OSError:
                pass  # ended by the bridge while we wrote or with bytes of ours unread

    def _valid(self):
        """A recorded frame; each type is as likely as any other."""
        return self._random.choice(self._frames[self._random.choice(self.types)])

    def _bytes(self, kind):
        """All that one connection says."""
        pick = self._random
        if kind == 'handshake':
            return pick.randbytes(GREETING_BYTES) + _framed(self._valid())
        if kind == 'garbage':
            return GREETING * pick.randrange(2) + pick.randbytes(pick.randint(2 * LENGTH_BYTES, 4 * SEGMENT_BYTES))
        if kind == STRANGER:
            return GREETING + _framed(self._hello_of_a_stranger())
        greeting = GREETING + _framed(pick.choice(self._frames[HELLO])) * (kind == 'session' or pick.random() < 0.3)
        frame = bytearray(self._valid())
        length = None
        if kind == 'bits':
            fixed = frame[HELLO_FIXED] if frame[3] == HELLO else None  # stays: else the hello may be a stranger's
            for _ in range(pick.randint(1, 8)):
                frame[pick.randrange(len(frame))] ^= 1 << pick.randrange(8)
            if fixed is not None:
                frame[HELLO_FIXED] = fixed
        elif kind == 'field':
            values = list(HEADER.unpack_from(frame))
            index = pick.randrange(2, len(values))
            bits = FIELD_BITS[index]
            values[index] = pick.choice((0, 1, (1 << bits) - 1, pick.getrandbits(bits)))
            HEADER.pack_into(frame, 0, *values)
        elif kind == 'truncated':
            return (greeting + _framed(frame))[:-pick.randint(1, len(frame))]
        elif kind == 'length':
            length = pick.choice((0, 1, HEADER_BYTES - 1, len(frame) - 1, len(frame) + 1))
        elif kind == 'oversized':
            length = HEADER_BYTES + MAX_PAYLOAD + pick.choice((1, 1000, 1 << 30, 1 << 62))
        elif kind == 'version':
            frame[2] = pick.choice((0, 2, 3, 255))
        elif kind == 'session':
            frame = bytearray(self._valid_but_hello())
            frame[8:16] = pick.getrandbits(64).to_bytes(8, 'little')
        return greeting + _framed(frame, length)

    def _valid_but_hello(self):
        return self._random.choice(self._frames[self._random.choice([t for t in self.types if t != HELLO])])

    def _hello_of_a_stranger(self):
        frame = bytearray(self._random.choice(self._frames[HELLO]))
        address = frame.index(b'.', HELLO_FIXED + 6) - 1  # the last digit of the address's first number
        frame[HELLO_FIXED] = 1
        frame[address] = ord('9') if frame[address] != ord('9') else ord('8')
        frame[HEADER_BYTES + 16:HEADER_BYTES + 24] = bytes(8)  # echo: of a bridge that is not known yet
        return frame
