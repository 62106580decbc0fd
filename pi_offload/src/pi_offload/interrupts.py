"""How tools end early, with what they began tidied up."""

import signal


def end_by_signals():
    """SIGTERM and SIGHUP end this process as Ctrl-C does, through what has to be tidied up."""
    def interrupt(*_):
        raise KeyboardInterrupt
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, interrupt)
