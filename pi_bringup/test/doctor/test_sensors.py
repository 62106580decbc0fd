"""Judgements of what was heard of cameras and IMU."""

import random
import struct
import unittest

from fake_root import FakeRoot
from pi_bringup.doctor import sensors

WIDTH, HEIGHT = 640, 480


def pictures(side="left", rate=30.0, seconds=5.0, offset=0.0, age=0.03):
    count = int(rate * seconds)
    stamps = [100.0 + i / rate + offset for i in range(count)]
    return sensors.Stream(f"{side}/image_raw", True, stamps, [age] * count, list(range(count)),
                          [(WIDTH, HEIGHT)] * count)


def info(stream, size=(WIDTH, HEIGHT), calibrated=True):
    return sensors.Stream(stream.topic.replace("image_raw", "camera_info"), True, list(stream.stamps),
                          list(stream.ages), list(stream.numbers), [size] * len(stream.stamps), calibrated)


def imu(rate=200.0, seconds=5.0, acceleration=(0.0, 0.0, -9.81), turning=0.0, noise=0.02):
    draw = random.Random(1)
    count = int(rate * seconds)
    stream = sensors.Stream("imu/data", True, [100.0 + i / rate for i in range(count)], [0.004] * count,
                            list(range(count)))
    stream.accelerations = [tuple(a + draw.gauss(0.0, noise) for a in acceleration) for _ in range(count)]
    stream.rates = [(draw.gauss(0.0, 0.001), 0.0, turning) for _ in range(count)]
    return stream


def without(stream, wrong, renumber):
    """@param renumber  True: the publisher never had them."""
    kept = [i for i in range(len(stream.stamps)) if not wrong(i)]
    stream.stamps = [stream.stamps[i] for i in kept]
    stream.ages = [stream.ages[i] for i in kept]
    stream.numbers = list(range(len(kept))) if renumber else kept
    return stream


class Sensors(FakeRoot):
    def test_a_good_vehicle_has_no_complaint(self):
        left, right = pictures(), pictures("right")
        streams = {"left/image_raw": left, "right/image_raw": right, "left/camera_info": info(left),
                   "right/camera_info": info(right), "imu/data": imu()}
        results = sensors.judge(streams)
        self.assertEqual({"OK"}, {result.level for result in results}, [result.line() for result in results])
        self.assertEqual(14, len(results))
        self.assertEqual(len(results), len({result.check for result in results}))

    def test_without_any_sensor(self):
        streams = {topic: sensors.Stream(topic) for topic in ("left/image_raw", "right/image_raw", "left/camera_info",
                                                              "right/camera_info", "imu/data")}
        results = sensors.judge(streams)
        self.assertEqual(["FAIL"] * 3, [result.level for result in results])
        self.expect("FAIL", results[2], "imu/data: is not published", "start its driver")

    def test_rate(self):
        self.expect("OK", sensors.judge_rate("left pictures", pictures(rate=60.0), 15.0), "60.0 Hz, at least 15")
        self.expect("FAIL", sensors.judge_rate("left pictures", pictures(rate=7.0), 15.0), "7.0 Hz, at least 15")
        few = without(pictures(rate=60.0), lambda i: i % 3, renumber=False)
        self.expect("OK", sensors.judge_rate("left pictures", few, 50.0), "60.0 Hz")
        self.expect("FAIL", sensors.judge_rate("IMU", sensors.Stream("imu/data", True, [1.0], [0.0], [1]), 150.0),
                    "1 message(s) came")

    def test_stamps(self):
        self.expect("OK", sensors.judge_stamps("IMU", imu(), 0.3), "4.0 ms old, at most 300")
        self.expect("FAIL", sensors.judge_stamps("left pictures", pictures(age=0.5), 0.3), "500.0 ms old")
        self.expect("FAIL", sensors.judge_stamps("left pictures", pictures(age=-0.5), 0.3), "500.0 ms in the future",
                    "synchronise the clocks")
        back = pictures()
        back.stamps[10] = back.stamps[9]
        self.expect("FAIL", sensors.judge_stamps("left pictures", back, 0.3), "1 of 150 do not increase")

    def test_gaps(self):
        self.expect("OK", sensors.judge_gaps("IMU", imu(), 0.05), "0 of 1000 missing")
        lost = without(imu(), lambda i: i in range(100, 115), renumber=True)
        self.expect("WARN", sensors.judge_gaps("IMU", lost, 0.05), "15 of 1000 missing", "longest 80.0 ms")
        on_the_way = without(imu(), lambda i: i in range(100, 115), renumber=False)
        self.expect("OK", sensors.judge_gaps("IMU", on_the_way, 0.05), "0 of 1000 missing", "15 more did not reach")
        constant = imu()
        constant.numbers = [0] * len(constant.numbers)
        self.expect("OK", sensors.judge_gaps("IMU", constant, 0.05), "0 of 1000 missing")

    def test_camera_info(self):
        left = pictures()
        self.expect("OK", sensors.judge_info("left", left, info(left)), "640x480, as the pictures")
        self.expect("FAIL", sensors.judge_info("left", left, info(left, (1280, 720))),
                    "for 1280x720, the pictures are 640x480", "calibrate at the size")
        self.expect("WARN", sensors.judge_info("left", left, info(left, calibrated=False)), "not calibrated (K is 0)")
        self.expect("FAIL", sensors.judge_info("left", left, sensors.Stream("left/camera_info")),
                    "nothing on left/camera_info")
        self.expect("WARN", sensors.judge_info("left", left, info(pictures(offset=0.01))), "0 of 150 have the stamp")

    def test_stereo(self):
        self.expect("OK", sensors.judge_stereo(pictures(), pictures("right")), "0.00 ms, at most 2; 0 of 150")
        self.expect("OK", sensors.judge_stereo(pictures(), pictures("right", offset=0.0015)), "1.50 ms")
        self.expect("FAIL", sensors.judge_stereo(pictures(), pictures("right", offset=0.01)), "10.00 ms, at most 2",
                    "trigger the cameras together")
        some = without(pictures("right"), lambda i: i % 10 == 5, renumber=True)
        self.expect("WARN", sensors.judge_stereo(pictures(), some), "15 of 150 pictures without a partner")
        on_the_way = without(pictures("right"), lambda i: i % 10 == 5, renumber=False)
        self.expect("OK", sensors.judge_stereo(pictures(), on_the_way), "0 of 150 pictures without a partner")
        self.expect("FAIL", sensors.judge_stereo(pictures(), pictures("right", offset=1000.0)), "of different times")

    def test_acceleration(self):
        self.expect("OK", sensors.judge_acceleration(imu()), "9.81 m/s²")
        self.expect("FAIL", sensors.judge_acceleration(imu(acceleration=(0.0, 0.0, 1.0))), "not g")
        self.expect("FAIL", sensors.judge_acceleration(imu(acceleration=(0.0, 0.0, 98.1))), "98.10 m/s²",
                    "unit and scale")
        self.expect("WARN", sensors.judge_acceleration(imu(acceleration=(0.0, 0.0, 10.6))), "10.60 m/s²")
        self.expect("WARN", sensors.judge_acceleration(imu(noise=2.0)), "must stand")
        self.expect("FAIL", sensors.judge_acceleration(imu(noise=0.0)), "it never changes")
        for bad in (float("nan"), float("inf")):
            broken = imu()
            broken.accelerations[7] = (0.0, bad, 9.81)
            self.expect("FAIL", sensors.judge_acceleration(broken), "no finite numbers")

    def test_turning(self):
        self.expect("OK", sensors.judge_turning(imu()), "0.000")
        self.expect("WARN", sensors.judge_turning(imu(turning=5.0)), "5.0000 rad/s, at most 0.1")

    def test_size_of_a_picture(self):
        frame = b"left_optical"
        self.assertEqual((752, 480), sensors.picture_size(struct.pack("<IIII", 1, 2, 3, len(frame)) + frame +
                                                          struct.pack("<III", 480, 752, 5) + b"mono8"))


if __name__ == "__main__":
    unittest.main()
