"""A bag of what the sensors say at the begin of a drive, for measurements in real time."""

import shutil
import struct
import time

from first_drive.errors import DemoError

TOPICS = ["/left/image_raw", "/right/image_raw", "/left/camera_info", "/right/camera_info", "/imu/data", "/tf_static"]
NODE = "/sensor_recorder"
BORDER = "/recording_border"  # std_msgs/Bool: true at the begin, false at the end; topic_restamper reads it
LEAD_S = 0.01
START_S = 60.0                # for rosbag to start on a loaded machine
BUFFER_MB = 1024              # a busy computer writes later
FREE_BYTES = 3 * 2 ** 30
STAMP_AT, STAMP = 4, struct.Struct("<II")  # of a header, behind its number


class SensorRecording:
    """@param seconds  simulated, from begin() on."""

    def __init__(self, path, seconds):
        self._path = path
        self._log = path.parent / "log" / "recorder.log"
        self._seconds = seconds
        self._until = None
        self._recorder = None

    def begin(self, started, events, preload):
        """Returns when rosbag has subscribed. @throws DemoError"""
        if shutil.disk_usage(self._path.parent).free < FREE_BYTES:
            raise DemoError("%s has less than 3 GB of free space for the recording of the sensors; make room or choose "
                            "another folder with --output" % self._path.parent)
        self._path.unlink(missing_ok=True)
        environment = ["env", "LD_PRELOAD=%s" % preload] if preload else []
        self._recorder = started.start(
            environment + ["rosrun", "rosbag", "record", "--quiet", "-b", str(BUFFER_MB), "-O", str(self._path),
                           *TOPICS, "__name:=" + NODE.strip("/")], self._log)
        master = events.rospy.get_master()
        waiting = set(TOPICS)
        deadline = time.monotonic() + START_S
        while waiting:
            events.next(lambda *_: True, "rosbag record to subscribe")
            if self._recorder.poll() is not None or time.monotonic() > deadline:
                raise DemoError("rosbag record does not subscribe %s; see %s" % (", ".join(sorted(waiting)), self._log))
            waiting -= {topic for topic, nodes in master.getSystemState()[2][1] if NODE in nodes}
        self._until = events.rospy.get_time() + self._seconds

    def tick(self, started, now):
        """Ends the recording in time. @throws DemoError if rosbag ended before"""
        if self._recorder is not None and now >= self._until:
            self.end(started)

    def end(self, started):
        if self._recorder is None:
            return
        recorder, self._recorder = self._recorder, None
        ended = recorder.poll()
        started.stop(recorder)
        if ended is not None or not self._path.is_file():
            raise DemoError("rosbag record ended by itself, status %s; see %s" % (ended, self._log))
        self._write_as_sensors_send()

    def _write_as_sensors_send(self):
        """The times that rosbag wrote are those of a computer under load, 35 ms off; sensors send in their own time."""
        import genpy
        import rosbag
        from std_msgs.msg import Bool
        recorded = self._path.with_suffix(".recorded.bag")
        self._path.rename(recorded)
        try:
            with rosbag.Bag(str(recorded)) as source, rosbag.Bag(str(self._path), "w") as bag:
                times = []
                for topic, raw, written, header in source.read_messages(raw=True, return_connection_header=True):
                    stamp = written if topic == "/tf_static" else genpy.Time(*STAMP.unpack_from(raw[1], STAMP_AT))
                    times.append(stamp)
                    bag.write(topic, raw, stamp, raw=True, connection_header=header)
                if not times:
                    raise DemoError("%s has no message: no sensor sent any" % self._path)
                bag.write(BORDER, Bool(True), genpy.Time.from_sec(min(times).to_sec() - LEAD_S))
                bag.write(BORDER, Bool(False), genpy.Time.from_sec(max(times).to_sec() - LEAD_S))
        except (OSError, rosbag.ROSBagException) as error:
            raise DemoError("%s cannot be written: %s; make room or choose another folder with --output" %
                            (self._path, error)) from error
        finally:
            recorded.unlink()
