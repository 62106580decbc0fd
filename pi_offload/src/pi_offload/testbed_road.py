"""The road of the test bed: where the vehicle is, and how good its radio links are there. From a scenario's file."""

import dataclasses
import math

import yaml

from pi_offload.errors import ToolError


@dataclasses.dataclass(frozen=True)
class Node:
    """An edge-cloud node."""
    id: str
    x: float         # [m]
    y: float
    range_m: float


@dataclasses.dataclass(frozen=True)
class Road:
    """A route that is driven from its first point to its last, and the nodes along it."""
    route: tuple           # of points (x, y) [m]
    speed: float           # [m/s]
    nodes: tuple           # of Node
    rate_near_mbps: float  # beside a node [Mbit/s]
    rate_edge_mbps: float  # at the edge of its range
    round_trip_s: float
    loss: float            # share of packets

    @property
    def length_m(self):
        return sum(math.dist(a, b) for a, b in zip(self.route, self.route[1:]))

    @property
    def duration_s(self):
        return self.length_m / self.speed

    def at(self, driven_m):
        """(x, y, yaw) after so many metres; the ends hold before and after. Yaw is from +X, against the clock [rad]."""
        left = max(driven_m, 0.0)
        for a, b in zip(self.route, self.route[1:]):
            length = math.dist(a, b)
            if left <= length or b == self.route[-1] and a == self.route[-2]:
                share = min(left / length, 1.0)
                return (a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]),
                        math.atan2(b[1] - a[1], b[0] - a[0]))
            left -= length
        raise AssertionError("a route has at least two points")

    def rate_mbps(self, node, x, y):
        """Of the link to a node, as in the simulator without shadowing; 0: out of range."""
        distance = math.hypot(x - node.x, y - node.y)
        if distance > node.range_m:
            return 0.0
        far = distance / node.range_m
        return self.rate_near_mbps * (self.rate_edge_mbps / self.rate_near_mbps) ** far


def _number(tree, path, least, most):
    value = tree
    for key in path.split("/"):
        value = value.get(key) if isinstance(value, dict) else None
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not least <= value <= most:
        raise ToolError(f"{path} = {value!r}, must be a number in [{least:g}, {most:g}]")
    return float(value)


def _point(value, name):
    if (not isinstance(value, list) or len(value) != 2
            or not all(isinstance(number, (int, float)) and math.isfinite(number) for number in value)):
        raise ToolError(f"{name} = {value!r}, must be a point [x, y]")
    return float(value[0]), float(value[1])


def load_road(path):
    """Reads what the test bed needs of a scenario's file, as `simulate` takes it. @throws ToolError"""
    try:
        with open(path, encoding="utf-8") as file:
            tree = yaml.safe_load(file)
    except (OSError, yaml.YAMLError, UnicodeDecodeError) as error:
        raise ToolError(f"{path}: {str(error).splitlines()[0]}") from error
    try:
        return _road(tree)
    except ToolError as error:
        raise ToolError(f"{path}: {error}") from error


def _road(tree):
    if not isinstance(tree, dict):
        raise ToolError("must be a map of keys, as config/scenarios/testbed.yaml")
    route = tree.get("route")
    if not isinstance(route, list) or len(route) < 2:
        raise ToolError("route must be a list of at least two points [x, y]")
    points = tuple(_point(point, f"route[{i}]") for i, point in enumerate(route))
    if any(a == b for a, b in zip(points, points[1:])):
        raise ToolError("route has the same point twice in a row")
    listed = tree.get("nodes")
    if not isinstance(listed, list) or not 1 <= len(listed) <= 8:
        raise ToolError("nodes must be a list of 1 to 8 nodes: each is a process here")
    nodes = []
    for i, entry in enumerate(listed):
        name = entry.get("id") if isinstance(entry, dict) else None
        if not isinstance(name, str) or not name or name in [node.id for node in nodes]:
            raise ToolError(f"nodes[{i}]/id = {name!r}, must be a name of its own")
        x, y = _point(entry.get("position"), f"nodes[{i}]/position")
        nodes.append(Node(name, x, y, _number(entry, "range_m", 1.0, 1e6)))
    return Road(points, _number(tree, "speed", 0.1, 100.0), tuple(nodes),
                _number(tree, "network/rate_near_mbps", 0.1, 1e4), _number(tree, "network/rate_edge_mbps", 0.1, 1e4),
                _number(tree, "network/round_trip_s", 0.0, 10.0), _number(tree, "network/loss", 0.0, 0.5))
