"""The scenario of a drive, as far as its runner needs it before the simulator tells the rest."""

import math
from dataclasses import dataclass
from pathlib import Path

import yaml
from first_drive.errors import DemoError

VEHICLES = {"serial": "vehicle.yaml", "twist": "differential.yaml"}  # in pi_node's config, by base


@dataclass
class EdgeNode:
    name: str
    x: float       # in the map [m]
    y: float
    range_m: float


@dataclass
class Scenario:
    path: Path
    name: str
    duration_s: float
    edge_nodes: list
    background: dict          # of the microphone: sound, level_dbfs
    vehicle: Path             # description of the vehicle that drives


def simulation_config(package):
    """pi_simulation's config: beside pi_bringup in the source tree and in the install space."""
    return package.parent / "pi_simulation" / "config"


def packaged(package):
    """Paths of all scenarios in pi_simulation's config/scenarios and its folders, by their names."""
    return sorted((simulation_config(package) / "scenarios").rglob("*.yaml"), key=lambda one: one.stem)


def find(text, package):
    """@param text  path of a file, or a name in pi_simulation's config/scenarios.
    @throws DemoError naming those that are there."""
    path = Path(text)
    if path.is_file():
        return path.resolve()
    known = {one.stem: one for one in packaged(package)}
    if text in known:
        return known[text]
    raise DemoError("--scenario %s: no such file, and none of those in %s: %s" %
                    (text, simulation_config(package) / "scenarios", ", ".join(sorted(known))))


def to_map(start, mount, point):
    """A point of the world in the map, which begins at the IMU's place and heading at the start.
    @param start  [x, y, heading] of base_link in the world. @param mount  (x, y) of the IMU in base_link."""
    cosine, sine = math.cos(start[2]), math.sin(start[2])
    x = point[0] - start[0] - cosine * mount[0] + sine * mount[1]
    y = point[1] - start[1] - sine * mount[0] - cosine * mount[1]
    return cosine * x + sine * y, cosine * y - sine * x


def load(path, package, base="serial", vehicle=None):
    """@param vehicle  file; None: the example with this base. @throws DemoError. The simulator judges the files in
    full; here only what is read counts."""
    vehicle = (vehicle or package.parent / "pi_node" / "config" / VEHICLES[base]).resolve()
    try:
        mount = yaml.safe_load(vehicle.read_text(encoding="utf-8"))["mounts"]["imu_link"]
    except (OSError, UnicodeDecodeError, yaml.YAMLError, KeyError, TypeError) as error:
        raise DemoError("--vehicle %s is no description: %r; see docs/design/vehicle_description.md" %
                        (vehicle, error)) from error
    try:
        tree = yaml.safe_load(path.read_text(encoding="utf-8"))
        nodes = [EdgeNode(one["id"], *to_map(tree["start"], mount, (one["x"], one["y"])), float(one["range"]))
                 for one in tree.get("edge_nodes") or []]
        return Scenario(path, str(tree["name"]), float(tree.get("duration", 60.0)), nodes,
                        dict(tree.get("background") or {}), vehicle)
    except (OSError, yaml.YAMLError, AttributeError, KeyError, TypeError, ValueError, IndexError) as error:
        raise DemoError("%s is no scenario: %r; see docs/design/vehicle_simulator.md" % (path, error)) from error
