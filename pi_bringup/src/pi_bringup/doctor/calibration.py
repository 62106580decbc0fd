"""Check of a calibration: Kalibr's camchain, camera_info of ROS, or a EuRoC recording's sensors. Plausible: finite
numbers, focal length and centre that fit the picture, rotations that are ones, cameras 2 cm to 1 m apart."""

from pathlib import Path

import numpy
import yaml

from pi_bringup.doctor.result import fail, ok, warn

LEAST_BASELINE_M, MOST_BASELINE_M = 0.02, 1.0
ROTATION_TOLERANCE = 1e-3
LEAST_FOCAL, MOST_FOCAL = 0.2, 5.0  # of the picture's width


class Implausible(Exception):
    """What is wrong, with value and bound."""


def _numbers(values, count, what):
    try:
        array = numpy.array(values, dtype=float).reshape(-1)
    except (TypeError, ValueError):
        raise Implausible(f"{what} = {values!r}, must be {count} numbers") from None
    if array.size != count or not numpy.isfinite(array).all():
        raise Implausible(f"{what} has {array.size} numbers, must be {count} finite ones")
    return array


def check_intrinsics(intrinsics, resolution, camera):
    """@param intrinsics  fx, fy, cx, cy [px]"""
    width, height = _numbers(resolution, 2, f"{camera}: resolution")
    fx, fy, cx, cy = _numbers(intrinsics, 4, f"{camera}: intrinsics")
    if width < 16 or height < 16:
        raise Implausible(f"{camera}: resolution = {width:.0f}x{height:.0f}, must be at least 16x16")
    for focal, label in ((fx, "fx"), (fy, "fy")):
        if not LEAST_FOCAL * width <= focal <= MOST_FOCAL * width:
            raise Implausible(f"{camera}: {label} = {focal:g}, must be in [{LEAST_FOCAL * width:g}, "
                              f"{MOST_FOCAL * width:g}] px for this width")
    if not 0.8 <= fx / fy <= 1.25:
        raise Implausible(f"{camera}: fx / fy = {fx / fy:.2f}, must be in [0.8, 1.25]")
    if not (0.25 * width <= cx <= 0.75 * width and 0.25 * height <= cy <= 0.75 * height):
        raise Implausible(f"{camera}: centre = ({cx:g}, {cy:g}), must be in the middle half of the picture")


def check_transform(values, what):
    """A 4x4 of a rotation and a translation. @return it"""
    matrix = _numbers(values, 16, what).reshape(4, 4)
    rotation = matrix[:3, :3]
    error = numpy.abs(rotation.T @ rotation - numpy.eye(3)).max()
    if error > ROTATION_TOLERANCE:
        raise Implausible(f"{what}: its rotation is off orthonormal by {error:.2g}, must be {ROTATION_TOLERANCE:g} at "
                          "most")
    if numpy.linalg.det(rotation) < 0.0:
        raise Implausible(f"{what}: its rotation mirrors")
    if numpy.abs(matrix[3] - [0.0, 0.0, 0.0, 1.0]).max() > 1e-9:
        raise Implausible(f"{what}: its last row is {matrix[3].tolist()}, must be [0, 0, 0, 1]")
    return matrix


def check_baseline(metres):
    if not LEAST_BASELINE_M <= metres <= MOST_BASELINE_M:
        raise Implausible(f"baseline = {metres:.4f} m, must be in [{LEAST_BASELINE_M}, {MOST_BASELINE_M}] m")


def load(path):
    text = Path(path).read_text(encoding="utf-8")
    if text.startswith("%YAML:"):  # as OpenCV writes it
        text = text.partition("\n")[2]
    tree = yaml.safe_load(text)
    if not isinstance(tree, dict):
        raise Implausible(f"{path} holds no map")
    return tree


def check_kalibr(tree):
    """@return what it is, in words"""
    cameras = sorted(key for key in tree if key.startswith("cam") and isinstance(tree[key], dict))
    parts = [f"{len(cameras)} camera(s)"]
    for camera in cameras:
        check_intrinsics(tree[camera].get("intrinsics"), tree[camera].get("resolution"), camera)
        if "T_cam_imu" in tree[camera]:
            check_transform(tree[camera]["T_cam_imu"], f"{camera}: T_cam_imu")
    for camera in cameras[1:]:
        baseline = numpy.linalg.norm(check_transform(tree[camera].get("T_cn_cnm1"), f"{camera}: T_cn_cnm1")[:3, 3])
        check_baseline(baseline)
        parts.append(f"baseline {1000 * baseline:.0f} mm")
    return "Kalibr, " + ", ".join(parts)


def check_camera_info(tree):
    def data(key):
        entry = tree.get(key)
        return entry.get("data") if isinstance(entry, dict) else entry

    k = _numbers(data("camera_matrix"), 9, "camera_matrix")
    check_intrinsics([k[0], k[4], k[2], k[5]], [tree.get("image_width"), tree.get("image_height")], "camera_matrix")
    rectification = _numbers(data("rectification_matrix"), 9, "rectification_matrix").reshape(3, 3)
    matrix = numpy.eye(4)
    matrix[:3, :3] = rectification
    check_transform(matrix, "rectification_matrix")
    p = _numbers(data("projection_matrix"), 12, "projection_matrix")
    if p[0] <= 0.0:
        raise Implausible(f"projection_matrix: focal length = {p[0]:g}, must be positive")
    if p[3] == 0.0:
        return "camera_info of one camera or a left one"
    check_baseline(-p[3] / p[0])
    return f"camera_info of a right camera, baseline {-1000 * p[3] / p[0]:.0f} mm"


def check_euroc(folder):
    transforms = []
    for camera in ("cam0", "cam1"):
        file = Path(folder) / camera / "sensor.yaml"
        if not file.is_file():
            continue
        tree = load(file)
        check_intrinsics(tree.get("intrinsics"), tree.get("resolution"), camera)
        pose = tree.get("T_BS")
        transforms.append(check_transform(pose.get("data") if isinstance(pose, dict) else pose, f"{camera}: T_BS"))
    if not transforms:
        raise Implausible(f"{folder} holds no cam0/sensor.yaml")
    if len(transforms) == 1:
        return "EuRoC, one camera"
    baseline = numpy.linalg.norm((numpy.linalg.inv(transforms[0]) @ transforms[1])[:3, 3])
    check_baseline(baseline)
    return f"EuRoC, two cameras, baseline {1000 * baseline:.0f} mm"


def check_calibration(path):
    """@param path  file, or folder of a EuRoC recording; "": none was given"""
    name = "calibration"
    advice = "calibrate again, or look whether it is the file of this vehicle"
    if not path:
        return warn(name, "no file was given", "name it with --calibration to have it checked")
    path = Path(path)
    try:
        if path.is_dir():
            return ok(name, check_euroc(path / "mav0" if (path / "mav0").is_dir() else path))
        tree = load(path)
        if any(key.startswith("cam") and key[3:].isdigit() for key in map(str, tree)):
            return ok(name, check_kalibr(tree))
        if "camera_matrix" in tree:
            return ok(name, check_camera_info(tree))
        return fail(name, f"{path} is none of Kalibr's camchain, camera_info and a EuRoC folder", "name another file")
    except Implausible as error:
        return fail(name, str(error), advice)
    except (OSError, UnicodeDecodeError) as error:
        return fail(name, f"{path} cannot be read: {error}", "name a file that is there")
    except yaml.YAMLError as error:
        return fail(name, f"{path} is no YAML: {str(error).splitlines()[0]}", advice)
