"""Makes the URDF of a vehicle from its description: base_link with body and wheels to be seen, and a fixed frame for
each sensor. Writes it to stdout; vehicle.launch makes it the parameter robot_description."""

import argparse
import math
import sys
import xml.etree.ElementTree as tree

from pi_bringup import vehicle

CAMERA_M = (0.03, 0.05, 0.04)  # along the camera's view, to its left, up
SENSOR_M = (0.04, 0.04, 0.02)
CLEARANCE_M = 0.1              # of the body above the ground
COLOURS = {"body": (0.5, 0.7, 1.0, 0.4), "wheel": (0.35, 0.35, 0.4, 1.0), "sensor": (0.9, 0.5, 0.1, 1.0)}


def _text(numbers):
    return " ".join(f"{number + 0.0:.12g}" for number in numbers)


def _visual(link, place, angles, shape, colour, **size):
    visual = tree.SubElement(link, "visual")
    tree.SubElement(visual, "origin", xyz=_text(place), rpy=_text(angles))
    tree.SubElement(tree.SubElement(visual, "geometry"), shape, **{name: _text(value) for name, value in size.items()})
    tree.SubElement(visual, "material", name=colour)


def _add_body(base, about):
    front, rear, half_width, height = (about["footprint/" + name] for name in ("front", "rear", "half_width", "height"))
    bottom = min(CLEARANCE_M, 0.5 * height)
    _visual(base, (0.5 * (front - rear), 0.0, 0.5 * (height + bottom)), (0.0, 0.0, 0.0), "box", "body",
            size=(front + rear, 2.0 * half_width, height - bottom))
    radius, width = about["wheels/radius"], about["wheels/width"]
    for axle in (0.0, about["wheelbase"]) if about["kind"] == "ackermann" else (0.0,):
        for side in (0.5, -0.5):
            _visual(base, (axle, side * about["track"], radius), (0.5 * math.pi, 0.0, 0.0), "cylinder", "wheel",
                    radius=(radius,), length=(width,))


def make(about):
    """@param about  as of vehicle.load(). @return text of the URDF"""
    robot = tree.Element("robot", name=about["name"])
    for name, rgba in COLOURS.items():
        tree.SubElement(tree.SubElement(robot, "material", name=name), "color", rgba=_text(rgba))
    _add_body(tree.SubElement(robot, "link", name="base_link"), about)
    for frame, pose in vehicle.mounts_of(about).items():
        link = tree.SubElement(robot, "link", name=frame)
        size = (CAMERA_M[1], CAMERA_M[2], CAMERA_M[0]) if frame.endswith(vehicle.OPTICAL) else SENSOR_M
        _visual(link, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), "box", "sensor", size=size)
        joint = tree.SubElement(robot, "joint", name="base_link_to_" + frame, type="fixed")
        tree.SubElement(joint, "origin", xyz=_text(row[3] for row in pose[:3]), rpy=_text(vehicle.angles_of(pose)))
        tree.SubElement(joint, "parent", link="base_link")
        tree.SubElement(joint, "child", link=frame)
    tree.indent(robot, " ")
    return '<?xml version="1.0"?>\n' + tree.tostring(robot, encoding="unicode")


def main():
    parser = argparse.ArgumentParser(prog="vehicle_urdf", description=__doc__)
    parser.add_argument("vehicle", metavar="FILE", help="as config/vehicle.yaml of pi_node")
    # rosrun and roslaunch add remappings such as __name:=x.
    options = parser.parse_args([argument for argument in sys.argv[1:] if ":=" not in argument])
    try:
        print(make(vehicle.load(options.vehicle)))
    except vehicle.VehicleError as error:
        sys.exit(f"vehicle_urdf: {error}")
