"""pi_edge doctor: checks the vehicle's computer and says what to do, a line for each check.

Exit status: 0 if no check failed, 1 if one did, 2 for a wrong command line.
"""

import argparse
import functools
import json
import os
import sys
from pathlib import Path

from pi_bringup import incidents, new_service, service, web_page
from pi_bringup.doctor import calibration, computer, devices, live, network, sensors, software, vehicle
from pi_bringup.doctor.result import FAIL, run_check, worst
from pi_bringup.fleet import commands as fleet

QUICK_S = 20.0
CHILD_S = 200.0   # those with children, which have limits of their own


def rate(text):
    """(topic, Hz) of TOPIC:HZ."""
    topic, separator, number = text.rpartition(":")
    try:
        value = float(number)
    except ValueError:
        value = 0.0
    if not separator or not topic or not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text!r}, must be TOPIC:HZ, as imu/data:200")
    return topic, value


def port(text):
    if not text.isdigit() or not 0 < int(text) < 65536:
        raise argparse.ArgumentTypeError(f"{text!r}, must be a port, 1 to 65535")
    return int(text)


def checks(options):
    """[(name, function, limit in s)]"""
    found = [
        ("python", software.check_python, CHILD_S),
        ("ROS master", software.check_master, QUICK_S),
        ("ROS host name", software.check_host_name, QUICK_S),
        ("processor", computer.check_processor, QUICK_S),
        ("load", computer.check_load, QUICK_S),
        ("temperature", computer.check_temperature, QUICK_S),
        ("supply", computer.check_supply, QUICK_S),
        ("memory", computer.check_memory, QUICK_S),
        ("shared memory", computer.check_shared_memory, QUICK_S),
        ("limits", computer.check_limits, QUICK_S),
        ("scheduling", computer.check_scheduling, QUICK_S),
        ("clock", computer.check_clock, QUICK_S),
        ("disk", computer.check_disk, QUICK_S),
        ("power sensors", computer.check_power_sensors, QUICK_S),
        ("serial ports", functools.partial(devices.check_serial_ports, port=options.serial), QUICK_S),
        ("cameras", devices.check_cameras, QUICK_S),
        ("microphones", devices.check_microphones, QUICK_S),
        ("calibration", functools.partial(calibration.check_calibration, options.calibration), QUICK_S),
        ("vehicle", functools.partial(vehicle.check_file, options.vehicle), QUICK_S),
        ("OpenCL", software.check_opencl, CHILD_S),
        ("detector model", functools.partial(software.check_detector, options.detector_model), CHILD_S),
        ("speech model", functools.partial(software.check_speech, options.speech_model), CHILD_S),
        ("π-OS", software.check_transport, CHILD_S),
        ("bridge port", functools.partial(network.check_port, options.bridge_port), QUICK_S),
    ]
    found += [(f"edge node {address}", functools.partial(network.check_node, address, options.health_port), QUICK_S)
              for address in options.node]
    if options.sensors:
        found.append(("cameras and IMU", sensors.check_sensors, CHILD_S))
    if options.live:
        expected = dict(options.topic) if options.topic else None
        found.append(("live graph", functools.partial(live.check_live, expected), CHILD_S))
    return found


def parse(arguments):
    parser = argparse.ArgumentParser(prog="pi_edge", description="Drives a demo; looks after the vehicle's computer "
                                     "and recordings; begins new services; starts the vehicle with the computer; "
                                     "shows it in a browser; makes a fleet's keys.")
    commands = parser.add_subparsers(dest="command", required=True)
    doctor = commands.add_parser("doctor", help="checks sensors, clocks, rights, models, network, and says what to do",
                                 description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    doctor.add_argument("--calibration", default="", metavar="FILE",
                        help="Kalibr's camchain, camera_info, or the folder of a EuRoC recording")
    doctor.add_argument("--vehicle", default="", metavar="FILE", help="its description; default: the example")
    doctor.add_argument("--serial", default="", metavar="PORT", help="of the chassis, as /dev/ttyUSB0")
    doctor.add_argument("--detector-model", default="", metavar="NETWORK",
                        help="name of a network of pi_detect, or its description; default: that of the nodes")
    doctor.add_argument("--speech-model", default="", metavar="FOLDER", help="default: %s" % software.SPEECH_MODEL)
    doctor.add_argument("--bridge-port", type=port, default=network.BRIDGE_PORT, help="default: %(default)s")
    doctor.add_argument("--node", action="append", default=[], metavar="HOST:PORT", help="edge node; may be repeated")
    doctor.add_argument("--health-port", type=port, help="of the edge nodes; default: the one behind their own")
    doctor.add_argument("--sensors", action="store_true", help="also cameras and IMU of the graph that runs: rates, "
                        "stamps, gaps, camera_info, time between left and right, what the IMU measures")
    doctor.add_argument("--live", action="store_true", help="also the graph that runs: rates, stamps, tf, diagnostics, "
                        "its vehicle")
    doctor.add_argument("--topic", action="append", type=rate, metavar="TOPIC:HZ", help="of --live, in place of the "
                        "vehicle's sensors; may be repeated")
    doctor.add_argument("--only", action="append", metavar="NAME", help="checks whose name holds this; may be repeated")
    doctor.add_argument("--json", action="store_true", help="a JSON object in place of lines")
    new = commands.add_parser("new", help="begins a package").add_subparsers(dest="what", required=True)
    package = new.add_parser("service", help="a working package outside the suite, which vehicle.launch can start",
                             description=new_service.__doc__)
    package.add_argument("name", metavar="NAME", help="of the package, as lane_keeper")
    package.add_argument("--folder", default=".", metavar="DIR", help="gets the folder NAME; default: here")
    commands.add_parser("demo", add_help=False, help="drives a simulated vehicle from A to B over π-OS and over TCPROS, "
                        "with a report; demo --help lists its options")
    incidents.add_to(commands)
    service.add_to(commands)
    fleet.add_to(commands)
    web_page.add_to(commands)
    # rosrun and roslaunch add remappings such as __name:=x.
    words = [argument for argument in arguments if not argument.startswith("__")]
    options, rest = parser.parse_known_args(words)
    if options.command == "demo":
        options.arguments = words[1:]
    elif rest:
        parser.error("unrecognized arguments: %s" % " ".join(rest))
    options.parser = doctor
    return options


def doctor(options, say):
    """@return results"""
    chosen = [entry for entry in checks(options)
              if not options.only or any(part.lower() in entry[0].lower() for part in options.only)]
    if not chosen:
        options.parser.error("--only %s: no check has this in its name" % ", ".join(options.only))
    results = []
    for name, function, limit_s in chosen:
        for result in run_check(name, function, limit_s):
            results.append(result)
            say(result)
    return results


def find_package():
    """The folder of pi_bringup."""
    import roslib.packages  # here: doctor must start where ROS is broken
    return roslib.packages.get_pkg_dir("pi_bringup")


def drive_demo_in_campus(arguments):
    """Becomes "drive_campus --demo", which lies beside this program."""
    program = str(Path(sys.argv[0]).resolve().with_name("drive_campus"))
    os.execv(program, [program, "--demo", *arguments])


def main():
    options = parse(sys.argv[1:])
    if options.command == "demo":
        drive_demo_in_campus(options.arguments)
    sys.stdout.reconfigure(line_buffering=True, errors="replace")
    if options.command == "new":
        leave(new_service.main(options, find_package()))
    if options.command == "incidents":
        leave(incidents.main(options))
    if options.command == "open":
        leave(web_page.main(options))
    if options.command == "fleet":
        leave(fleet.main(options))
    if options.command.endswith("-service"):
        leave(service.main(options))
    try:
        results = doctor(options, lambda result: None if options.json else print(result.line()))
    except KeyboardInterrupt:
        print("pi_edge: interrupted", file=sys.stderr)
        leave(130)
    counts = {level: sum(result.level == level for result in results) for level in ("OK", "WARN", "FAIL")}
    if options.json:
        print(json.dumps({"level": worst(results), "counts": counts, "checks": [r.as_dict() for r in results]},
                         indent=1, ensure_ascii=False))
    else:
        print(f"{counts['OK']} OK, {counts['WARN']} WARN, {counts['FAIL']} FAIL")
    leave(1 if worst(results) == FAIL else 0)


def leave(status):
    """Ends at once: a check that hangs has a thread that would be waited for."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)
