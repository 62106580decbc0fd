"""A bridge that is none: greets another one as docs/design/device_bridge.md says, then sends what a test wants."""
import socket
import struct
import threading
import time

from transport_bench import hostile
from transport_bench.devices import BRIDGE_PORT

PULL = b'\0SP\0\0\x51\0\0'
HELLO, PING, TUNNEL_OPEN, TUNNEL_READY, TUNNEL_CLOSE = 1, 2, 15, 16, 19
SERVER_BIT = 1 << 31
EXPRESS, BULK = 0, 1
HELLO_HEAD = struct.Struct('<QQQHHI')  # instance, secret, echo, port, fixed, max_message_bytes
PING_S = 0.1


def text(value):
    return struct.pack('<H', len(value)) + value.encode()


class FalseBridge:
    """Two connections in each direction, and a thread that pings and collects frames. `wrap(socket, server_side)` may
    put TLS around each."""

    def __init__(self, device, target, wrap=lambda connection, server_side: connection):
        self._wrap = wrap
        self._instance, self._secret, self._theirs = 0x1234567, 0x7654321, 0
        self._frames, self._changed, self._closed = [], threading.Condition(), False
        self._lock = threading.Lock()
        with device.entered():
            self._listener = socket.create_server(('0.0.0.0', BRIDGE_PORT))
            self._out = [wrap(socket.create_connection((target, BRIDGE_PORT), timeout=5.0), False) for _ in range(2)]
        self._sockets = [self._listener, *self._out]
        for connection in self._out:
            connection.sendall(hostile.GREETING)
        self._threads = [threading.Thread(target=run, daemon=True) for run in (self._accept, self._ping)]
        for thread in self._threads:
            thread.start()
        self._hello()

    def _hello(self):
        payload = HELLO_HEAD.pack(self._instance, self._secret, self._theirs, BRIDGE_PORT, 0, 1 << 28)
        payload += text('') + text('false')
        for lane, connection in enumerate(self._out):
            self._send(connection, HELLO, lane, 0, lane, payload)

    def _send(self, connection, kind, identity, count, lane, payload=b''):
        frame = hostile.HEADER.pack(hostile.MAGIC, hostile.WIRE_VERSION, kind, identity, self._theirs, count, lane, 0)
        frame += payload
        with self._lock:
            try:
                connection.sendall(len(frame).to_bytes(hostile.LENGTH_BYTES, 'big') + frame)
            except OSError:
                pass  # the bridge has closed it, which the test sees

    def _accept(self):
        while True:
            try:
                connection, _ = self._listener.accept()
                connection = self._wrap(connection, True)
                connection.sendall(PULL)
            except OSError:
                return
            self._sockets.append(connection)
            threading.Thread(target=self._read, args=(connection,), daemon=True).start()

    def _read(self, connection):
        stream = connection.makefile('rb')
        try:
            stream.read(hostile.GREETING_BYTES)
            while True:
                length = int.from_bytes(stream.read(hostile.LENGTH_BYTES), 'big')
                frame = stream.read(length)
                if length == 0 or len(frame) < length:
                    return
                fields, payload = hostile.HEADER.unpack_from(frame), frame[hostile.HEADER_BYTES:]
                if fields[2] == HELLO:
                    self._on_hello(payload)
                with self._changed:
                    self._frames.append((fields, payload))
                    self._changed.notify_all()
        except (OSError, ValueError):
            pass

    def _on_hello(self, payload):
        secret = HELLO_HEAD.unpack_from(payload)[1]
        if secret != self._theirs:
            self._theirs = secret
            self._hello()

    def _ping(self):
        while not self._closed:
            if self._theirs:
                self._send(self._out[EXPRESS], PING, 0, 0, EXPRESS)
            time.sleep(PING_S)  # the protocol's own interval

    def await_frame(self, wanted, timeout_s):
        """The first frame (header fields, payload) for which wanted(type, id) is true; None after the timeout."""
        def find():
            return next((frame for frame in self._frames if wanted(frame[0][2], frame[0][3])), None)
        with self._changed:
            self._changed.wait_for(find, timeout_s)
            return find()

    def open_tunnel(self, identity, host, port, service, timeout_s):
        """@return '' if the bridge opened it, else the reason of its refusal"""
        self._send(self._out[EXPRESS], TUNNEL_OPEN, identity, port, EXPRESS, text(host) + text(service))
        frame = self.await_frame(lambda kind, number: kind in (TUNNEL_READY, TUNNEL_CLOSE) and
                                 number == identity | SERVER_BIT, timeout_s)
        if frame is None:
            raise AssertionError('no answer about the tunnel to %s:%d' % (host, port))
        fields, payload = frame
        return '' if fields[2] == TUNNEL_READY else payload[2:].decode()

    def met(self, timeout_s):
        """True if the bridge has connected and greeted."""
        return self.await_frame(lambda kind, _: kind == PING, timeout_s) is not None

    def close(self):
        self._closed = True
        for connection in self._sockets:
            try:
                connection.shutdown(socket.SHUT_RDWR)
            except OSError:
                pass
            connection.close()
