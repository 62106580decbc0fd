"""Checks of cameras and IMU on a graph that runs: rates, stamps, gaps, the time between left and right, camera_info,
what the IMU measures."""

import math
import statistics
import struct
import threading
import time
from dataclasses import dataclass, field

from pi_bringup.doctor import live
from pi_bringup.doctor.result import fail, ok, warn

LISTEN_S = 5.0
SIDES = ("left", "right")
MOST_AGE_S = 0.3             # of pictures behind now: max_delay_s of vio
MOST_AHEAD_S = 0.01          # of stamps before now
MOST_DIFFERENCE_S = 0.002    # of left and right: pair_tolerance_s of vio
MOST_MISSING = 0.01          # of pictures or samples
MOST_IMU_GAP_S = 0.05
STANDARD_GRAVITY = 9.81      # [m/s^2]
GRAVITY_OFF = (0.5, 2.0)     # [m/s^2] of the mean, from which on it is a warning, an error
MOST_SHAKING = 1.0           # [m/s^2] deviation of an axis
MOST_TURNING = 0.1           # [rad/s] mean at rest


@dataclass
class Stream:
    """What came on a topic."""
    topic: str = ""
    published: bool = False
    stamps: list = field(default_factory=list)      # [s]
    ages: list = field(default_factory=list)        # arrival - stamp [s]
    numbers: list = field(default_factory=list)     # seq of the headers
    sizes: list = field(default_factory=list)       # of pictures and camera_info: (width, height)
    calibrated: bool = False                        # of camera_info
    accelerations: list = field(default_factory=list)  # (x, y, z) [m/s^2]
    rates: list = field(default_factory=list)          # (x, y, z) [rad/s]


def intervals(stamps):
    return [after - before for before, after in zip(stamps, stamps[1:])]


def has_enough(stream):
    return len(stream.stamps) >= 3 and stream.stamps[-1] > stream.stamps[0]


def lost_on_the_way(numbers):
    """Messages that their publisher sent and that did not come here."""
    return sum(max(0, step - 1) for step in intervals(numbers))


def judge_rate(name, stream, least):
    """The rate at which it is published: what is lost on the way here counts."""
    if not has_enough(stream):
        state = ("is not published" if not stream.published else f"{len(stream.stamps)} message(s) came")
        return fail(f"{name} rate", f"{stream.topic}: {state}, expected are {least:g} Hz",
                    "start its driver, or look at its log and diagnostics")
    rate = (len(stream.stamps) - 1 + lost_on_the_way(stream.numbers)) / (stream.stamps[-1] - stream.stamps[0])
    text = f"{rate:.1f} Hz, at least {least:g}"
    if rate < live.SLOW * least:
        return fail(f"{name} rate", text, "look at the driver's rate, the exposure time, the USB port and the load")
    return ok(f"{name} rate", text)


def judge_stamps(name, stream, most_age_s):
    name = f"{name} stamps"
    age = sorted(stream.ages)[len(stream.ages) // 10]  # the doctor itself is slow with pictures, and delays the rest
    text = f"{1000 * age:.1f} ms old, at most {1000 * most_age_s:.0f}"
    back = sum(step <= 0.0 for step in intervals(stream.stamps))
    if back:
        return fail(name, f"{back} of {len(stream.stamps)} do not increase",
                    "the driver must stamp with one clock; two nodes may publish the topic")
    if min(stream.ages) < -MOST_AHEAD_S:
        return fail(name, f"up to {-1000 * min(stream.ages):.1f} ms in the future, at most {1000 * MOST_AHEAD_S:.0f}",
                    "synchronise the clocks, or let the driver stamp with ROS's time")
    if age > most_age_s:
        return fail(name, text, "the load of the computer, buffers of the driver, or a clock that differs")
    return ok(name, text)


def judge_gaps(name, stream, most_gap_s):
    """What the sensor or its driver left out, by stamps; what was only lost on the way here does not count."""
    name = f"{name} gaps"
    # A publisher that began anew, or that does not count, lost nothing on the way.
    steps = [(step, max(1, number)) for step, number in zip(intervals(stream.stamps), intervals(stream.numbers))]
    period = statistics.median(step / number for step, number in steps)
    missing = sum(max(0, round(step / period) - number) for step, number in steps) if period > 0.0 else 0
    longest = max(step / number for step, number in steps)
    lost = lost_on_the_way(stream.numbers)
    text = (f"{missing} of {missing + len(stream.stamps) + lost} missing, at most {100 * MOST_MISSING:g} %; "
            f"longest {1000 * longest:.1f} ms, at most {1000 * most_gap_s:.0f}")
    if lost:
        text += f" ({lost} more did not reach the doctor)"
    if missing > MOST_MISSING * (missing + len(stream.stamps)) or longest > most_gap_s:
        return warn(name, text, "look at cable, USB port and load; the driver's diagnostics count what it dropped")
    return ok(name, text)


def judge_info(side, pictures, info):
    name = f"{side} camera_info"
    if not info.stamps:
        return fail(name, f"nothing on {info.topic}", "the driver must publish it with each picture")
    size, told = pictures.sizes[-1], info.sizes[-1]
    if size != told:
        return fail(name, f"it is for {told[0]}x{told[1]}, the pictures are {size[0]}x{size[1]}",
                    "calibrate at the size that is used, or set the driver's width and height")
    shared = len(set(pictures.stamps) & set(info.stamps))
    if shared < 0.5 * min(len(pictures.stamps), len(info.stamps)):
        return warn(name, f"{shared} of {len(pictures.stamps)} have the stamp of a picture",
                    "the driver must publish it with each picture, with its stamp")
    if not info.calibrated:
        return warn(name, f"{told[0]}x{told[1]}, not calibrated (K is 0)",
                    "calibrate, or give vehicle.launch calibration:=kalibr")
    return ok(name, f"{told[0]}x{told[1]}, as the pictures")


def judge_stereo(left, right):
    name = "stereo time difference"
    # Each left picture with the nearest right one; those at the ends may have lost theirs.
    begin, end = max(left.stamps[0], right.stamps[0]), min(left.stamps[-1], right.stamps[-1])
    differences = sorted(min(abs(other - stamp) for other in right.stamps) for stamp in left.stamps
                         if begin <= stamp <= end)
    if not differences:
        return fail(name, "left and right pictures are of different times", "look at the clocks of both drivers")
    paired = [difference for difference in differences if difference <= MOST_DIFFERENCE_S]
    # The partner of some may have been lost on the way here.
    alone = max(0, len(differences) - len(paired) - lost_on_the_way(left.numbers) - lost_on_the_way(right.numbers))
    text = (f"{1000 * statistics.median(paired or differences):.2f} ms, at most {1000 * MOST_DIFFERENCE_S:g}; {alone} "
            f"of {len(differences)} pictures without a partner, at most {100 * MOST_MISSING:g} %")
    if alone > 0.5 * len(differences):
        return fail(name, text, "trigger the cameras together, or use one with both pictures side by side")
    if alone > MOST_MISSING * len(differences):
        return warn(name, text, "pictures get lost: cable, USB port, load")
    return ok(name, text)


def judge_acceleration(stream):
    name = "IMU acceleration"
    finite = [sample for sample in stream.accelerations if all(map(math.isfinite, sample))]
    if len(finite) < len(stream.accelerations) or not all(math.isfinite(x) for sample in stream.rates for x in sample):
        return fail(name, "some measurements are no finite numbers", "the driver must leave them out")
    mean = math.sqrt(sum(statistics.fmean(axis) ** 2 for axis in zip(*finite)))
    noise = max(statistics.pstdev(axis) for axis in zip(*finite))
    off = abs(mean - STANDARD_GRAVITY)
    text = (f"{mean:.2f} m/s², at most {GRAVITY_OFF[0]:g} from {STANDARD_GRAVITY}; deviation {noise:.3f}, at most "
            f"{MOST_SHAKING:g}")
    if noise == 0.0:
        return fail(name, "it never changes", "the IMU or its driver repeats one sample; switch it off and on")
    if off > GRAVITY_OFF[1]:
        return fail(name, text, "unit and scale of the driver: m/s², not g" if mean < 2.0 else
                    "unit and scale of the driver; the vehicle must stand")
    if off > GRAVITY_OFF[0] or noise > MOST_SHAKING:
        return warn(name, text, "the vehicle must stand; else the IMU is not calibrated, or shakes")
    return ok(name, text)


def judge_turning(stream):
    name = "IMU angular velocity"
    mean = math.sqrt(sum(statistics.fmean(axis) ** 2 for axis in zip(*stream.rates)))
    text = f"{mean:.4f} rad/s, at most {MOST_TURNING:g}"
    if mean > MOST_TURNING:
        return warn(name, text, "the vehicle must stand; else the unit is not rad/s, or the bias is large")
    return ok(name, text)


def judge(streams):
    """@param streams  {topic: Stream} of live.RATES' cameras and IMU, and of camera_info. @return results"""
    results, pictures = [], []
    for side in SIDES:
        stream = streams[f"{side}/image_raw"]
        results.append(judge_rate(f"{side} pictures", stream, live.RATES[stream.topic]))
        if not has_enough(stream):
            continue
        pictures.append(stream)
        results += [judge_stamps(f"{side} pictures", stream, MOST_AGE_S),
                    judge_gaps(f"{side} pictures", stream, 5.0 / live.RATES[stream.topic]),
                    judge_info(side, stream, streams[f"{side}/camera_info"])]
    if len(pictures) == 2:
        results.append(judge_stereo(*pictures))
    imu = streams["imu/data"]
    results.append(judge_rate("IMU", imu, live.RATES[imu.topic]))
    if has_enough(imu):
        results += [judge_stamps("IMU", imu, MOST_AGE_S), judge_gaps("IMU", imu, MOST_IMU_GAP_S),
                    judge_acceleration(imu)]
        if results[-1].level != "FAIL":
            results.append(judge_turning(imu))
    return results


def picture_size(buffer):
    """(width, height) of a sensor_msgs/Image: behind seq, stamp and frame_id."""
    length, = struct.unpack_from("<I", buffer, 12)
    height, width = struct.unpack_from("<II", buffer, 16 + length)
    return width, height


class SensorListener:
    """rospy's node of this process must be initialised."""

    def __init__(self):
        import rospy
        from sensor_msgs.msg import CameraInfo, Imu
        self._rospy = rospy
        self._lock = threading.Lock()
        self.streams = {}
        # Pictures are not decoded: rospy takes too long for 60 pairs a second.
        kinds = [("imu/data", Imu, self._on_imu)]
        for side in SIDES:
            kinds += [(f"{side}/image_raw", rospy.AnyMsg, self._on_picture),
                      (f"{side}/camera_info", CameraInfo, self._on_info)]
        published = {topic for topic, _ in rospy.get_published_topics()}
        for topic, _, _ in kinds:
            self.streams[topic] = Stream(topic, rospy.resolve_name(topic) in published)
        self._subscribers = [rospy.Subscriber(topic, kind, callback, self.streams[topic], queue_size=100,
                                              buff_size=1 << 24, tcp_nodelay=True) for topic, kind, callback in kinds]

    def _note(self, stream, number, stamp_s):
        stream.ages.append(self._rospy.Time.now().to_sec() - stamp_s)
        stream.stamps.append(stamp_s)
        stream.numbers.append(number)

    def _on_picture(self, message, stream):
        with self._lock:
            self._note(stream, struct.unpack_from("<I", message._buff)[0], live.stamp_of(message._buff))
            stream.sizes.append(picture_size(message._buff))

    def _on_info(self, message, stream):
        with self._lock:
            self._note(stream, message.header.seq, message.header.stamp.to_sec())
            stream.sizes.append((message.width, message.height))
            stream.calibrated = message.K[0] != 0.0

    def _on_imu(self, message, stream):
        a, w = message.linear_acceleration, message.angular_velocity
        with self._lock:
            self._note(stream, message.header.seq, message.header.stamp.to_sec())
            stream.accelerations.append((a.x, a.y, a.z))
            stream.rates.append((w.x, w.y, w.z))

    def results(self):
        with self._lock:
            return judge(self.streams)


def check_sensors(listen_s=LISTEN_S):
    from pi_bringup.doctor import software
    master = software.check_master()
    if master.level != "OK":
        return fail("cameras and IMU", "there is no graph: the ROS master " + master.text,
                    "start the vehicle, or sensors.launch")
    live.join_graph()
    listener = SensorListener()
    time.sleep(listen_s)  # how long it listens is what the rates are measured by
    return listener.results()
