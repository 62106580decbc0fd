"""Faults of a scenario that the simulator only announces, in its log: killed nodes, edge nodes out of reach."""

import json
import os
import signal


class RunnerFaults:
    """@param pids  {node: process id}, kept up to date by somebody else. @param edge  processes of the edge servers.
    Main thread only."""

    def __init__(self, log_path, pids, edge):
        self._path = log_path
        self._pids = pids
        self._edge = edge
        self._read = 0      # bytes of the log
        self.done = []      # {"stamp", "line", "problem"}; problem "": it was done

    def tick(self):
        """Executes what was announced since the last call."""
        with open(self._path, "rb") as file:
            file.seek(self._read)
            lines = file.read()
        whole = lines.rfind(b"\n") + 1
        self._read += whole
        for line in lines[:whole].splitlines():
            if b'"type":"command"' in line:
                fact = json.loads(line)
                words = fact["line"].split()
                if words[0] in ("kill", "radio"):
                    problem = self._execute(*words)
                    print("  fault: %s%s" % (fact["line"], problem and ", not done: " + problem))
                    self.done.append({"stamp": fact["stamp"], "line": fact["line"], "problem": problem})

    def _execute(self, word, argument):
        """@return the problem; "": done"""
        if word == "radio":
            # Silent, but not gone: as behind a hill.
            for process in self._edge:
                process.send_signal(signal.SIGCONT if argument == "on" else signal.SIGSTOP)
            return "" if self._edge else "the scenario has no edge_nodes, or --no-offload was given"
        name = argument.strip("/")
        pid = self._pids().get(name)
        if pid is None:
            return "no node %s runs, but %s" % (name, ", ".join(sorted(self._pids())))
        os.kill(pid, signal.SIGKILL)
        return ""

    def end(self):
        """Stopped servers can be ended like others again."""
        for process in self._edge:
            process.send_signal(signal.SIGCONT)
