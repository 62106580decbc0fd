"""The description of the vehicle, as pi_node/config/vehicle.yaml shows it. The nodes judge it in the same words:
pi_node/src/vehicle_description.cpp; a test compares both."""

import math
import re
from pathlib import Path

import yaml

KINDS = ("ackermann", "differential")
OPTICAL = "_optical"  # ends the frame of a camera
ANGLES = ("roll", "pitch", "yaw")
POSE = ("x", "y", "z", *ANGLES)


class VehicleError(Exception):
    """What is wrong, with value and bound."""


def _number(name, value):
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise VehicleError(f"{name} = {value}, must be a number")
    return float(value)


def _within(name, value, least, most, source=""):
    if not least <= value <= most:
        raise VehicleError(f"{name} = {value:g}, must be in [{least:g}, {most:g}]" + (f" ({source})" if source else ""))


# In the order in which they are judged: least, most.
RANGES = {
    "footprint/front": (0.05, 10.0), "footprint/rear": (0.05, 10.0), "footprint/half_width": (0.05, 5.0),
    "footprint/height": (0.1, 5.0),
    "limits/speed": (0.1, 10.0), "limits/reverse_speed": (0.0, 10.0), "limits/acceleration": (0.05, 10.0),
    "limits/deceleration": (0.1, 10.0), "limits/emergency_deceleration": (0.0, 20.0), "limits/curvature": (0.01, 3.0),
    "limits/curvature_rate": (0.01, 1000.0), "limits/lateral_acceleration": (0.05, 20.0),
    "wheelbase": (0.0, 10.0), "track": (0.05, 10.0), "wheels/radius": (0.01, 1.0), "wheels/width": (0.005, 1.0),
    "pictures/width": (64, 4096), "pictures/height": (64, 4096)}


def _leaves(tree, path=""):
    for name, value in tree.items():
        if isinstance(value, dict):
            yield from _leaves(value, f"{path}{name}/")
        else:
            yield f"{path}{name}", value


def check(tree):
    """@param tree  of the file. @return it, flat: {path: value}, a mount as six numbers. @throws VehicleError"""
    if not isinstance(tree, dict):
        raise VehicleError("must be a map as in config/vehicle.yaml of pi_node")
    leaves = dict(_leaves(tree))
    mounts = sorted(path for path in leaves if re.fullmatch("mounts/[^/]+", path))
    for path in ("name", "kind", *RANGES):
        if path not in leaves:
            raise VehicleError(f"{path} is missing")
    for path, value in leaves.items():
        if path in RANGES:
            leaves[path] = _number(path, value)
            if path.startswith("pictures/") and not isinstance(value, int):
                raise VehicleError(f"{path} = {value}, must be a whole number")
        elif path in mounts:
            if not isinstance(value, list) or len(value) != len(POSE):
                raise VehicleError(f"{path} = {value}, must be [{', '.join(POSE)}]")
            leaves[path] = [_number(path, number) for number in value]
        elif path not in ("name", "kind"):
            raise VehicleError(f"{path} means nothing here")
    for path in ("name", "kind"):
        if not isinstance(leaves[path], str):
            raise VehicleError(f"{path} = {leaves[path]}, must be a text")
    if leaves["kind"] not in KINDS:
        raise VehicleError(f"kind = \"{leaves['kind']}\", must be {' or '.join(KINDS)}")
    if not re.fullmatch("[A-Za-z0-9_]+", leaves["name"]):
        raise VehicleError(f"name = \"{leaves['name']}\", must be letters, digits and underscores")
    least = {"limits/emergency_deceleration": (leaves["limits/deceleration"], "limits/deceleration")}
    most = {"track": (2.0 * leaves["footprint/half_width"], "twice footprint/half_width"),
            "wheelbase": (leaves["footprint/front"], "footprint/front")}
    if leaves["kind"] == "ackermann":
        least["wheelbase"] = (0.05, "footprint/front")
    else:
        most["wheelbase"] = (0.0, "kind is differential")
    for path, (low, high) in RANGES.items():
        low, from_low = least.get(path, (low, ""))
        high, from_high = most.get(path, (high, ""))
        _within(path, leaves[path], low, high, from_high or from_low)
    for path in mounts:
        for name, number in zip(POSE, leaves[path]):
            bound = math.pi if name in ANGLES else 10.0
            _within(f"{path}/{name}", number, -bound, bound)
    return leaves


def load(path):
    """@return as check(). @throws VehicleError that names the file."""
    try:
        return check(yaml.safe_load(Path(path).read_text(encoding="utf-8")))
    except VehicleError as error:
        raise VehicleError(f"{path}: {error}") from error
    except (OSError, UnicodeDecodeError) as error:
        raise VehicleError(f"{path} cannot be read: {error}") from error
    except yaml.YAMLError as error:
        raise VehicleError(f"{path} is no YAML: {' '.join(str(error).split())}") from error


def mounts_of(vehicle):
    """@return {frame: 4x4 pose in base_link, of a camera that of its optical frame}"""
    return {path.partition("/")[2]: _pose(path, numbers)
            for path, numbers in vehicle.items() if path.startswith("mounts/")}


def _turned(roll, pitch, yaw):
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(angle), math.sin(angle)) for angle in (roll, pitch, yaw))
    return [[cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr]]


def _pose(path, numbers):
    rotation = _turned(*numbers[3:])
    if path.endswith(OPTICAL):  # z forward, x right, y down
        rotation = [[-row[1], -row[2], row[0]] for row in rotation]
    return [[*row, number] for row, number in zip(rotation, numbers)] + [[0.0, 0.0, 0.0, 1.0]]


def angles_of(pose):
    """@return roll, pitch, yaw of a rotation [rad]"""
    pitch = math.atan2(-pose[2][0], math.hypot(pose[0][0], pose[1][0]))
    if abs(math.cos(pitch)) < 1e-6:  # roll and yaw turn about one axis
        return math.atan2(-pose[1][2], pose[1][1]), pitch, 0.0
    return math.atan2(pose[2][1], pose[2][2]), pitch, math.atan2(pose[1][0], pose[0][0])
