#!/usr/bin/python3
"""Draws architecture.png, beside itself: which service runs, in which package, and which topic goes where."""

from pathlib import Path

WIDTH, HEIGHT = 1240, 810
COLOURS = {"pi_slam": "#cfe8dc", "pi_detect": "#fbe3c8", "pi_speech": "#e4dbf2", "pi_offload": "#f6d5d5",
           "pi_vehicle": "#d6e6f5", "pi_runtime": "#eeeeee", "outside": "#ffffff"}
BOX = (150, 50)  # px
BOXES = {  # name: (left, top, what it does, package)
    "cameras": (20, 100, "left, right, 20 Hz", "outside"),
    "IMU": (20, 210, "200 Hz", "outside"),
    "microphone": (20, 440, "16 kHz, or a device", "pi_speech"),
    "vio": (300, 100, "localisation, map", "pi_slam"),
    "obstacles": (300, 220, "stereo, in space", "pi_detect"),
    "coordinator": (300, 330, "here or at a node", "pi_offload"),
    "recognizer": (300, 440, "spoken commands", "pi_speech"),
    "pose_keeper": (560, 100, "pose over crashes", "pi_vehicle"),
    "tracker": (560, 220, "follows objects", "pi_detect"),
    "ssd": (560, 330, "detector on board", "pi_detect"),
    "command": (560, 440, "words to actions", "pi_vehicle"),
    "edge servers": (300, 570, "along the road", "pi_offload"),
    "navigation": (790, 100, "path, speed, stops", "pi_vehicle"),
    "reaction": (790, 270, "rules", "pi_vehicle"),
    "arbiter": (1060, 270, "who may move it", "pi_vehicle"),
    "chassis": (1060, 440, "serial line, watchdog", "pi_vehicle"),
    "motors": (1060, 570, "and wheel encoders", "outside"),
    "power": (560, 570, "watts, battery", "pi_vehicle"),
    "runtime": (790, 570, "cores, GPUs, deadlines", "pi_runtime"),
}
# name -> name: corners on the way, label and where it stands. Sides: l, r, t, b with an offset from their middle.
ARROWS = [
    ("cameras", "r", -10, "vio", "l", -10, [], "left, right/…", (195, 106)),
    ("cameras", "r", 10, "obstacles", "l", -10, [(235, 135), (235, 235)], "", None),
    ("cameras", "r", 10, "coordinator", "l", 0, [(235, 135), (235, 355)], "left/image_raw", (130, 350)),
    ("IMU", "r", 0, "vio", "l", 12, [(205, 235), (205, 137)], "imu/data", (176, 254)),
    ("microphone", "r", 0, "recognizer", "l", 0, [], "audio_stamped", (178, 457)),
    ("vio", "r", -10, "pose_keeper", "l", -10, [], "odometry, tf", (456, 108)),
    ("vio", "t", 30, "navigation", "t", -30, [(405, 70), (835, 70)], "odometry, tf (map, odom, base_link)", (530, 64)),
    ("pose_keeper", "l", 12, "vio", "r", 12, [], "initialpose", (456, 152)),
    ("pose_keeper", "r", 0, "navigation", "l", 0, [], "localisation", (714, 119)),
    ("tracker", "l", 0, "obstacles", "r", 0, [], "tracks", (480, 239)),
    ("coordinator", "r", -12, "tracker", "b", 0, [(510, 343), (510, 300), (635, 300)], "detections", (520, 294)),
    ("coordinator", "r", 12, "ssd", "l", 12, [], "local/…", (470, 382)),
    ("coordinator", "l", 14, "edge servers", "l", 0, [(262, 369), (262, 595)], "pictures, utterances", (118, 600)),
    ("recognizer", "t", 0, "coordinator", "b", 0, [], "recognize_utterance", (384, 414)),
    ("recognizer", "r", 0, "command", "l", 0, [], "command", (472, 457)),
    ("obstacles", "t", 0, "navigation", "b", 0, [(375, 190), (865, 190)], "obstacles", (620, 184)),
    ("obstacles", "t", 0, "reaction", "l", 0, [(375, 190), (755, 190), (755, 295)], "", None),
    ("navigation", "r", 0, "arbiter", "t", 0, [(1135, 125)], "motion/navigation", (960, 118)),
    ("reaction", "r", -4, "arbiter", "l", -4, [], "motion/reaction", (944, 286)),
    ("command", "r", 0, "arbiter", "l", 14, [(1000, 465), (1000, 309)], "motion/command", (800, 457)),
    ("arbiter", "b", 0, "chassis", "t", 0, [], "motion", (1142, 390)),
    ("chassis", "b", 0, "motors", "t", 0, [], "frames with CRC", (1022, 535)),
]


def anchor(name, side, offset):
    left, top = BOXES[name][:2]
    width, height = BOX
    return {"l": (left, top + height / 2 + offset), "r": (left + width, top + height / 2 + offset),
            "t": (left + width / 2 + offset, top), "b": (left + width / 2 + offset, top + height)}[side]


def draw(path):
    import matplotlib
    matplotlib.use("Agg")
    from matplotlib import pyplot
    from matplotlib.patches import FancyBboxPatch
    figure = pyplot.figure(figsize=(WIDTH / 100, HEIGHT / 100))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, WIDTH), ylim=(HEIGHT, 0))
    axes.set_axis_off()

    def text(x, y, words, size, **more):
        axes.text(x, y, words, fontsize=size * 0.72, **more)  # points by pixels

    for x, words in ((20, "sensing"), (300, "perception"), (790, "decision"), (1060, "execution")):
        text(x, 34, words, 18, weight="bold", color="#555555")
    for begin, side, offset, end, other, shift, corners, label, place in ARROWS:
        points = [anchor(begin, side, offset), *corners, anchor(end, other, shift)]
        axes.plot(*zip(*points), color="#555555", linewidth=1.2)
        axes.annotate("", points[-1], points[-2], arrowprops={"arrowstyle": "-|>", "color": "#555555", "shrinkA": 0,
                                                              "shrinkB": 0})
        if place:
            text(*place, label, 12, color="#1f5f8a", bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5})
    for name, (left, top, what, package) in BOXES.items():
        axes.add_patch(FancyBboxPatch((left, top), *BOX, boxstyle="round,pad=0,rounding_size=6", zorder=3,
                                      facecolor=COLOURS[package], edgecolor="#777777",
                                      linestyle="--" if package == "outside" else "-"))
        text(left + BOX[0] / 2, top + 20, name, 15, weight="bold", ha="center", zorder=4)
        text(left + BOX[0] / 2, top + 40, what, 12, ha="center", color="#555555", zorder=4)
    for column, package in enumerate(COLOURS):
        axes.add_patch(FancyBboxPatch((20 + 150 * column, 672), 18, 18, boxstyle="round,pad=0,rounding_size=3",
                                      facecolor=COLOURS[package], edgecolor="#777777"))
        text(45 + 150 * column, 686, "hardware" if package == "outside" else package, 13)
    for row, words in enumerate((
            "Blue: topics and services of ROS. Topics between nodes with libpi_os_transport.so (pi_os_transport) go "
            "through shared memory on one device,",
            "and once per device over the network with pi_os_bridge. Each service is a process of its own, or all are "
            "nodelets of one (together:=true).",
            "chassis also publishes vehicle_state, wheel_odometry and battery for arbiter, navigation, power, "
            "pose_keeper and coordinator. Detection and",
            "speech run as tasks of pi_runtime. All nodes publish diagnostics for diagnostic_aggregator.")):
        text(20, 724 + 22 * row, words, 13, color="#444444")
    figure.savefig(path, dpi=130)


if __name__ == "__main__":
    draw(Path(__file__).with_name("architecture.png"))
