"""What the rostests of pi_core and pi_master share: starting them, talking to them."""
import http.client
import os
import re
import socket
import subprocess
import threading
import urllib.parse
import xmlrpc.client
import xmlrpc.server

import transport_harness as harness


class Core(harness.Process):
    """pi_core or pi_master, on a port that is free; ready once constructed."""

    def __init__(self, program='pi_core', args=(), env=None, prefix=()):
        read_end, write_end = os.pipe()
        with os.fdopen(read_end) as announced:
            try:
                super().__init__([harness.program(program), '-p', '0', '--announce', str(write_end)] + list(args),
                                 env=env, prefix=prefix, pass_fds=(write_end,))
            finally:
                os.close(write_end)
            self.uri = announced.readline().strip()
        if not self.uri:
            raise AssertionError('%s ended: %s' % (program, '\n'.join(self.lines)))
        self.environment = dict(env or {}, ROS_MASTER_URI=self.uri)
        self.api = xmlrpc.client.ServerProxy(self.uri)

    @property
    def address(self):
        parts = urllib.parse.urlsplit(self.uri)
        return parts.hostname, parts.port

    def call(self, method, *params):
        """The value of a call that has to succeed."""
        code, message, value = getattr(self.api, method)('/judge', *params)
        if code != 1:
            raise AssertionError('%s%r: %s' % (method, params, message))
        return value

    def run(self, *command, check=True, timeout=4 * harness.DEADLINE_S):
        """Output of a command in the graph of this master."""
        result = subprocess.run(command, env=dict(os.environ, **self.environment), stdin=subprocess.DEVNULL,
                                stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=timeout)
        if check and result.returncode != 0:
            raise AssertionError('%s ended with status %d: %s' % (command, result.returncode, result.stdout))
        return result.stdout

    def connect(self):
        """A connection to the master, for what no proper client sends."""
        return socket.create_connection(self.address, timeout=harness.DEADLINE_S)

    def post(self, body, **headers):
        """(status, body) of the answer to one request."""
        connection = http.client.HTTPConnection(*self.address, timeout=harness.DEADLINE_S)
        try:
            connection.request('POST', '/', body, headers)
            response = connection.getresponse()
            return response.status, response.read()
        finally:
            connection.close()

    def resident_kb(self):
        with open('/proc/%d/status' % self.pid) as status:
            return int(re.search(r'VmRSS:\s+(\d+)', status.read()).group(1))

    def proportional_kb(self):
        """Resident memory with each shared page divided by the number of processes that share it."""
        with open('/proc/%d/smaps_rollup' % self.pid) as rollup:
            return int(re.search(r'Pss:\s+(\d+)', rollup.read()).group(1))


class SlaveApi:
    """The slave API of a node that only remembers what it is told."""

    class Server(xmlrpc.server.SimpleXMLRPCServer):
        allow_reuse_address = True

    def __init__(self):
        self.changed = threading.Condition()
        self.told = []
        self.answers = {}  # method: what it returns instead of success
        self._server = self.Server(('localhost', 0), logRequests=False)
        for method in ('publisherUpdate', 'paramUpdate', 'shutdown'):
            self._server.register_function(lambda *params, method=method: self._take(method, params), method)
        self.uri = 'http://localhost:%d/' % self._server.server_address[1]
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()

    def _take(self, method, params):
        with self.changed:
            self.told.append((method,) + params[1:])
            self.changed.notify_all()
        return self.answers.get(method, [1, '', 0])

    def await_told(self, expected):
        """Waits until the calls are these, in this order."""
        with self.changed:
            if not self.changed.wait_for(lambda: self.told == expected, harness.DEADLINE_S):
                raise AssertionError('told %r, expected %r' % (self.told, expected))

    def close(self):
        self._server.shutdown()
        self._server.server_close()


class CoreTest(harness.TransportTest):
    """Base of the judges: each test has cores and log folders of its own."""

    def core(self, program='pi_core', args=(), env=None, **options):
        env = dict({'ROS_LOG_DIR': self.scratch(), 'ROS_HOSTNAME': 'localhost'}, **(env or {}))
        started = Core(program, args, env, **options)
        self.addCleanup(started.close)
        return started

    def slave(self):
        api = SlaveApi()
        self.addCleanup(api.close)
        return api

    def node(self, core, name, **options):
        """A node steered over pipes in the graph of a core."""
        return self.peer(name, env=core.environment, master=core.uri, **options)
