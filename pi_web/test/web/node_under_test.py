"""Starts web_view_node, and knows its address and log."""

import os
import re
import signal
import subprocess
import threading

import roslib.packages

TOKEN = "0123456789abcdef0123"
READY = re.compile(r"the vehicle is at (https?://[\w.\[\]:]+/)")


class WebViewNode:
    """@param parameters  private ones; port is one that is free."""

    def __init__(self, folder, name="web_view", **parameters):
        self.token_file = os.path.join(folder, "token")
        with open(self.token_file, "w", encoding="ascii") as file:
            file.write(TOKEN + "\n")
        program = roslib.packages.find_node("pi_web", "web_view_node")
        if not program:
            raise RuntimeError("web_view_node is not built")
        given = {"port": 0, "token_file": self.token_file, "incidents_folder": folder, **parameters}
        self.process = subprocess.Popen(
            [program[0], "__name:=" + name, *("_%s:=%s" % (key, value) for key, value in given.items())],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, bufsize=1,
            env={**os.environ, "ROSCONSOLE_STDOUT_LINE_BUFFERED": "1"})
        self.lines = []
        self.url = None
        self._ready = threading.Event()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        if not self._ready.wait(60) or not self.url:
            self.stop()
            raise RuntimeError("web_view_node does not start: " + "".join(self.lines))

    def _read(self):
        for line in self.process.stdout:
            self.lines.append(line)
            found = READY.search(line)
            if found:
                self.url = found.group(1)
                self._ready.set()
        self._ready.set()

    @property
    def websocket(self):
        return self.url.replace("http", "ws", 1)

    @property
    def control(self):
        return self.websocket + "?token=" + TOKEN

    def status(self, field):
        with open("/proc/%d/status" % self.process.pid, encoding="ascii") as file:
            return int(re.search(r"^%s:\s+(\d+)" % field, file.read(), re.MULTILINE).group(1))

    def descriptors(self):
        return len(os.listdir("/proc/%d/fd" % self.process.pid))

    def stop(self):
        """@return the exit status"""
        self.process.send_signal(signal.SIGINT)
        try:
            return self.process.wait(20)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            raise
        finally:
            self._reader.join(5)
