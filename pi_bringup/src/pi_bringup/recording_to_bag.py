"""Turns a recording into a bag with the topics of the vehicle's sensors, at recorded stamps. Needs no master.

recording_to_bag INPUT BAG: INPUT is the folder of a EuRoC recording (the one that contains mav0) or a video.
recording_to_bag --play INPUT [ARGUMENTS OF rosbag play]: converts INPUT into the cache, unless the bag is there or INPUT is
a bag, and becomes `rosbag play` of it.

Exit status: 0; 1 if the recording cannot be read or the bag not be written; 2 for a wrong command line; 128 + number of the
signal that ended it.
"""

import argparse
import contextlib
import hashlib
import itertools
import math
import os
import signal
import sys
from pathlib import Path

import cv2
import genpy
import numpy
import rosbag
import rosgraph
import roslib.packages
import rospkg
from geometry_msgs.msg import PoseStamped, Quaternion, TransformStamped, Vector3
from nav_msgs.msg import Odometry, Path as PathMessage
from sensor_msgs.msg import CameraInfo, Image, Imu
from std_msgs.msg import Bool
from tf2_msgs.msg import TFMessage

from pi_bringup import euroc
from pi_bringup.euroc import RecordingError

BODY_IN_BASE = [0.0, 0.0, 0.0, 0.70710678, 0.0, 0.70710678, 0.0]  # EuRoC's MAVs: body x up, y right, z forward
VIDEO_START_NS = 10 ** 9      # a video has no recorded time, and a bag has no time 0
# std_msgs/Bool, true at the begin and false at the end, for topic_restamper. rosbag play reads the file while it is at the first one, so that
# what follows is in time. The last one makes a lap of a loop as long as it takes to the next picture.
BORDER_TOPIC, LEAD_NS = "recording_border", 10000000
PATH_PERIOD_NS = 200000000    # the path is one message with all its poses: more often would only cost
PATH_SPACING_M = 0.05
PNG_START, PNG_END = b"\x89PNG", b"IEND\xae\x42\x60\x82"


# -------------------------------------------------------------------------------------------------------------- messages

def time_of(stamp_ns):
    return genpy.Time(*divmod(stamp_ns, 10 ** 9))


def image_message(pixels, frame):
    """@param pixels  rows x columns (grey) or rows x columns x 3 (blue, green, red)"""
    message = Image(height=pixels.shape[0], width=pixels.shape[1], encoding="mono8" if pixels.ndim == 2 else "bgr8",
                    step=pixels[0].size, data=pixels.tobytes())
    message.header.frame_id = frame
    return message


def camera_info(width, height, intrinsics, distortion, R, P, frame):
    fx, fy, cx, cy = intrinsics
    message = CameraInfo(width=width, height=height, distortion_model="plumb_bob", D=[*distortion, 0.0],
                         K=[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0], R=numpy.ravel(R).tolist(),
                         P=numpy.ravel(P).tolist())
    message.header.frame_id = frame
    return message


def projection(intrinsics):
    fx, fy, cx, cy = intrinsics
    return numpy.array([[fx, 0.0, cx, 0.0], [0.0, fy, cy, 0.0], [0.0, 0.0, 1.0, 0.0]])


def nominal_camera_info(width, height, horizontal_fov_deg, frame):
    """An ideal pinhole, for cameras nobody has calibrated."""
    f = 0.5 * width / math.tan(0.5 * math.radians(horizontal_fov_deg))
    intrinsics = (f, f, 0.5 * (width - 1), 0.5 * (height - 1))
    return camera_info(width, height, intrinsics, [0.0] * 4, numpy.eye(3), projection(intrinsics), frame)


def rectify(left, right):
    """[(R, P)] of one camera, which keeps its intrinsics, or of a pair (Bouguet's method): with common principal
    points, cropped to valid pixels."""
    if right is None:
        return [(numpy.eye(3), projection(left.intrinsics))]
    if (left.width, left.height) != (right.width, right.height):
        raise RecordingError("stereo pair: left is %dx%d, right is %dx%d; both must have the same size" %
                             (left.width, left.height, right.width, right.height))
    T = numpy.linalg.inv(right.T_body_sensor) @ left.T_body_sensor
    K_left, K_right = projection(left.intrinsics)[:, :3], projection(right.intrinsics)[:, :3]
    R_left, R_right, P_left, P_right = cv2.stereoRectify(
        K_left, numpy.array(left.distortion), K_right, numpy.array(right.distortion), (left.width, left.height),
        T[:3, :3], T[:3, 3], flags=cv2.CALIB_ZERO_DISPARITY, alpha=0.0)[:4]
    return [(R_left, P_left), (R_right, P_right)]


def imu_message(imu, sample, frame):
    message = Imu(angular_velocity=Vector3(*sample[1:4]), linear_acceleration=Vector3(*sample[4:7]))
    message.header.frame_id = frame
    message.orientation_covariance = [-1.0] + [0.0] * 8  # there is no orientation
    # White noise of density n sampled at rate f has variance n^2 f.
    message.angular_velocity_covariance = numpy.ravel(numpy.eye(3) * imu.gyroscope_noise ** 2 * imu.rate_hz).tolist()
    message.linear_acceleration_covariance = numpy.ravel(
        numpy.eye(3) * imu.accelerometer_noise ** 2 * imu.rate_hz).tolist()
    return message


def odometry_message(T_world_body, velocity, T_base_body, world_frame, base_frame):
    """Pose of the base in the world; the twist is that of the body's origin, in the base frame. A twist covariance of
    -1 marks what the recording does not hold."""
    T = T_world_body @ numpy.linalg.inv(T_base_body)
    message = Odometry(child_frame_id=base_frame)
    message.header.frame_id = world_frame
    position = message.pose.pose.position
    position.x, position.y, position.z = T[:3, 3]
    message.pose.pose.orientation = Quaternion(*euroc.quaternion_of(T))
    covariance = [0.0] * 36
    covariance[21] = -1.0
    if velocity is None:
        covariance[0] = -1.0
    else:
        message.twist.twist.linear = Vector3(*(T[:3, :3].T @ velocity))
    message.twist.covariance = covariance
    return message


def transform_message(T, parent, child, stamp=genpy.Time()):
    message = TransformStamped(child_frame_id=child)
    message.header.stamp, message.header.frame_id = stamp, parent
    message.transform.translation = Vector3(*T[:3, 3])
    message.transform.rotation = Quaternion(*euroc.quaternion_of(T))
    return message


# ---------------------------------------------------------------------------------------------------------------- inputs

def decode_grey(path, width, height):
    """@return (pixels, None), or (None, why the picture cannot be used)"""
    try:
        content = path.read_bytes()
    except OSError as error:
        return None, "%s: cannot be opened: %s" % (path, error.strerror)
    # libpng hands out the rows before a cut without an error in some versions.
    if content.startswith(PNG_START) and not content.endswith(PNG_END):
        return None, "%s: truncated, the PNG has no end (%d bytes)" % (path, len(content))
    pixels = cv2.imdecode(numpy.frombuffer(content, numpy.uint8), cv2.IMREAD_GRAYSCALE) if content else None
    if pixels is None:
        return None, "%s: not a picture that OpenCV can decode (%d bytes)" % (path, len(content))
    if pixels.shape != (height, width):
        return None, "%s: is %dx%d, the calibration is for %dx%d" % (path, *pixels.shape[::-1], width, height)
    return pixels, None


def check_options(options):
    """@throws RecordingError naming option, value and bound."""
    def check(valid, name, bound):
        if not valid:
            raise RecordingError("--%s %s, must be %s" % (name.replace("_", "-"), getattr(options, name), bound))

    check(0.0 <= options.start < math.inf, "start", "0 or more seconds")
    check(0.0 <= options.duration < math.inf, "duration", "0 (all) or more seconds")
    check(0.0 <= options.frame_rate <= 1000.0, "frame_rate", "in [0, 1000] Hz, 0 for the rate in the file")
    check(0.0 < options.fov < 180.0, "fov", "in (0, 180) degrees")
    check(options.compression in ("none", "lz4", "bz2"), "compression", "none, lz4 or bz2")
    check(options.namespace.startswith("/"), "namespace", "a name that begins with /")
    for name in ("map_frame", "base_link_frame", "imu_frame", "left_frame", "right_frame"):
        value = getattr(options, name)
        check(value and not value.startswith("/"), name, "a frame name without leading /")
    check(len(options.body_in_base) == 7, "body_in_base", "7 numbers: x y z [m], qx qy qz qw")
    check(abs(numpy.linalg.norm(options.body_in_base[3:]) - 1.0) < 1e-3, "body_in_base", "with a quaternion of norm 1")


class EurocInput:
    """The messages of a EuRoC recording. Stamps of the first, of the last message and of the end: begin_ns, end_ns."""

    def __init__(self, options):
        check_options(options)
        self.recording = recording = euroc.load(options.input)
        self.options, self.skipped, self.first_skip = options, 0, ""
        self._T_base_body = euroc.matrix_of(options.body_in_base[3:], options.body_in_base[:3])
        frames = [options.left_frame, options.right_frame]
        self.cameras = [camera for camera in (recording.left, recording.right) if camera]
        self.infos = [camera_info(camera.width, camera.height, camera.intrinsics, camera.distortion, R, P, frame)
                      for camera, (R, P), frame in zip(self.cameras, rectify(recording.left, recording.right), frames)]
        self._path, self._path_ns = PathMessage(), 0
        self._path.header.frame_id = options.map_frame
        self.items = self._timeline()
        self.begin_ns = self.items[0][0]
        self.end_ns = self.items[-1][0] + round(1e9 / recording.left.rate_hz)

    def _timeline(self):
        """[(stamp, stream, sample)] in the order in which they are due. At equal stamps IMU, ground truth, left, right:
        who gets a picture has the inertial data up to it."""
        recording, options = self.recording, self.options
        streams = [recording.imu.samples if recording.imu else [], recording.ground_truth,
                   *(camera.images for camera in self.cameras)]
        items = sorted(((sample[0], number, sample) for number, samples in enumerate(streams) for sample in samples),
                       key=lambda item: item[:2])
        origin_ns = recording.left.images[0][0] if options.start_at_first_image else items[0][0]
        begin_ns = origin_ns + round(options.start * 1e9)
        end_ns = begin_ns + round(options.duration * 1e9) if options.duration else math.inf
        items = [item for item in items if begin_ns <= item[0] < end_ns]
        if not items:
            raise RecordingError("--start %s --duration %s leave nothing of %s; choose a part of its %.1f s" %
                                 (options.start, options.duration, recording.folder,
                                  (max(samples[-1][0] for samples in streams if samples) - origin_ns) * 1e-9))
        return items

    def static_transforms(self):
        options, recording = self.options, self.recording
        mounts = [(recording.imu.T_body_sensor, options.imu_frame)] if recording.imu else []
        mounts += [(camera.T_body_sensor, info.header.frame_id) for camera, info in zip(self.cameras, self.infos)]
        return TFMessage([transform_message(self._T_base_body @ T, options.base_link_frame, frame, time_of(self.begin_ns))
                          for T, frame in mounts])

    def messages(self):
        """(stamp, topic, message) in order; a message with a header gets its stamp from the writer."""
        yield self.begin_ns, "/tf_static", self.static_transforms()
        for stamp, stream, sample in self.items:
            if stream == 0:
                yield stamp, "imu/data", imu_message(self.recording.imu, sample, self.options.imu_frame)
            elif stream == 1:
                yield from self._ground_truth(*sample)
            else:
                yield from self._picture(stamp, stream - 2, sample[1])

    def _ground_truth(self, stamp, T_world_body, velocity):
        odometry = odometry_message(T_world_body, velocity, self._T_base_body, self.options.map_frame,
                                    self.options.base_link_frame)
        yield stamp, "ground_truth/odometry", odometry
        if not self.options.tf:
            return
        pose = PoseStamped(pose=odometry.pose.pose)
        pose.header.stamp, pose.header.frame_id = time_of(stamp), self.options.map_frame
        position = numpy.array([pose.pose.position.x, pose.pose.position.y, pose.pose.position.z])
        transform = transform_message(euroc.matrix_of([getattr(pose.pose.orientation, axis) for axis in "xyzw"], position),
                                      self.options.map_frame, self.options.base_link_frame, time_of(stamp))
        yield stamp, "/tf", TFMessage([transform])
        if not self._path.poses or numpy.linalg.norm(position - self._last_position) >= PATH_SPACING_M:
            self._last_position = position
            self._path.poses.append(pose)
            if stamp - self._path_ns >= PATH_PERIOD_NS:
                self._path_ns = stamp
                yield stamp, "ground_truth/path", self._path

    def _picture(self, stamp, side, path):
        camera, info, name = self.cameras[side], self.infos[side], ("left", "right")[side]
        pixels, reason = decode_grey(path, camera.width, camera.height)
        if reason:
            self.first_skip = self.first_skip or reason
            self.skipped += 1
            return
        yield stamp, name + "/image_raw", image_message(pixels, info.header.frame_id)
        yield stamp, name + "/camera_info", info


class VideoInput:
    """The messages of a video: pictures of the left camera, and a nominal calibration."""

    skipped, first_skip, begin_ns = 0, "", VIDEO_START_NS

    def __init__(self, options):
        check_options(options)
        self.options, path = options, Path(options.input)
        if not path.is_file():
            way_out = "there is %s.gz: unpack it with gunzip and name the result" % path \
                if Path("%s.gz" % path).is_file() else \
                "install the Debian package opencv-doc for the default video, or name another file or a EuRoC folder"
            raise RecordingError("video %s: no such file; %s" % (path, way_out))
        cv2.setLogLevel(0)  # what it prints otherwise names no way out
        self._capture = cv2.VideoCapture(str(path))
        self.rate_hz = options.frame_rate or self._capture.get(cv2.CAP_PROP_FPS)
        self._size = [round(self._capture.get(one)) for one in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)]
        if not self._capture.isOpened() or min(self._size) <= 0:
            raise RecordingError("video %s (%d bytes): OpenCV cannot open it; use a format that its FFmpeg knows" %
                                 (path, path.stat().st_size))
        if not 0.0 < self.rate_hz <= 1000.0:
            raise RecordingError("video %s has no frame rate; give one with --frame-rate" % path)
        self._path, self.end_ns = path, self.begin_ns

    def messages(self):
        info = nominal_camera_info(*self._size, self.options.fov, self.options.left_frame)
        start_ns, duration_ns = round(self.options.start * 1e9), round(self.options.duration * 1e9) or math.inf
        for index in itertools.count():
            film_ns = round(index / self.rate_hz * 1e9) - start_ns
            read, pixels = self._capture.read() if film_ns < duration_ns else (False, None)
            if not read:
                if film_ns < duration_ns and index + 1 < self._capture.get(cv2.CAP_PROP_FRAME_COUNT):
                    self.skipped = round(self._capture.get(cv2.CAP_PROP_FRAME_COUNT)) - index
                    self.first_skip = "%s ends after %d frames: it is truncated or damaged" % (self._path, index)
                break
            if film_ns < 0:
                continue
            stamp = self.begin_ns + film_ns
            self.end_ns = stamp + round(1e9 / self.rate_hz)
            yield stamp, "left/image_raw", image_message(pixels, self.options.left_frame)
            yield stamp, "left/camera_info", info
        if self.end_ns == self.begin_ns:
            raise RecordingError("video %s: no frame can be read from second %s on (it has %d); name another one, or a "
                                 "smaller --start" % (self._path, self.options.start, index))


# ------------------------------------------------------------------------------------------------------------------- bag

def latched_header(topic, kind):
    """Tells `rosbag play` to keep the message for those who come later. A header given by the caller must be whole."""
    return {"topic": topic, "type": kind._type, "md5sum": kind._md5sum, "message_definition": kind._full_text,
            "latching": "1", "callerid": "/recording_to_bag"}


def write_bag(source, target, options, progress=lambda seconds: None):
    """Writes the bag under the name TARGET.part, which becomes TARGET when it is complete; leaves nothing otherwise.
    @return {topic: messages}. @throws RecordingError"""
    target = Path(target).absolute()
    if target.exists() and not options.force:
        raise RecordingError("%s exists; name another file or use --force to replace it" % target)
    partial = Path("%s.part" % target)
    try:
        os.close(os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
    except OSError as error:
        raise RecordingError("%s: cannot be created: %s; %s" % (partial, error.strerror, (
            "another run writes it or was killed, remove it if not running" if partial.exists()
            else "name a folder that exists and can be written to"))) from None
    bag, counts = None, {}
    try:
        bag = rosbag.Bag(str(partial), "w", compression=options.compression)
        prefix = options.namespace.rstrip("/") + "/"
        bag.write(prefix + BORDER_TOPIC, Bool(True), time_of(source.begin_ns - LEAD_NS))
        for stamp, topic, message in source.messages():
            name = topic if topic.startswith("/") else prefix + topic
            counts[name] = counts.get(name, 0) + 1
            if message._has_header:
                message.header.stamp = time_of(stamp)
                message.header.seq = counts[name] - 1
            latched = topic in ("/tf_static", "ground_truth/path")
            bag.write(name, message, time_of(stamp),
                      connection_header=latched_header(name, type(message)) if latched else None)
            progress((stamp - source.begin_ns) * 1e-9)
        if not any("/image_raw" in topic for topic in counts) and source.skipped:
            raise RecordingError("none of %d pictures can be read, the first: %s; copy the recording again" %
                                 (source.skipped, source.first_skip))
        bag.write(prefix + BORDER_TOPIC, Bool(False), time_of(source.end_ns - LEAD_NS))
        bag.close()
        os.replace(partial, target)
    except OSError as error:
        free = os.statvfs(partial.parent)
        raise RecordingError("%s: cannot be written: %s; %d MB are free there, make room or name another folder" %
                             (partial, error.strerror, free.f_bavail * free.f_frsize >> 20)) from None
    finally:
        if partial.exists():
            if bag is not None and bag._file is not None:
                with contextlib.suppress(OSError):
                    bag._file.close()  # not bag.close(), which would write the index
                bag._file = None
            partial.unlink()
    return counts


def open_input(options):
    path = Path(options.input)
    return EurocInput(options) if path.is_dir() or not (path.is_file() or path.suffix) else VideoInput(options)


# ------------------------------------------------------------------------------------------------------------------ play

def cached_bag(options):
    """The bag of this input with these options in $ROS_HOME/recordings, written now unless it is there."""
    source = open_input(options)
    folder = Path(os.environ.get("ROS_HOME", Path.home() / ".ros")) / "recordings"
    files = [Path(options.input)] if isinstance(source, VideoInput) else sorted(Path(options.input).glob("mav0/*/*.*"))
    facts = [(str(path.resolve()), path.stat().st_mtime_ns, path.stat().st_size) for path in files]
    key = hashlib.sha256(repr((facts, sorted(vars(options).items()))).encode()).hexdigest()[:12]
    bag = folder / ("%s_%s.bag" % (Path(options.input).resolve().name, key))
    if not bag.exists():
        folder.mkdir(parents=True, exist_ok=True)
        write_bag(source, bag, options)
        print("%s: %d MB, kept for the next time; remove it when you like" % (bag, bag.stat().st_size >> 20), flush=True)
    return bag


def announce(bag, arguments):
    """Tells the parameter server what the bag holds, for topic_restamper, which has to advertise it before the first
    message comes."""
    with rosbag.Bag(str(bag)) as file:
        topics = [{"topic": one.topic, "type": one.datatype, "md5sum": one.md5sum, "definition": one.msg_def,
                   "latching": int(one.header.get("latching", b"0") in (b"1", "1"))}
                  for one in file._get_connections()]
    names = [word.split(":=", 1)[1] for word in arguments if word.startswith("__name:=")]
    name = rosgraph.names.ns_join(rosgraph.names.get_ros_namespace(), names[-1] if names else "recording")
    try:
        rosgraph.Master("/recording_to_bag").setParam(name + "/topics", topics)
    except OSError as error:
        raise RecordingError("ROS_MASTER_URI = %s: no master answers (%s); start roscore" %
                             (os.environ.get("ROS_MASTER_URI"), error)) from None


def play(options, arguments):
    """Becomes `rosbag play`."""
    bag = Path(options.input).absolute() if options.input.endswith(".bag") else cached_bag(options)
    if not bag.is_file():
        raise RecordingError("%s: no such bag" % bag)
    try:
        announce(bag, arguments)
    except (rosbag.ROSBagException, OSError) as error:
        raise RecordingError("%s: not readable as a bag: %s; convert the recording again, or try rosbag reindex" %
                             (bag, error)) from None
    # The program itself: `rosbag play` would wait for it as long as it plays.
    program = roslib.packages.find_node("rosbag", "play", rospkg.RosPack())
    if not program:
        raise RecordingError("rosbag has no program play; run: apt-get install python3-rosbag")
    os.execv(program[0], [program[0], "--quiet", "--delay=0", *arguments, str(bag)])


# ------------------------------------------------------------------------------------------------------------------ main

class Progress:
    """Seconds done: on one line of a terminal, or a line every ten seconds of the recording elsewhere."""

    def __init__(self):
        self._terminal, self._shown = sys.stderr.isatty(), 0

    def __call__(self, seconds):
        step = int(seconds if self._terminal else seconds / 10)
        if step > self._shown:
            self._shown = step
            print("%s%.0f s" % ("\r" if self._terminal else "", seconds), end="" if self._terminal else "\n",
                  file=sys.stderr, flush=True)


def numbers(text):
    return [float(word) for word in text.strip("[]").replace(",", " ").split()]


def parser(playing):
    made = argparse.ArgumentParser(prog="recording_to_bag", description=__doc__, allow_abbrev=False,
                                   formatter_class=argparse.RawDescriptionHelpFormatter)
    made.add_argument("input", metavar="INPUT")
    if not playing:
        made.add_argument("bag", metavar="BAG")
    made.add_argument("--play", action="store_true", help="play it, see above")
    made.add_argument("-f", "--force", action="store_true", help="replace BAG if it exists")
    made.add_argument("-n", "--namespace", default="/", help="of the topics")
    made.add_argument("-c", "--compression", default="none", help="none, lz4 or bz2; pictures hardly become smaller")
    made.add_argument("-s", "--start", type=float, default=0.0, help="seconds of the recording to leave out")
    made.add_argument("-d", "--duration", type=float, default=0.0, help="seconds to write, 0: all")
    made.add_argument("--start-at-first-image", action="store_true", help="leave out what was recorded before it")
    made.add_argument("--tf", action="store_true", help="ground truth also as /tf and as ground_truth/path")
    for name, default in (("map", "map"), ("base-link", "base_link"), ("imu", "imu_link"), ("left", "left_optical"),
                          ("right", "right_optical")):
        made.add_argument("--%s-frame" % name, default=default, help="default: %(default)s")
    made.add_argument("--body-in-base", type=numbers, default=BODY_IN_BASE, metavar="'X Y Z QX QY QZ QW'",
                      help="the recording's body frame in the base frame; default: that of EuRoC's MAVs")
    made.add_argument("--frame-rate", type=float, default=0.0, help="of a video [Hz], 0: as the file says")
    made.add_argument("--fov", type=float, default=60.0, help="of a video's nominal camera, horizontal [deg]")
    return made


def main(arguments=None):
    arguments = sys.argv[1:] if arguments is None else arguments
    command_line = parser("--play" in arguments)
    options, others = command_line.parse_known_args(arguments)
    if others and not options.play:
        command_line.error("unknown: %s" % " ".join(others))

    def interrupt(number, _):
        sys.exit(128 + number)

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, interrupt)
    try:
        if options.play:
            return play(options, others)
        source = open_input(options)
        counts = write_bag(source, options.bag, options, Progress())
    except RecordingError as error:
        print("recording_to_bag: %s" % error, file=sys.stderr)
        return 1
    print("\n".join("%d  %s" % (count, topic) for topic, count in sorted(counts.items())))
    if source.skipped:
        print("warning: %d damaged pictures left out, the first: %s; copy the recording again to have them" %
              (source.skipped, source.first_skip), file=sys.stderr)
    print(options.bag)
    return 0
