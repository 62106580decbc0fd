"""ros_master.py DESCRIPTOR: rosmaster, to compare with pi_core, on a port that nobody uses; writes its URI to the descriptor once it serves.

The rosmaster program neither takes any free port nor says when it is ready."""

import os
import signal
import sys

import rosgraph.roslogging
from rosmaster.master import Master


def main():
    rosgraph.roslogging.configure_logging("rosmaster", filename="master.log")
    master = Master(port=0)
    master.start()
    with os.fdopen(int(sys.argv[1]), "w") as pipe:
        pipe.write(master.uri + "\n")
    signal.sigwait({signal.SIGINT, signal.SIGTERM})
    os._exit(0)  # nothing to save; connections of its threads are not worth waiting for


if __name__ == "__main__":
    # Before the threads of the master, which inherit it: the signals then reach sigwait alone.
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    main()
