"""What ends the demo early."""


class DemoError(Exception):
    """What went wrong and the way out, for the terminal."""


class Interrupted(BaseException):
    """A signal asked the demo to end. Not an Exception, so that no handler of those on the way takes it."""

    def __init__(self, number):
        super().__init__("signal %d" % number)
        self.number = number
