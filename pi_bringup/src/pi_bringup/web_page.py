"""pi_edge open: prints the address of the vehicle's page, and starts its server where it does not run. With a recording,
shows that in the page: no vehicle and no ROS master are needed."""

import contextlib
import http.server
import shutil
import socket
import ssl
import subprocess
import sys
import time
from pathlib import Path
from urllib.parse import urlsplit

NODE = "/web_view"
ADDRESS = NODE + "/address_in_use"  # left by the node
STARTS_S = 20.0
ANSWERS_S = 3.0


def add_to(commands):
    """Adds the command to pi_edge."""
    command = commands.add_parser("open", help="prints the address of the vehicle's page; starts its server if needed",
                                  description=__doc__)
    command.add_argument("recording", nargs="?", type=Path, metavar="FILE.bag",
                         help="of the recorder: an incident, or a piece of the continuous recording")
    command.add_argument("--listen", metavar="ADDRESS", help="where a server that is started listens; 0.0.0.0: "
                         "also for other computers, with a token; default: 127.0.0.1")
    command.add_argument("--port", type=int, help="of a server that is started; default: 8890")
    command.add_argument("--tls", metavar="DIR", help="a server that is started speaks https, by certificate.pem and "
                         "key.pem of this folder, as pi_edge fleet makes them")
    command.add_argument("--control", action="store_true", help="a server that is started lets those with the token "
                         "stop the vehicle and set goals")


def answers(url):
    """Whether the page's server is there."""
    parts = urlsplit(url)
    host = "127.0.0.1" if parts.hostname in ("0.0.0.0", "::") else parts.hostname
    try:
        with contextlib.ExitStack() as opened:
            connection = opened.enter_context(socket.create_connection((host, parts.port), ANSWERS_S))
            if parts.scheme == "https":
                # Nothing secret is sent: whose certificate it is tells the browser.
                context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
                context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
                connection = opened.enter_context(context.wrap_socket(connection))
            connection.settimeout(ANSWERS_S)
            connection.sendall(b"HEAD / HTTP/1.0\r\nHost: localhost\r\n\r\n")
            return connection.recv(12).endswith(b" 200")
    except OSError:
        return False


def addresses(url, token, own_addresses):
    """What to type into a browser: this computer's first."""
    parts = urlsplit(url)
    hosts = own_addresses if parts.hostname in ("0.0.0.0", "::") else [parts.hostname]
    query = "?token=" + token if token else ""
    return ["%s://%s:%d/%s" % (parts.scheme, "[%s]" % host if ":" in host else host, parts.port, query)
            for host in hosts]


def own_addresses():
    listed = subprocess.run(["hostname", "-I"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
                            check=False)
    return ["127.0.0.1"] + [one for one in listed.stdout.split() if ":" not in one]


def token_of(master):
    """That of the server that runs; "" if it has none, or another user's."""
    loopback = urlsplit(master.getParam(ADDRESS)).hostname.startswith("127.")
    if loopback and not (master.hasParam(NODE + "/allow_control") and master.getParam(NODE + "/allow_control")):
        return ""
    path = "~/.ros/pi_edge/web_token"
    if master.hasParam(NODE + "/token_file"):
        path = master.getParam(NODE + "/token_file")
    try:
        return Path(path).expanduser().read_text(encoding="ascii").strip()
    except OSError as error:
        print(f"pi_edge open: the token is not readable here, {error}; ask who started the server", file=sys.stderr)
        return ""


def start(options):
    """Starts the server, which goes on when this program has ended."""
    words = ["rosrun", "pi_web", "web_view_node"]
    words += ["_address:=" + options.listen] if options.listen else []
    words += ["_port:=%d" % options.port] if options.port is not None else []
    words += ["_tls_folder:=" + str(Path(options.tls).expanduser().absolute())] if options.tls else []
    words += ["_allow_control:=" + ("true" if options.control else "false")]
    log = Path("~/.ros/pi_edge/web_view.log").expanduser()
    log.parent.mkdir(parents=True, exist_ok=True)
    with log.open("w", encoding="utf-8") as file:
        return subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=file, stderr=subprocess.STDOUT,
                                start_new_session=True), log


class Recording(http.server.SimpleHTTPRequestHandler):
    """Serves the page's folder, and one recording beside it."""

    path_of_recording = None

    def do_GET(self):
        if self.path.split("?")[0] != "/recording.bag":
            super().do_GET()
            return
        try:
            file = self.path_of_recording.open("rb")
        except OSError as error:
            self.send_error(404, str(error))
            return
        with file:
            self.send_response(200)
            self.send_header("Content-Type", "application/octet-stream")
            self.send_header("Content-Length", str(self.path_of_recording.stat().st_size))
            self.end_headers()
            shutil.copyfileobj(file, self.wfile)

    def log_message(self, *_):
        """Says nothing of each file."""


def show(recording, port):
    """Serves the page with a recording until it is interrupted. @return the exit status"""
    import rospkg
    if not recording.is_file():
        print(f"pi_edge open: {recording} is no file; pi_edge incidents lists the recordings", file=sys.stderr)
        return 1
    handler = type("Handler", (Recording,), {"path_of_recording": recording.resolve()})
    folder = rospkg.RosPack().get_path("pi_web") + "/www"
    try:
        server = http.server.ThreadingHTTPServer(("127.0.0.1", port),
                                                 lambda *given: handler(*given, directory=folder))
    except OSError as error:
        print(f"pi_edge open: port {port}: {error.strerror}; take another one with --port", file=sys.stderr)
        return 1
    print("http://127.0.0.1:%d/?play=recording.bag    Ctrl-C ends" % server.server_port, flush=True)
    with server:
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            pass
    return 0


def main(options):
    """@return the exit status"""
    if options.recording:
        return show(options.recording, options.port or 0)
    import rosgraph  # here: doctor must start where ROS is broken
    master = rosgraph.Master("/pi_edge_open")
    if not master.is_online():
        print("pi_edge open: there is no ROS master; start the vehicle: roslaunch pi_bringup vehicle.launch",
              file=sys.stderr)
        return 1
    if not (master.hasParam(ADDRESS) and answers(master.getParam(ADDRESS))):
        process, log = start(options)
        deadline = time.monotonic() + STARTS_S
        while not (master.hasParam(ADDRESS) and answers(master.getParam(ADDRESS))):
            if process.poll() is not None or time.monotonic() > deadline:
                lines = log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
                print("pi_edge open: the server does not start: %s" % (lines[-1] if lines else log), file=sys.stderr)
                return 1
            time.sleep(0.1)
        print(f"started: process {process.pid}, log {log}; rosnode kill {NODE} ends it")
    elif options.listen or options.port is not None or options.control or options.tls:
        print("the server already runs with its own options: rosnode kill %s ends it" % NODE)
    for address in addresses(master.getParam(ADDRESS), token_of(master), own_addresses()):
        print(address)
    return 0
