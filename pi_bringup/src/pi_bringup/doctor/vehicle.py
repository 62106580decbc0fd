"""Checks of the vehicle's description: the file, and what runs against it: tf of the mounts, camera_info."""

import numpy

from pi_bringup import vehicle
from pi_bringup.doctor.result import fail, ok, warn

TF_TOLERANCE_M, TF_TOLERANCE_RAD = 0.005, 0.01
BASELINE_TOLERANCE = 0.03  # of the baseline: a calibration knows better than a ruler
PAIR = ("left_optical", "right_optical")


def example():
    """The description that vehicle.launch takes without an argument."""
    import roslib.packages  # here: doctor must start where ROS is broken
    return roslib.packages.get_pkg_dir("pi_node") + "/config/vehicle.yaml"


def check_file(path):
    """@param path  "": the example."""
    name = "vehicle"
    try:
        about = vehicle.load(path or example())
    except vehicle.VehicleError as error:
        return fail(name, str(error), "correct it; config/vehicle.yaml of pi_node shows every field")
    mounts = vehicle.mounts_of(about)
    return ok(name, f"{about['name']}, {about['kind']}, {about['footprint/front'] + about['footprint/rear']:g} m x "
              f"{2.0 * about['footprint/half_width']:g} m, up to {about['limits/speed']:g} m/s, {len(mounts)} mounts")


def judge_mounts(about, poses):
    """@param poses  {frame: 4x4 in base_link}, of tf."""
    name = "vehicle mounts"
    wrong = []
    for frame, described in sorted(vehicle.mounts_of(about).items()):
        if frame not in poses:
            wrong.append(f"{frame} is not in tf")
            continue
        error = numpy.linalg.inv(numpy.array(described)) @ numpy.array(poses[frame])
        metres = numpy.linalg.norm(error[:3, 3])
        angle = numpy.arccos(numpy.clip(0.5 * (numpy.trace(error[:3, :3]) - 1.0), -1.0, 1.0))
        if metres > TF_TOLERANCE_M or angle > TF_TOLERANCE_RAD:
            wrong.append(f"{frame} is {1000 * metres:.0f} mm and {angle:.3f} rad from its place in tf")
    if wrong:
        return fail(name, "; ".join(wrong), "a driver or a static transform contradicts the description: stop one of "
                    "both")
    return ok(name, f"{', '.join(sorted(vehicle.mounts_of(about)))} as in tf")


def judge_camera_info(about, infos):
    """@param infos  {"left": (width, height, P), "right": ...}; P: 12 numbers."""
    name = "vehicle cameras"
    missing = [side for side in ("left", "right") if side not in infos]
    if missing:
        return warn(name, f"no camera_info of {' and '.join(missing)}", "start the cameras, with a calibration")
    size = int(about["pictures/width"]), int(about["pictures/height"])
    for side, (width, height, _) in infos.items():
        if (width, height) != size:
            return fail(name, f"pictures of {side} are {width}x{height}, the description says {size[0]}x{size[1]}",
                        "correct pictures in the description, or the camera's driver")
    mounts = vehicle.mounts_of(about)
    if any(frame not in mounts for frame in PAIR):
        return warn(name, f"the description has no mounts of {' and '.join(PAIR)}", "add them, to have them checked")
    projection = infos["right"][2]
    calibrated = -projection[3] / projection[0] if projection[0] else 0.0
    described = numpy.linalg.norm(numpy.subtract(*(numpy.array(mounts[frame])[:3, 3] for frame in PAIR)))
    text = f"baseline {1000 * calibrated:.1f} mm in camera_info, {1000 * described:.1f} mm in the description"
    if abs(calibrated - described) > BASELINE_TOLERANCE * described:
        return fail(name, text, "measure the mounts, or calibrate again")
    return ok(name, f"{size[0]}x{size[1]}, {text}")
