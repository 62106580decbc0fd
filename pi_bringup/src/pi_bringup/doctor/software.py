"""Checks of what is installed: ROS, OpenCL, models, π-OS."""

import importlib.util
import json
import os
import socket
import sys
import xmlrpc.client
from pathlib import Path
from urllib.parse import urlsplit

from pi_bringup.doctor import children
from pi_bringup.doctor.result import fail, ok, warn

MASTER_S = 3.0
OPENCL_S = 90.0      # a first compilation on a loaded computer
MODEL_S = 90.0
PRELOAD_S = 15.0
SPEECH_MODEL = "/usr/share/pocketsphinx/model/en-us/en-us"
TRANSPORT = "libpi_os_transport.so"


# ------------------------------------------------------------------------------------------------------------------ ROS

class _Timed(xmlrpc.client.Transport):
    def make_connection(self, host):
        connection = super().make_connection(host)
        connection.timeout = MASTER_S
        return connection


def ask_master(uri):
    """Process id of the master, or what is wrong as text."""
    try:
        code, _, pid = xmlrpc.client.ServerProxy(uri, transport=_Timed()).getPid("/pi_edge_doctor")
        return pid if code == 1 else "refuses to answer"
    except (OSError, ValueError, TypeError, xmlrpc.client.Error) as error:
        return str(error)


def check_master(environment=None):
    name = "ROS master"
    environment = os.environ if environment is None else environment
    uri = environment.get("ROS_MASTER_URI", "")
    if not uri:
        return fail(name, "ROS_MASTER_URI is not set", "source setup.sh of the install space")
    parts = urlsplit(uri)
    if parts.scheme != "http" or not parts.hostname:
        return fail(name, f"ROS_MASTER_URI={uri} is no address", "export ROS_MASTER_URI=http://HOST:11311")
    answer = ask_master(uri)
    if isinstance(answer, int):
        return ok(name, f"answers at {uri}")
    return warn(name, f"does not answer at {uri} ({answer})", "roscore or roslaunch starts it; nothing is wrong before")


def check_host_name(environment=None):
    """What other nodes are told to connect to."""
    name = "ROS host name"
    environment = os.environ if environment is None else environment
    variable = next((key for key in ("ROS_HOSTNAME", "ROS_IP") if environment.get(key)), None)
    host = environment[variable] if variable else socket.gethostname()
    shown = f"{variable}={host}" if variable else f"host name {host}"
    try:
        address = socket.getaddrinfo(host, None, family=socket.AF_INET, type=socket.SOCK_STREAM)[0][4][0]
    except OSError as error:
        return fail(name, f"{shown} cannot be resolved ({error})",
                    "export ROS_HOSTNAME=localhost for one computer, or ROS_IP to the vehicle's address")
    with socket.socket() as own:
        try:
            own.bind((address, 0))
        except OSError:
            return fail(name, f"{shown} is {address}, which is not this computer",
                        "export ROS_IP to an address of this computer; ip addr shows them")
    master = urlsplit(environment.get("ROS_MASTER_URI", "")).hostname
    if address.startswith("127.") and master not in (None, "localhost", "127.0.0.1", host):
        return warn(name, f"{shown} is {address}, but the master is at {master}",
                    "other computers cannot reach nodes here: export ROS_IP to this computer's address")
    return ok(name, f"{shown} is {address}")


def check_python(executable=sys.executable, version=sys.version_info):
    name = "python"
    text = f"{executable}, {version[0]}.{version[1]}"
    first = children.run(["python3", "-c", "import sys; print(sys.executable)"], PRELOAD_S)
    missing = [module for module in ("rospy", "tf2_msgs", "yaml", "numpy") if not importlib.util.find_spec(module)]
    if missing:
        return fail(name, f"{text}, without {', '.join(missing)}",
                    "use Debian's /usr/bin/python3, and run \"make\" once to install what is missing")
    if not executable.startswith("/usr/bin/"):
        return warn(name, text, "ROS is installed for Debian's /usr/bin/python3")
    if first.good and not first.last_line().startswith("/usr/bin/"):
        return warn(name, f"{text}; but python3 in PATH is {first.last_line()}", "export PATH=/usr/bin:$PATH")
    return ok(name, text)


# --------------------------------------------------------------------------------------------------------------- OpenCL

def check_opencl(probe=None):
    """@param probe  as children.run() gives it for opencl_probe.py"""
    name = "OpenCL"
    ended = probe or children.run([sys.executable, Path(__file__).with_name("opencl_probe.py")], OPENCL_S)
    try:
        devices = json.loads(ended.last_line()) if ended.good else None
    except ValueError:
        devices = None
    if devices is None:
        return fail(name, ended.why(), "apt-get install ocl-icd-libopencl1 pocl-opencl-icd")
    if not devices:
        return fail(name, "there is no device", "apt-get install pocl-opencl-icd, or the driver of the GPU")
    broken = [f"{entry['device']}: {entry['problem']}" for entry in devices if not entry["works"]]
    works = [entry for entry in devices if entry["works"]]
    shown = ", ".join(f"{entry['device']} ({entry['platform']})" for entry in works)
    if not works:
        return fail(name, "no device runs a kernel: " + "; ".join(broken), "look at the driver; clinfo shows more")
    if broken:
        return warn(name, f"{shown}; not {'; '.join(broken)}", "look at the driver, or do not use that device")
    return ok(name, f"a kernel ran on {shown}")


# --------------------------------------------------------------------------------------------------------------- models

def package_folder(package):
    """None where the package is not found."""
    try:
        import rospkg  # with the rest of ROS, whose absence check_python tells
        return Path(rospkg.RosPack().get_path(package))
    except Exception:  # pylint: disable=broad-except
        return None


def find_program(package, program):
    try:
        from roslib.packages import find_node
        found = [path for path in find_node(package, program) if os.access(path, os.X_OK)]
        return found[0] if found else None
    except Exception:  # pylint: disable=broad-except
        return None


def check_detector(model="", program=None):
    """@param model  name of a network of pi_detect, or path of its description; "": that which the nodes take"""
    name = "detector model"
    program = program or find_program("pi_detect", "check_model")
    if program is None:
        return fail(name, "pi_detect has no program check_model",
                    "source setup.sh of the install space, or build it")
    ended = children.run([program, *([model] if model else [])], MODEL_S)
    if not ended.good:
        return fail(name, f"{model or 'the default'} cannot be loaded: {ended.why()}",
                    "fetch it again (rosrun pi_detect fetch_models), install pi_detect anew, or choose another model")
    notice = next((line for line in ended.output.splitlines() if " stands in for " in line), "")
    if notice:
        text, _, remedy = notice.partition(": ")
        return warn(name, text, remedy)
    return ok(name, f"{ended.last_line()}, loaded")


def check_speech(model="", program=None):
    name = "speech model"
    model = model or SPEECH_MODEL
    if not Path(model).is_dir():
        return fail(name, f"{model} is missing", "apt-get install pocketsphinx-en-us")
    program = program or find_program("pi_speech", "check_speech_model")
    if program is None:
        return fail(name, "pi_speech has no program check_speech_model",
                    "source setup.sh of the install space, or build it")
    grammar = "stop S T AA P\n\n#JSGF V1.0;\ngrammar commands;\npublic <command> = stop;\n"
    ended = children.run([program, model], MODEL_S, text=grammar)
    if not ended.good:
        return fail(name, f"{model} cannot be loaded: {ended.why()}", "apt-get install --reinstall pocketsphinx-en-us")
    return ok(name, f"{model}, loaded")


# ----------------------------------------------------------------------------------------------------------------- π-OS

def find_transport(environment=None):
    environment = os.environ if environment is None else environment
    folders = [f"{prefix}/lib" for prefix in environment.get("CMAKE_PREFIX_PATH", "").split(":") if prefix]
    folders += [folder for folder in environment.get("LD_LIBRARY_PATH", "").split(":") if folder]
    return next((Path(folder) / TRANSPORT for folder in folders if (Path(folder) / TRANSPORT).is_file()), None)


def check_transport(library=None):
    """That a program starts with the library, and has it."""
    name = "π-OS"
    library = library or find_transport()
    if library is None:
        return fail(name, f"{TRANSPORT} is not found",
                    "build and install pi_os_transport, and source setup.sh of that space")
    ended = children.run(["/bin/cat", "/proc/self/maps"], PRELOAD_S, {"LD_PRELOAD": str(library)})
    if not ended.good or "cannot be preloaded" in ended.output:
        said = next((line for line in ended.output.splitlines() if "preload" in line), ended.why())
        return fail(name, f"{library} cannot be preloaded: {said}", "build pi_os_transport anew on this computer")
    if str(library.resolve()) not in ended.output and str(library) not in ended.output:
        return fail(name, f"{library} was not loaded", "set-user-id programs and static ones ignore LD_PRELOAD")
    tool = find_program("pi_os_transport", "pi_os")
    bridge = children.run([tool, "status"], PRELOAD_S) if tool else None
    state = "a bridge runs" if bridge and bridge.good else "no bridge runs, which one computer does not need"
    return ok(name, f"{library} is preloaded; {state}")
