"""Chromium without a screen, by its debugging protocol."""

import base64
import json
import re
import shutil
import subprocess
import tempfile
import threading

from foxglove_client import TEXT, WebSocket

ADDRESS = re.compile(r"DevTools listening on (ws://\S+)")


def find():
    return shutil.which("chromium") or shutil.which("chromium-browser")


class Page:
    """A page of its own browser. @param size  width and height in pixels."""

    def __init__(self, size=(1440, 900), dark=False):
        self._folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)  # its children may still write
        self._process = subprocess.Popen(
            [find(), "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run",
             "--disable-extensions", "--remote-debugging-port=0", "--user-data-dir=" + self._folder.name,
             "about:blank"],
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        address = None
        for line in self._process.stderr:
            found = ADDRESS.search(line)
            if found:
                address = found.group(1)
                break
        if not address:
            raise RuntimeError("Chromium does not start")
        threading.Thread(target=lambda: [None for _ in self._process.stderr], daemon=True).start()
        self._browser = WebSocket(address, limit_s=60.0)
        self._last = 0
        self._session = None
        self.problems = []  # of the page's scripts
        target = self._ask("Target.createTarget", url="about:blank")["targetId"]
        self._session = self._ask("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self._ask(domain + ".enable")
        self._ask("Emulation.setEmulatedMedia", features=[
            {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}])
        self.resize(*size)

    def _ask(self, method, **parameters):
        self._last += 1
        message = {"id": self._last, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        self._browser.send_frame(TEXT, json.dumps(message).encode())
        while True:
            answer = json.loads(self._browser.receive()[1])
            if answer.get("method") == "Runtime.exceptionThrown":
                self.problems.append(json.dumps(answer["params"]["exceptionDetails"])[:600])
            elif answer.get("method") == "Log.entryAdded" and answer["params"]["entry"]["level"] == "error":
                self.problems.append(answer["params"]["entry"]["text"])
            if answer.get("id") == self._last:
                if "error" in answer:
                    raise RuntimeError("%s: %s" % (method, answer["error"]))
                return answer["result"]

    def resize(self, width, height, mobile=False):
        self._ask("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=mobile)

    def open(self, url):
        self._ask("Page.navigate", url=url)

    def evaluate(self, script):
        """The value of an expression; of a promise, what it resolves to."""
        answer = self._ask("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in answer:
            raise RuntimeError(answer["exceptionDetails"].get("exception", {}).get("description", "the script failed"))
        return answer["result"].get("value")

    def wait_until(self, condition, limit_s=40):
        """Until an expression is true; looks at every frame of the page. @return the value"""
        return self.evaluate("""new Promise((resolve, reject) => {
          const late = performance.now() + %d;
          const look = () => {
            let value;
            try { value = %s; } catch (error) { value = false; }
            if (value) resolve(value);
            else if (performance.now() > late) reject(new Error(%s + ' within %d s'));
            else setTimeout(look, 20);
          };
          look();
        })""" % (limit_s * 1000, condition, json.dumps(condition), limit_s))

    def click(self, x, y):
        for kind in ("mousePressed", "mouseReleased"):
            self._ask("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def middle_of(self, selector):
        """Of an element, once it has stayed in its place for ten looks: what comes in moves what is below it."""
        self.evaluate("window.looks = []")
        return self.wait_until(
            "(({x, y, width, height}) => { looks.unshift([x + width / 2, y + height / 2]);"
            " return looks.length > 10 && looks.slice(0, 10).every((one) => String(one) === String(looks[0])) && looks[0];"
            " })(document.querySelector(%s).getBoundingClientRect())" % json.dumps(selector))

    def click_on(self, selector):
        self.click(*self.middle_of(selector))

    def picture(self, path, whole=False):
        answer = self._ask("Page.captureScreenshot", format="png", captureBeyondViewport=whole,
                           **({"clip": {"x": 0, "y": 0, "scale": 1, **self.evaluate(
                               "({width: window.innerWidth,"
                               " height: document.documentElement.scrollHeight})")}} if whole else {}))
        with open(path, "wb") as file:
            file.write(base64.b64decode(answer["data"]))

    def close(self):
        self._browser.close()
        self._process.terminate()
        try:
            self._process.wait(20)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._folder.cleanup()
