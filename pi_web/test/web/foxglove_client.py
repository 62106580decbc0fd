"""A client of the Foxglove WebSocket protocol for tests, with sockets alone: it can also misbehave."""

import base64
import json
import os
import socket
import ssl
import struct
import time
from urllib.parse import urlsplit

import genpy.dynamic

TEXT, BINARY, CLOSE, PING, PONG = 1, 2, 8, 9, 10


class Refused(Exception):
    """The HTTP answer in place of a WebSocket."""


class WebSocket:
    """Blocking; limit_s is that of each operation. tls: an ssl.SSLContext for wss://."""

    def __init__(self, url, protocols=(), headers=(), limit_s=20.0, receive_buffer=0, tls=None):
        parts = urlsplit(url)
        self.socket = socket.socket()
        if receive_buffer:
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
        self.socket.settimeout(limit_s)
        self.socket.connect((parts.hostname, parts.port))
        if parts.scheme == "wss":
            self.socket = (tls or ssl.create_default_context()).wrap_socket(self.socket, server_hostname=parts.hostname)
        path = (parts.path or "/") + ("?" + parts.query if parts.query else "")
        lines = ["GET %s HTTP/1.1" % path, "Upgrade: websocket", "Connection: Upgrade", "Sec-WebSocket-Version: 13",
                 "Sec-WebSocket-Key: " + base64.b64encode(os.urandom(16)).decode()]
        if not any(line.startswith("Host:") for line in headers):
            lines.append("Host: " + parts.netloc)
        if protocols:
            lines.append("Sec-WebSocket-Protocol: " + ", ".join(protocols))
        self.socket.sendall("\r\n".join([*lines, *headers, "", ""]).encode())
        self.buffer = b""
        head = b""
        while not head.endswith(b"\r\n\r\n"):
            head += self.take(1)
        self.head = head.decode()
        if " 101 " not in self.head.split("\r\n")[0]:
            raise Refused(self.head + self.take_all().decode(errors="replace"))

    def take(self, count):
        while len(self.buffer) < count:
            some = self.socket.recv(max(65536, count - len(self.buffer)))
            if not some:
                raise ConnectionError("the server ended the connection")
            self.buffer += some
        taken, self.buffer = self.buffer[:count], self.buffer[count:]
        return taken

    def take_all(self):
        """Until the server ends the connection."""
        while True:
            some = self.socket.recv(65536)
            if not some:
                return self.buffer
            self.buffer += some

    def send_frame(self, opcode, payload, announced=None):
        """announced: a length that is not the true one."""
        length = len(payload) if announced is None else announced
        head = bytes([0x80 | opcode])
        if length < 126:
            head += bytes([0x80 | length])
        elif length < 65536:
            head += bytes([0x80 | 126]) + struct.pack(">H", length)
        else:
            head += bytes([0x80 | 127]) + struct.pack(">Q", length)
        mask = os.urandom(4)
        masked = bytes(byte ^ mask[i % 4] for i, byte in enumerate(payload))
        self.socket.sendall(head + mask + masked)

    def receive(self):
        """(opcode, payload) of a message; answers pings."""
        message, kind = b"", 0
        while True:
            first, second = self.take(2)
            length = second & 127
            if length == 126:
                length = struct.unpack(">H", self.take(2))[0]
            elif length == 127:
                length = struct.unpack(">Q", self.take(8))[0]
            payload = self.take(length)
            opcode = first & 15
            if opcode == PING:
                self.send_frame(PONG, payload)
            elif opcode == CLOSE:
                raise ConnectionError("the server closes")
            elif opcode != PONG:
                kind = opcode or kind
                message += payload
                if first & 128:
                    return kind, message

    def close(self):
        self.socket.close()


class FoxgloveClient(WebSocket):
    PROTOCOLS = ("foxglove.sdk.v1", "foxglove.websocket.v1")

    def __init__(self, url, protocols=PROTOCOLS, **options):
        super().__init__(url, protocols, **options)
        self.channels = {}   # by topic
        self.services = {}   # by name
        self.waiting = []    # what came while something else was awaited
        self.info = self.next_op("serverInfo")

    def ask(self, op, **fields):
        self.send_frame(TEXT, json.dumps({"op": op, **fields}).encode())

    def next(self):
        """A dictionary of a text message, or (opcode, bytes) of a binary one. Keeps channels and services."""
        kind, payload = self.receive()
        if kind == BINARY:
            return payload[0], payload[1:]
        message = json.loads(payload)
        if message["op"] == "advertise":
            self.channels.update({one["topic"]: one for one in message["channels"]})
        elif message["op"] == "unadvertise":
            gone = set(message["channelIds"])
            self.channels = {topic: one for topic, one in self.channels.items() if one["id"] not in gone}
        elif message["op"] == "advertiseServices":
            self.services.update({one["name"]: one for one in message["services"]})
        return message

    def next_where(self, right, limit_s=20.0):
        deadline = time.monotonic() + limit_s
        while time.monotonic() < deadline:
            message = self.next()
            if right(message):
                return message
        raise TimeoutError("the awaited message did not come")

    def next_op(self, op, **options):
        return self.next_where(lambda message: isinstance(message, dict) and message["op"] == op, **options)

    def wait_for_channels(self, *topics):
        while not set(topics) <= set(self.channels):
            self.next()
        return [self.channels[topic] for topic in topics]

    def subscribe(self, *topics):
        """The id of the subscription is that of the channel."""
        channels = self.wait_for_channels(*topics)
        self.ask("subscribe", subscriptions=[{"id": one["id"], "channelId": one["id"]} for one in channels])

    def next_data(self, topic):
        """(stamp in ns, bytes) of the next message of a topic."""
        number = self.channels[topic]["id"]
        _, data = self.next_where(lambda message: isinstance(message, tuple) and message[0] == 1 and
                                  struct.unpack_from("<I", message[1])[0] == number)
        return struct.unpack_from("<Q", data, 4)[0], data[12:]

    def decode(self, topic, data):
        """By the definition that the server gave, not by modules of this computer."""
        channel = self.channels[topic]
        made = genpy.dynamic.generate_dynamic(channel["schemaName"], channel["schema"])[channel["schemaName"]]()
        return made.deserialize(data)

    def call(self, service, request=b"", call_id=7):
        """The bytes of the response, or the dictionary of a failure."""
        number = self.services[service]["id"]
        self.send_frame(BINARY, struct.pack("<BIII", 2, number, call_id, 4) + b"ros1" + request)
        answer = self.next_where(lambda message: message[0] == 3 if isinstance(message, tuple)
                                 else message["op"] in ("serviceCallFailure", "status"))
        return answer[1][16:] if isinstance(answer, tuple) else answer

    def publish(self, channel, data):
        self.send_frame(BINARY, struct.pack("<BI", 1, channel) + data)
