"""One run of drive.launch and what was seen of it."""

import json
import shutil
import time
from pathlib import Path

from first_drive import measuring
from first_drive.errors import DemoError

IMAGE_TOPIC = "/left/image_raw"
RECORD_RESERVE_BYTES = 2 ** 30  # rosbag record stops writing when less than this is free (--min-space)


class Drive:
    """What is to be driven and, after run(), the figures of it.

    name: for file names; title: for the report; preload: path of the library or None."""

    def __init__(self, name, title, preload, output):
        self.name = name
        self.title = title
        self.preload = preload
        self.output = output
        self.bag = output / ("drive_%s.bag" % name)
        self.recorded = {}  # messages by topic in the bag that is played
        self.published = {}
        self.lateness = {}
        self.monitor = {}
        self.links = []
        self.cpu_s = {}
        self.memory = {}
        self.played_s = 0.0
        self.pictures = []
        self.bag_counts = {}
        self.peer = {}

    def run(self, processes, events, screen, played, launch_argument, pictures_before_shot):
        """Starts the nodes, follows them to the end of the recording and ends them.
        @param played  the bag, and launch_argument  its argument of drive.launch.
        @param pictures_before_shot messages of the left camera after which the screen is shot.
        @throws DemoError."""
        peer_report = self.output / ("rospy_peer_%s.json" % self.name)
        monitor_report = self.output / ("monitor_%s.json" % self.name)
        log = self.output / "log" / ("roslaunch_%s.log" % self.name)
        for old in (self.bag, Path(str(self.bag) + ".active"), peer_report, monitor_report, log):
            old.unlink(missing_ok=True)
        if shutil.disk_usage(self.output).free < RECORD_RESERVE_BYTES:
            raise DemoError("%s has less than 1 GB of free space, where rosbag record stops recording; make room or "
                            "choose another folder with --output" % self.output)
        self.recorded = measuring.read_bag(played, processes.environment)
        print("  starting the nodes")
        launch = processes.launch(
            ["pi_bringup", "drive.launch", "%s:=%s" % (launch_argument, played), "preload:=%s" % (self.preload or ""),
             "record:=%s" % self.bag, "report:=%s" % monitor_report, "peer_report:=%s" % peer_report,
             "rviz_display:=" + screen.rviz_display, "view_display:=" + screen.view_display,
             "exit_when_done:=false", "table:=false", "measure:=true", "tcp_nodelay:=true"], log)
        try:
            self._follow(launch, processes.environment["ROS_MASTER_URI"], events, screen, pictures_before_shot)
        finally:
            processes.stop(launch)
        self.bag_counts = measuring.read_bag(self.bag, processes.environment)
        if peer_report.exists():
            self.peer = json.loads(peer_report.read_text())

    def _follow(self, launch, master_uri, events, screen, pictures_before_shot):
        events.follow(launch)
        events.next(lambda kind, event: kind == "player" and event["state"] == "playing",
                    "the player to find its subscribers")
        nodes = measuring.node_processes(launch.pid)
        cpu_at_start = {node: measuring.cpu_seconds(pid) for node, pid in nodes.items()}
        start = time.monotonic()
        print("  playing")

        def is_finished(kind, event):
            return kind == "player" and event["state"] == "finished"

        def enough_pictures(kind, event):
            return kind == "monitor" and event["topics"].get(IMAGE_TOPIC, {}).get("messages", 0) >= pictures_before_shot

        kind, finished = events.next(lambda kind, event: is_finished(kind, event) or enough_pictures(kind, event),
                                     "pictures to arrive")
        self.links = measuring.all_links(master_uri)
        self.memory = {node: measuring.memory_mb(pid) for node, pid in nodes.items()}
        self.pictures = screen.shoot(self.name)
        if not is_finished(kind, finished):
            _, finished = events.next(is_finished, "the recording to end")
        self.played_s = time.monotonic() - start
        self.published = finished["published"]
        self.lateness = finished["lateness_ms"]

        # What is still under way has arrived once the monitor has everything, or nothing new between two reports.
        counts, previous = None, {}
        while counts != self.published and counts != previous:
            previous = counts
            _, self.monitor = events.next(lambda kind, _: kind == "monitor", "the monitor's report")
            counts = {topic: self.monitor["topics"].get(topic, {}).get("messages", 0) for topic in self.published}
        for node, pid in nodes.items():
            end = measuring.cpu_seconds(pid)
            if end is not None and cpu_at_start[node] is not None:
                self.cpu_s[node] = end - cpu_at_start[node]

    def as_dict(self):
        return {"transport": self.title, "preload": str(self.preload or ""), "played_s": self.played_s,
                "published": self.published, "lateness_ms": self.lateness, "monitor": self.monitor,
                "links": [dict(zip(("topic", "publisher", "subscriber", "transport"), link)) for link in self.links],
                "cpu_s": self.cpu_s, "memory_mb": self.memory, "bag": self.bag_counts, "rospy_peer": self.peer,
                "pictures": [path.name for path in self.pictures]}

    def failures(self):
        """What must not happen in a drive, as texts."""
        texts = []
        for topic, count in sorted(self.published.items()):
            if count != self.recorded.get(topic):
                texts.append("%s: %d in the recording, %d published" % (topic, self.recorded.get(topic, 0), count))
            recorded = self.bag_counts.get(topic, 0)
            if recorded != count:
                texts.append("%s: %d published, %d in the bag" % (topic, count, recorded))
            seen = self.monitor["topics"].get(topic, {}).get("messages", 0)
            if seen != count:
                texts.append("%s: %d published, %d seen by the monitor" % (topic, count, seen))
        if self.preload and not any(link[3] == "SHMROS" for link in self.links):
            texts.append("no link used shared memory although %s was preloaded" % self.preload)
        return texts
