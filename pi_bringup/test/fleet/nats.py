"""A client of NATS and a nats-server of a site, for tests: the text protocol over TLS, as nats.io describes it."""

import collections
import json
import os
import queue
import re
import shutil
import signal
import socket
import ssl
import subprocess
import threading
from pathlib import Path

LIMIT_S = 60.0


class Refused(Exception):
    """The server closed the connection, or said why it refuses something."""


class Client:
    """One connection. @param folder  with ca.pem, certificate.pem and key.pem; None: no certificate."""

    def __init__(self, port, folder, authority=None):
        self._socket = socket.create_connection(("localhost", port), timeout=LIMIT_S)
        self._buffer = b""
        self._subscriptions = 0
        self.messages = collections.deque()  # received while this client waited for something else
        try:
            self.information = json.loads(self._line().partition(" ")[2])
            context = ssl.create_default_context(cafile=str((authority or folder) / "ca.pem"))
            if folder:
                context.load_cert_chain(folder / "certificate.pem", folder / "key.pem")
            self._socket = context.wrap_socket(self._socket, server_hostname="localhost")
            self._send("CONNECT " + json.dumps({"verbose": False, "pedantic": False, "tls_required": True,
                                                "protocol": 1, "lang": "python", "version": "1", "name": "test", "headers": True,
                                                "no_responders": True}))
            self.flush()
        except OSError as error:
            self.close()
            raise Refused(str(error)) from error
        except BaseException:
            self.close()
            raise

    def close(self):
        self._socket.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def _send(self, line, payload=None):
        self._socket.sendall(line.encode() + b"\r\n" + (b"" if payload is None else payload + b"\r\n"))

    def _more(self):
        part = self._socket.recv(1 << 16)
        if not part:
            raise Refused("closed")
        self._buffer += part

    def _line(self):
        while b"\r\n" not in self._buffer:
            self._more()
        line, _, self._buffer = self._buffer.partition(b"\r\n")
        return line.decode()

    def _bytes(self, count):
        while len(self._buffer) < count:
            self._more()
        taken, self._buffer = self._buffer[:count], self._buffer[count:]
        return taken

    def flush(self):
        """Until the server has done all that was sent; what it sent before is in `messages`. @throws Refused"""
        self._send("PING")
        while not self._handle(self._line()):
            pass

    def _handle(self, line):
        """@return whether it is PONG. @throws Refused"""
        words = line.split()
        if words[0] == "PING":
            self._send("PONG")
        elif words[0] == "-ERR":
            raise Refused(line)
        elif words[0] in ("MSG", "HMSG"):
            sizes = 1 if words[0] == "MSG" else 2
            payload = self._bytes(int(words[-1]) + 2)[:-2]
            self.messages.append((words[1], words[3] if len(words) == 4 + sizes else "", payload))
        return words[0] == "PONG"

    def subscribe(self, subject, group=""):
        self._subscriptions += 1
        self._send(f"SUB {subject} {group} {self._subscriptions}")
        self.flush()

    def publish(self, subject, payload, reply=""):
        self._send(f"PUB {subject} {reply} {len(payload)}", payload)

    def receive(self):
        """@return (subject, reply, payload); of "no responders" the payload is its header. @throws Refused"""
        while not self.messages:
            self._handle(self._line())
        return self.messages.popleft()

    def ended(self):
        """Waits until the server closes this connection. @return what it said last"""
        said = ""
        try:
            while True:
                said = self._line()
        except (Refused, OSError):
            return said


class Server:
    """A nats-server with the configuration that pi_edge fleet wrote."""

    def __init__(self, configuration):
        self._lines = queue.Queue()
        self._seen = []
        self._process = subprocess.Popen([program(), "-c", configuration], stdin=subprocess.DEVNULL,
                                         stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        self._reader = threading.Thread(target=self._read)
        self._reader.start()
        self.wait_for("Server is ready")

    def _read(self):
        for line in self._process.stderr:
            self._lines.put(line)
        self._lines.put("")

    def wait_for(self, pattern):
        """Of the lines that no call has waited for yet, one with this pattern."""
        for index, line in enumerate(self._seen):
            if re.search(pattern, line):
                del self._seen[:index + 1]
                return line
        while True:
            line = self._lines.get(timeout=LIMIT_S)
            if not line:
                raise AssertionError(f"nats-server has ended before it said {pattern}: " + "".join(self._seen[-5:]))
            if re.search(pattern, line):
                self._seen.clear()
                return line
            self._seen.append(line)

    def reload(self):
        self._process.send_signal(signal.SIGHUP)
        self.wait_for("Reloaded server configuration")

    def stop(self):
        self._process.terminate()
        self._process.wait(LIMIT_S)
        self._reader.join()
        self._process.stderr.close()


def program():
    return shutil.which("nats-server", path=os.environ.get("PATH", "") + ":/usr/sbin")


def free_ports(count):
    sockets = [socket.socket() for _ in range(count)]
    try:
        for one in sockets:
            one.bind(("localhost", 0))
        return [one.getsockname()[1] for one in sockets]
    finally:
        for one in sockets:
            one.close()


def check(configuration):
    """nats-server's own judgement of a configuration. @return (status, text)"""
    done = subprocess.run([program(), "-c", str(Path(configuration)), "-t"], stdout=subprocess.PIPE,
                          stderr=subprocess.STDOUT, text=True, timeout=LIMIT_S, check=False)
    return done.returncode, done.stdout
