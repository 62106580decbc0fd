"""Reads recordings in the folder layout of the EuRoC MAV data set (Burri et al., IJRR 2016), without the pictures."""

import math
from collections import namedtuple
from pathlib import Path

import numpy
import yaml


class RecordingError(Exception):
    """A recording or bag that cannot be used: object, value and the way out."""


# T_body_sensor and every other transform are 4x4 matrices. Lengths are in metres, times in nanoseconds.
Camera = namedtuple("Camera", "width height rate_hz intrinsics distortion T_body_sensor images")
Imu = namedtuple("Imu", "rate_hz gyroscope_noise accelerometer_noise T_body_sensor samples")
Recording = namedtuple("Recording", "folder left right imu ground_truth")


def matrix_of(quaternion, translation=(0.0, 0.0, 0.0)):
    """4x4 transform. @param quaternion  x, y, z, w"""
    x, y, z, w = numpy.asarray(quaternion) / numpy.linalg.norm(quaternion)
    T = numpy.eye(4)
    T[:3, :3] = [[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                 [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                 [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]
    T[:3, 3] = translation
    return T


def quaternion_of(T):
    """x, y, z, w of the rotation of a transform (Shepperd's method: the largest component first)."""
    R = T[:3, :3]
    if numpy.trace(R) > 0.0:
        w = 0.5 * math.sqrt(1.0 + numpy.trace(R))
        return numpy.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], 4 * w * w]) / (4 * w)
    i = int(numpy.argmax(numpy.diag(R)))
    j, k = (i + 1) % 3, (i + 2) % 3
    root = math.sqrt(1.0 + R[i, i] - R[j, j] - R[k, k])
    q = numpy.zeros(4)
    q[i], q[3] = 0.5 * root, 0.5 * (R[k, j] - R[j, k]) / root
    q[j], q[k] = 0.5 * (R[j, i] + R[i, j]) / root, 0.5 * (R[k, i] + R[i, k]) / root
    return q


class Row:
    """One line of a table, with what an error has to name."""

    def __init__(self, path, line, cells):
        self.path, self.line, self.cells = path, line, cells

    def error(self, defect):
        return RecordingError("%s:%d: %s; repair the line or copy the recording again" % (self.path, self.line, defect))

    def _bad(self, column, expected):
        return self.error('column %d is "%s", expected %s' % (column + 1, self.cells[column], expected))

    def numbers(self, first, count):
        values = []
        for column in range(first, first + count):
            try:
                values.append(float(self.cells[column]))
            except ValueError:
                raise self._bad(column, "a finite number") from None
            if not math.isfinite(values[-1]):
                raise self._bad(column, "a finite number")
        return values

    def nanoseconds(self, column=0):
        cell = self.cells[column]
        if not (cell.isascii() and cell.isdigit() and 0 < int(cell) < 2 ** 32 * 10 ** 9):
            raise self._bad(column, "a time stamp [ns]")
        return int(cell)

    def seconds_as_nanoseconds(self, column=0):
        """Without a float, which keeps only 0.2 us at today's dates."""
        whole, _, fraction = self.cells[column].partition(".")
        if not (whole + fraction).isascii() or not whole.isdigit() or len(whole) > 10 \
                or not (fraction + "0").isdigit() or int(whole) >= 2 ** 32:
            raise self._bad(column, "a time stamp [s]")
        return int(whole) * 10 ** 9 + int(fraction[:9].ljust(9, "0"))


def read_text(path, purpose):
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise RecordingError("%s: missing or not readable (%s); %s" % (path, error.strerror, purpose)) from None


def read_table(path, separator, columns, entry):
    """[entry(row)] of each line that is neither empty nor a comment; the stamp, entry(row)[0], must increase."""
    entries = []
    for line, text in enumerate(read_text(path, "an EuRoC recording needs it").splitlines(), 1):
        text = text.strip()
        if not text or text.startswith("#"):
            continue
        row = Row(path, line, [cell.strip() for cell in text.split(separator)])
        if len(row.cells) < columns:
            raise row.error('has %d of %d columns: "%s"' % (len(row.cells), columns, text[:80]))
        entries.append(entry(row))
        if len(entries) > 1 and entries[-1][0] <= entries[-2][0]:
            raise row.error("stamp %d does not come after the previous one, %d" % (entries[-1][0], entries[-2][0]))
    return entries


class SensorYaml:
    """sensor.yaml, with errors that name the file and the key."""

    def __init__(self, path):
        self.path = path
        # The directive of OpenCV is no YAML, and the original files do not have it.
        lines = [line for line in read_text(path, "it holds the calibration of the sensor").splitlines()
                 if not line.startswith("%")]
        try:
            self.values = yaml.safe_load("\n".join(lines))
        except yaml.YAMLError as error:
            raise self.error("not readable as YAML: %s" % " ".join(str(error).split())) from None
        if not isinstance(self.values, dict):
            raise self.error("holds no keys")

    def error(self, defect):
        return RecordingError("%s: %s; take the file of the original recording" % (self.path, defect))

    def number(self, key, fallback=None):
        value = self.values.get(key, fallback)
        try:
            return float(value)
        except (TypeError, ValueError):
            raise self.error("%s must be a number" % key) from None

    def numbers(self, key, count):
        value = self.values
        for part in key.split("/"):
            value = value.get(part) if isinstance(value, dict) else None
        try:
            numbers = [float(number) for number in value]
        except (TypeError, ValueError):
            numbers = []
        if len(numbers) != count:
            raise self.error("%s must be a list of %d numbers" % (key, count))
        return numbers

    def expect(self, key, value):
        if self.values.get(key) != value:
            raise self.error('%s is "%s", only "%s" is supported' % (key, self.values.get(key), value))

    def transform(self, key):
        T = numpy.array(self.numbers(key + "/data", 16)).reshape(4, 4)
        R = T[:3, :3]
        # Files carry about ten digits.
        if not (numpy.linalg.norm(R @ R.T - numpy.eye(3)) < 1e-4 and numpy.linalg.det(R) > 0.0
                and numpy.linalg.norm(T[3] - [0, 0, 0, 1]) < 1e-9):
            raise self.error("%s is not a rigid transform" % key)
        return matrix_of(quaternion_of(T), T[:3, 3])


def load_camera(folder):
    sensor = SensorYaml(folder / "sensor.yaml")
    sensor.expect("camera_model", "pinhole")
    sensor.expect("distortion_model", "radial-tangential")
    width, height = (int(number) for number in sensor.numbers("resolution", 2))
    rate_hz = sensor.number("rate_hz")
    if width <= 0 or height <= 0 or not 0.0 < rate_hz < math.inf:
        raise sensor.error("resolution and rate_hz must be above 0")

    def image(row):
        picture = folder / "data" / row.cells[1]
        if not row.cells[1] or not picture.is_file():
            raise row.error("names the picture %s, which does not exist" % picture)
        return row.nanoseconds(), picture

    images = read_table(folder / "data.csv", ",", 2, image)
    if not images:
        raise RecordingError("%s: names no picture; copy the recording again" % (folder / "data.csv"))
    return Camera(width, height, rate_hz, sensor.numbers("intrinsics", 4),
                  sensor.numbers("distortion_coefficients", 4), sensor.transform("T_BS"), images)


def load_imu(folder):
    sensor = SensorYaml(folder / "sensor.yaml")
    samples = read_table(folder / "data.csv", ",", 7, lambda row: (row.nanoseconds(), *row.numbers(1, 6)))
    if not samples:
        raise RecordingError("%s: has no sample; copy the recording again" % (folder / "data.csv"))
    return Imu(sensor.number("rate_hz"), sensor.number("gyroscope_noise_density", 0.0),
               sensor.number("accelerometer_noise_density", 0.0), sensor.transform("T_BS"), samples)


def load_ground_truth(folder):
    """[(stamp, T_world_body, velocity in the world or None)]; the world's z points up."""
    def pose(row, stamp, position, quaternion, velocity=None):
        if abs(numpy.linalg.norm(quaternion) - 1.0) > 1e-2:
            raise row.error("quaternion has norm %f, expected 1" % numpy.linalg.norm(quaternion))
        return stamp, matrix_of(quaternion, position), velocity

    def of_csv(row):
        w, x, y, z = row.numbers(4, 4)
        return pose(row, row.nanoseconds(), row.numbers(1, 3), (x, y, z, w), row.numbers(8, 3))

    csv, tum = folder / "mav0/state_groundtruth_estimate0/data.csv", folder / "groundtruth_tum.txt"
    if csv.exists():
        return read_table(csv, ",", 11, of_csv)
    if tum.exists():
        return read_table(tum, None, 8, lambda row: pose(row, row.seconds_as_nanoseconds(), row.numbers(1, 3),
                                                         row.numbers(4, 4)))
    return []


def load(folder):
    """Reads everything but the pictures, whose files must exist. Right camera, IMU and ground truth may be missing.
    @param folder  the one that contains mav0. @throws RecordingError"""
    mav = Path(folder) / "mav0"
    if not (mav / "cam0").is_dir():
        raise RecordingError('%s: no such folder; "%s" must be an EuRoC recording, the folder that contains mav0' %
                             (mav / "cam0", folder))
    return Recording(Path(folder), load_camera(mav / "cam0"),
                     load_camera(mav / "cam1") if (mav / "cam1").is_dir() else None,
                     load_imu(mav / "imu0") if (mav / "imu0").is_dir() else None, load_ground_truth(Path(folder)))
