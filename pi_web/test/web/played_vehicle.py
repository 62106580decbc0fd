"""A vehicle that stands at one place of a map, as messages: everything that the page shows."""

import math
import threading

import numpy
import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point32, PoseStamped, TransformStamped
from nav_msgs.msg import OccupancyGrid, Odometry, Path
from pi_detect.msg import Obstacle3D, ObstacleArray, Track2D, Track2DArray
from pi_vehicle.msg import ArbiterState, LocalisationState, PowerState, ServicePower, VehicleState
from sensor_msgs.msg import CameraInfo, Image
from tf2_msgs.msg import TFMessage

WIDTH, HEIGHT = 640, 480
ODOM_IN_MAP = (10.0, 5.0, math.radians(30))
BASE_IN_ODOM = (4.0, 1.0, math.radians(15))
CAMERA = (0.5, 1.0)  # x and z in base_link
FOCAL_PX = 400.0
BOX = (200.0, 150.0, 80.0, 160.0)  # left, top, width, height of the person in the picture


def compose(a, b):
    c, s = math.cos(a[2]), math.sin(a[2])
    return a[0] + c * b[0] - s * b[1], a[1] + s * b[0] + c * b[1], a[2] + b[2]


BASE_IN_MAP = compose(ODOM_IN_MAP, BASE_IN_ODOM)


def set_pose(pose, x, y, yaw):
    pose.position.x, pose.position.y = x, y
    pose.orientation.z, pose.orientation.w = math.sin(yaw / 2), math.cos(yaw / 2)


def transform(parent, child, x, y, yaw):
    result = TransformStamped()
    result.header.stamp, result.header.frame_id, result.child_frame_id = rospy.Time.now(), parent, child
    result.transform.translation.x, result.transform.translation.y = x, y
    result.transform.rotation.z, result.transform.rotation.w = math.sin(yaw / 2), math.cos(yaw / 2)
    return result


def camera_in_base(x, z):
    """The transform of a camera that looks ahead."""
    result = transform("base_link", "left_optical", x, 0, 0)
    result.transform.translation.z = z
    q = result.transform.rotation
    q.x, q.y, q.z, q.w = -0.5, 0.5, -0.5, 0.5
    return result


def camera_info():
    info = CameraInfo(width=WIDTH, height=HEIGHT, distortion_model="plumb_bob", D=[0.0] * 5)
    info.K = [FOCAL_PX, 0, WIDTH / 2, 0, FOCAL_PX, HEIGHT / 2, 0, 0, 1]
    return info


def obstacle(number, label, x, y, size, velocity=(0.0, 0.0)):
    result = Obstacle3D(id=number, label=label, moving=velocity != (0.0, 0.0))
    result.position.x, result.position.y = x, y
    result.size.x, result.size.y, result.size.z = size[0], size[1], 1.7
    result.velocity.x, result.velocity.y = velocity
    corners = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
    result.outline = [Point32(x + a * size[0] / 2, y + b * size[1] / 2, 0) for a, b in corners]
    return result


def scene():
    """A grey picture with something like a street: what the boxes lie on is known."""
    rows = numpy.linspace(200, 90, HEIGHT).astype(numpy.uint8)
    pixels = numpy.repeat(rows[:, None, None], WIDTH, 1).repeat(3, 2).copy()
    pixels[HEIGHT // 2:, :, :] = (95, 98, 100)
    return Image(height=HEIGHT, width=WIDTH, encoding="bgr8", step=3 * WIDTH, data=pixels.tobytes())


class PlayedVehicle:
    """Publishes 10 times per second, from a thread, until stop()."""

    def __init__(self, picture=None):
        self.reason = "a person is 4 m ahead"
        self._picture = picture or scene()
        types = {"/left/camera_info": CameraInfo, "/tf": TFMessage, "/odometry": Odometry, "/obstacles": ObstacleArray, "/tracks": Track2DArray,
                 "/left/image_raw": Image, "/vehicle_state": VehicleState, "/arbiter/state": ArbiterState,
                 "/power": PowerState, "/diagnostics_agg": DiagnosticArray, "/localisation": LocalisationState}
        latched = {"/tf_static": TFMessage, "/route": Path, "/path": Path, "/map": OccupancyGrid}
        self._out = {topic: rospy.Publisher(topic, kind, queue_size=3) for topic, kind in types.items()}
        self._out.update({topic: rospy.Publisher(topic, kind, queue_size=1, latch=True)
                          for topic, kind in latched.items()})
        self._once()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def stop(self):
        self._stop.set()
        self._thread.join()
        for publisher in self._out.values():
            publisher.unregister()

    def _run(self):
        while not self._stop.wait(0.1):
            self._publish()

    def _once(self):
        self._out["/tf_static"].publish(TFMessage([camera_in_base(*CAMERA)]))
        for topic, points in (("/route", [(0, 0), (6, 0.2), (12, 2), (20, 6)]),
                              ("/path", [(-12, -4), (-5, -1), (0, 0)])):
            path = Path()
            path.header.frame_id = "map"
            for x, y in points:
                pose = PoseStamped()
                set_pose(pose.pose, *compose(BASE_IN_MAP, (x, y, 0)))
                path.poses.append(pose)
            self._out[topic].publish(path)
        grid = OccupancyGrid()
        grid.header.frame_id = "map"
        grid.info.resolution, grid.info.width, grid.info.height = 0.5, 120, 100
        grid.info.origin.position.x, grid.info.origin.position.y = -15, -18
        grid.info.origin.orientation.w = 1
        cells = numpy.full((100, 120), -1, numpy.int8)
        cells[15:85, 15:105] = 0
        cells[15:18, 15:105] = 100
        cells[70:85, 60:64] = 100
        grid.data = cells.flatten().tolist()
        self._out["/map"].publish(grid)

    def _publish(self):
        now = rospy.Time.now()

        def send(topic, message, frame=""):
            message.header.stamp, message.header.frame_id = now, frame
            self._out[topic].publish(message)

        self._out["/tf"].publish(TFMessage([transform("map", "odom", *ODOM_IN_MAP)]))
        self._out["/tf"].publish(TFMessage([transform("odom", "base_link", *BASE_IN_ODOM)]))
        odometry = Odometry(child_frame_id="base_link")
        set_pose(odometry.pose.pose, *BASE_IN_ODOM)
        send("/odometry", odometry, "odom")
        send("/obstacles", ObstacleArray(obstacles=[
            obstacle(1, "person", 5.0, 0.6, (0.5, 0.6), (0.0, -1.2)), obstacle(2, "car", 9.0, 4.0, (4.2, 1.8)),
            obstacle(3, "", 7.0, -3.0, (0.8, 0.8))]), "base_link")
        tracks = Track2DArray(tracks=[Track2D(id=1, label="person", score=0.87),
                                      Track2D(id=2, label="car", score=0.64)])
        for track, (left, top, width, height) in zip(tracks.tracks, (BOX, (420, 220, 180, 90))):
            track.bbox.center.x, track.bbox.center.y = left + width / 2, top + height / 2
            track.bbox.size_x, track.bbox.size_y = width, height
        send("/left/image_raw", self._picture, "left_optical")
        send("/left/camera_info", camera_info(), "left_optical")
        send("/tracks", tracks, "left_optical")
        send("/vehicle_state", VehicleState(speed=0.0, mode=VehicleState.READY, detail="ready", odometer=125.4,
                                            battery_charge=0.76), "base_link")
        send("/arbiter/state", ArbiterState(driver="navigation", limited_by="reaction", reason=self.reason))
        send("/localisation", LocalisationState(valid=True), "map")
        services = [ServicePower(name=name, running=True, cpu=cpu, memory=memory, watts=watts) for name, cpu, memory, watts
                    in (("localisation", 0.25, 61e6, 0.7), ("detection", 0.55, 88e6, 1.4), ("speech", 0.06, 35e6, 0.2))]
        send("/power", PowerState(cpu=1.11, cores=4, total_watts=6.0, battery_charge=0.76, remaining_time=8000,
                                  services=services))
        send("/diagnostics_agg", DiagnosticArray(status=[
            DiagnosticStatus(level=0, name="/Vehicle/Chassis/chassis", message="connected"),
            DiagnosticStatus(level=0, name="/Vehicle/Speech/recognition", message="listens",
                             values=[KeyValue(key="last command", value="stop (0.91)")]),
            DiagnosticStatus(level=0, name="/Vehicle/Speech/sound", message="comes",
                             values=[KeyValue(key="level [dB of full scale]", value="-31.8")]),
            DiagnosticStatus(level=1, name="/Vehicle/Localisation/odometry", message="few features: 23 of 120")]))
