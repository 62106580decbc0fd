"""What chaos_sweep.py runs and looks at: a victim that dies at an exact stop, and what a survivor holds."""
import collections
import contextlib
import json
import os
import re
import signal
import subprocess
import tempfile

import transport_harness as harness

DEADLINE_S = 60.0   # of a victim and of each wait for a survivor; reached only when something is broken
TURN_S = 0.1
MORE_FILES = 6      # TCP connections that roscpp keeps for a while
MORE_MAPPINGS = 64  # stacks of threads and arenas of the allocator
MADE_LATE = collections.Counter(['[eventfd]'])  # that of the thread for full sockets, made when one is first needed
STOP_AT = harness.PACKAGE + '_test_stop_at'


class Violation(Exception):
    pass


class Stop(collections.namedtuple('Stop', 'thread number')):
    """Where a victim dies: at that stop of that thread, see sweep/stop_at.cpp."""

    def __str__(self):
        return '%d:%d' % self


def marked_steps(preload):
    """Names of the steps that are marked in the library."""
    arguments = [word for file in files_with_steps(preload) for word in ('--steps', file)]
    reported = subprocess.run([harness.program(STOP_AT), '--report', '1'] + arguments,
                              stdout=subprocess.PIPE, check=True)
    return set(json.loads(reported.stdout)['marked'])


def files_with_steps(preload):
    return [preload, os.path.join(os.path.dirname(preload), 'libpi_os_transport_roscpp.so')]


class Victim:
    """A program under sweep/stop_at.cpp. `report` is set once it has ended."""

    def __init__(self, command, stop, preload='', script='', env=None, device=None, pass_fds=()):
        self.report = None
        self.turns = int(DEADLINE_S / TURN_S)
        self._log = tempfile.TemporaryFile()
        self._script = tempfile.TemporaryFile()
        self._script.write(script.encode())
        self._script.seek(0)
        read_end, write_end = os.pipe()
        self._reports = os.fdopen(read_end)
        arguments = [harness.program(STOP_AT), '--report', str(write_end)]
        if stop:
            arguments += ['--kill', str(stop)]
        for file in files_with_steps(preload) if preload else command[:1]:
            arguments += ['--steps', file]
        if preload:
            arguments += ['--set', 'LD_PRELOAD=' + preload]
        environment = {key: value for key, value in os.environ.items()
                       if key != 'LD_PRELOAD' and not key.startswith('PI_OS_')}
        environment.update(env or {})
        with device.entered() if device else contextlib.nullcontext():
            self.popen = subprocess.Popen(['setpriv', '--pdeathsig', 'KILL'] + arguments + ['--'] + command,
                                          stdin=self._script, stdout=self._log, stderr=self._log, env=environment,
                                          pass_fds=(write_end,) + tuple(pass_fds))
        os.close(write_end)

    def ended(self):
        return self.popen.poll() is not None

    def pid(self):
        """Of the program; None if it has ended."""
        try:
            with open('/proc/%d/task/%d/children' % (self.popen.pid, self.popen.pid)) as children:
                return int(children.read().split()[0])
        except (FileNotFoundError, IndexError):
            return None

    def terminate(self):
        with contextlib.suppress(ProcessLookupError, TypeError):
            os.kill(self.pid(), signal.SIGTERM)

    def output(self):
        self._log.seek(0)
        return self._log.read().decode('utf-8', 'replace')

    def finish(self):
        if self.report:
            return self.report
        while not self.ended():
            # By turns of this process, not by the clock: a campaign of lowest priority may stand still for long.
            self.turns -= 1
            if self.turns < 0:
                raise Violation('the victim hangs: not at its end within %.0f s; its output: %s'
                                % (DEADLINE_S, self.output()[-1500:]))
            with contextlib.suppress(subprocess.TimeoutExpired):
                self.popen.wait(TURN_S)
        line = self._reports.readline()
        if not line:
            raise Violation('no report of the victim: %s' % self.output()[-1500:])
        self.report = json.loads(line)
        return self.report

    def close(self):
        if not self.ended():
            self.popen.kill()  # the kernel ends the program with it
        self.popen.wait()
        for file in (self._log, self._script, self._reports):
            file.close()


class Holdings:
    """What a process holds of the library: descriptors and mappings, and how many of all others."""

    def __init__(self, pid):
        with open('/proc/%d/net/unix' % pid) as table:
            local = {row.split()[6] for row in list(table)[1:]}
        self.exact = collections.Counter()
        self.files = 0
        for target in harness.open_files(pid):
            match = re.match(r'socket:\[(\d+)\]|/memfd:(pi_os_ring)|anon_inode:(\[eventfd\])', target)
            kind = match and (match.group(2) or match.group(3) or ('unix' if match.group(1) in local else None))
            self.files += not kind and 'pi_os_pool' not in target
            if kind:
                self.exact[kind] += 1
        maps = mappings(pid)
        rings = maps.count('memfd:pi_os_ring')
        self.exact['ring mapped'] += rings
        self.mappings = maps.count('\n') - rings - maps.count('memfd:pi_os_pool')

    def exceeds(self, before):
        made_late = self.exact - before.exact == MADE_LATE and not before.exact - self.exact
        return ((self.exact != before.exact and not made_late) or self.files > before.files + MORE_FILES or
                self.mappings > before.mappings + MORE_MAPPINGS)

    def __repr__(self):
        return '%s, %d other descriptors, %d other mappings' % (
            ', '.join('%d %s' % (n, kind) for kind, n in sorted(self.exact.items())) or 'nothing of the library',
            self.files, self.mappings)


def mappings(pid):
    with open('/proc/%d/maps' % pid) as maps:
        return maps.read()


def pools(pid):
    """Inodes of the segments that a process maps."""
    return set(re.findall(r' (\d+) +/memfd:pi_os_pool', mappings(pid)))
