"""What the vehicle made of a recording: localised, seen and heard, as lines for the terminal."""

import math


class Summary:
    """Collects while the recording plays. Callbacks come from rospy's threads, each topic from one."""

    def __init__(self):
        self.poses = 0
        self.distance_m = 0.0
        self.first_s = self.last_s = None
        self.pictures = 0
        self.seen = {}       # label id: pictures in which it was seen
        self.labels = {}     # label id: name
        self.obstacle_reports = 0
        self.with_obstacles = 0
        self.heard = []      # (time, text, confidence)
        self._place = None

    def on_odometry(self, message):
        stamp, p = message.header.stamp.to_sec(), message.pose.pose.position
        place = (p.x, p.y, p.z)
        if self._place is not None:
            self.distance_m += math.dist(self._place, place)
        self._place = place
        self.first_s = stamp if self.first_s is None else self.first_s
        self.last_s = stamp
        self.poses += 1

    def on_labels(self, message):
        self.labels = dict(zip(message.ids, message.names))

    def on_detections(self, message):
        self.pictures += 1
        for label in {one.results[0].id for one in message.detections if one.results}:
            self.seen[label] = self.seen.get(label, 0) + 1

    def on_obstacles(self, message):
        self.obstacle_reports += 1
        self.with_obstacles += bool(message.obstacles)

    def on_command(self, message):
        self.heard.append((message.header.stamp.to_sec(), message.text, message.confidence))

    def lines(self):
        """One line for each service."""
        if self.poses:
            localised = "%d poses over %.1f s, a way of %.1f m" % (self.poses, self.last_s - self.first_s,
                                                                  self.distance_m)
        else:
            localised = "no pose: is imu/data in the recording, and do the cameras see enough?"
        if self.pictures:
            seen = ["%s in %d" % (self.labels.get(label, "label %d" % label), count)
                    for label, count in sorted(self.seen.items(), key=lambda pair: (-pair[1], pair[0]))]
            seen = "%s of %d pictures" % (", ".join(seen) or "nothing known in any", self.pictures)
        else:
            seen = "no picture was looked at"
        seen += "; obstacles in %d of %d reports" % (self.with_obstacles, self.obstacle_reports)
        heard = ", ".join("\"%s\" (%.2f) at %.1f s" % (text, confidence, stamp - (self.first_s or stamp))
                          for stamp, text, confidence in self.heard) or "no command"
        return ["localised: " + localised, "seen: " + seen, "heard: " + heard]


def main():
    import rospy
    from nav_msgs.msg import Odometry
    from pi_detect.msg import Detection2DArray, LabelArray, ObstacleArray
    from pi_speech.msg import VoiceCommand
    rospy.init_node("replay_summary")
    summary = Summary()
    for topic, kind, callback in (
            ("odometry", Odometry, summary.on_odometry), ("labels", LabelArray, summary.on_labels),
            ("local/labels", LabelArray, summary.on_labels), ("detections", Detection2DArray, summary.on_detections),
            ("obstacles", ObstacleArray, summary.on_obstacles), ("command", VoiceCommand, summary.on_command)):
        rospy.Subscriber(topic, kind, callback, tcp_nodelay=True)
    # In this thread, behind spin(): what a shutdown hook prints can be cut off by the end of the process.
    rospy.spin()
    print("\n".join(["The recording:"] + ["  " + line for line in summary.lines()]), flush=True)
