"""launcher.py ARGUMENTS...: roslaunch, which can be interrupted at once while it starts its nodes.

roslaunch's own signal handler ends the nodes and waits up to 20 s for the thread that does so. If the signal comes
while a node is being started, that thread waits as long for a lock that the interrupted main thread holds. Here the
handler only wakes another thread, which ends the nodes when no node is being started."""

import os
import threading

import roslaunch
from roslaunch import nodeprocess, pmon


class Ending:
    """Stands in for roslaunch's signal handler, which it calls from a thread of its own."""

    def __init__(self):
        self._end_nodes = pmon.rl_signal
        self._start_node = nodeprocess.LocalProcess.start
        self._starting = threading.Lock()
        self._begun = False
        self._read_end, self._write_end = os.pipe()
        pmon.rl_signal = self._on_signal
        nodeprocess.LocalProcess.start = lambda process: self._start(process)
        threading.Thread(target=self._run, daemon=True).start()

    def _on_signal(self, number, _):
        os.write(self._write_end, bytes([number]))  # takes no lock, whatever this thread was doing

    def _run(self):
        number = os.read(self._read_end, 1)[0]
        with self._starting:
            self._begun = True
        self._end_nodes(number, None)

    def _start(self, process):
        """@return False if all is ending: a node that starts now would be left over."""
        with self._starting:
            return not self._begun and self._start_node(process)


if __name__ == "__main__":
    ending = Ending()
    roslaunch.main()
