#!/usr/bin/python3
"""A made-up EuRoC recording for tests: 64x48 pictures at 20 Hz, IMU and ground truth at 200 Hz. Every value can be
computed from its index.

tiny_recording.py FOLDER writes that of the rostests, whose fourth left picture is cut short."""

import os
import shutil
import sys
from pathlib import Path

import cv2
import numpy

WIDTH, HEIGHT = 64, 48
PICTURES = 10
SAMPLES = 110  # of IMU and ground truth; they begin 50 ms before the first picture
FIRST_SAMPLE_NS = 1500000000000000000
PICTURE_PERIOD_NS, SAMPLE_PERIOD_NS = 50000000, 5000000
BASELINE_M = 0.1
DAMAGED = 3  # of the rostests


def grey(left, index):
    """Value of all pixels of a picture. The right one is brighter by 100."""
    return (10 if left else 110) + index


def picture_stamp(index):
    return FIRST_SAMPLE_NS + 50000000 + index * PICTURE_PERIOD_NS


def sample_stamp(index):
    return FIRST_SAMPLE_NS + index * SAMPLE_PERIOD_NS


def picture_name(index):
    return "%d.png" % picture_stamp(index)


def camera_yaml(y_m):
    """The optical frame in the body frame: looks along the body's z, x to the right is the body's y, as on the real
    MAV."""
    return """%%YAML:1.0
# made up
sensor_type: camera
T_BS:
  cols: 4
  rows: 4
  data: [0.0, -1.0, 0.0, 0.0,
         1.0, 0.0, 0.0, %s,
         0.0, 0.0, 1.0, 0.0,
         0.0, 0.0, 0.0, 1.0]
rate_hz: 20
resolution: [%d, %d]
camera_model: pinhole  # as all
intrinsics: [40.0, 41.0, 31.5, 23.5] #fu, fv, cu, cv
distortion_model: radial-tangential
distortion_coefficients: [-0.1, 0.01, 0.0001, -0.0002]
""" % (y_m, WIDTH, HEIGHT)


IMU_YAML = """sensor_type: imu
comment: VI-Sensor IMU (made up)
T_BS:
  cols: 4
  rows: 4
  data: [1.0, 0.0, 0.0, 0.0,
         0.0, 1.0, 0.0, 0.0,
         0.0, 0.0, 1.0, 0.0,
         0.0, 0.0, 0.0, 1.0]
rate_hz: 200
gyroscope_noise_density: 1.0e-02     # [ rad / s / sqrt(Hz) ]
accelerometer_noise_density: 2.0e-02
"""


def write(folder):
    """Writes mav0 and groundtruth_tum.txt below the folder, which is created."""
    mav = Path(folder) / "mav0"
    for left, name in ((True, "cam0"), (False, "cam1")):
        (mav / name / "data").mkdir(parents=True)
        (mav / name / "sensor.yaml").write_text(camera_yaml(0.0 if left else BASELINE_M))
        lines = ["#timestamp [ns],filename"] + ["%d,%s\r" % (picture_stamp(i), picture_name(i)) for i in range(PICTURES)]
        (mav / name / "data.csv").write_text("\n".join(lines) + "\n")  # \r: as in the originals
        for i in range(PICTURES):
            cv2.imwrite(str(mav / name / "data" / picture_name(i)),
                        numpy.full((HEIGHT, WIDTH), grey(left, i), numpy.uint8))
    (mav / "imu0").mkdir()
    (mav / "imu0" / "sensor.yaml").write_text(IMU_YAML)
    (mav / "imu0" / "data.csv").write_text("#timestamp [ns],w_x,w_y,w_z,a_x,a_y,a_z\n" + "".join(
        "%d,%s,0.2,0.3,%s,0.5,0.6\n" % (sample_stamp(i), 0.001 * i, 9.8 + 0.001 * i) for i in range(SAMPLES)))
    (Path(folder) / "groundtruth_tum.txt").write_text("# timestamp(s) tx ty tz qx qy qz qw\n" + "".join(
        "%d.%09d %s 2.0 3.0 0.0 0.0 0.0 1.0\n" % (*divmod(sample_stamp(i), 10 ** 9), 0.01 * i) for i in range(SAMPLES)))


def cut_in_half(path):
    os.truncate(path, os.path.getsize(path) // 2)


if __name__ == "__main__":
    target = Path(sys.argv[1])
    shutil.rmtree(target / "mav0", ignore_errors=True)
    write(target)
    cut_in_half(target / "mav0/cam0/data" / picture_name(DAMAGED))
