"""Pictures of a drive: the way, speed over time."""

import math

from .judge import read_log

COLOURS = {"true": "#222222", "estimated": "#1f8a70", "route": "#8ab6d6", "actor": "#bd4b4b", "stand": "#d98324",
            "spoken": "#6a51a3", "remote": "#8ab6d6", "local": "#1f8a70", "fallback": "#d98324",
           "abandoned": "#bd4b4b"}
DETECTED = {"person": "#ff7f50", "car": "#66c2ff"}
ACTOR_EVERY = 10  # of 20 Hz
ZOOM_S = 3.0


def draw_way(drive, tree, states, title, output):
    """Way and speed. @return paths. @throws OSError"""
    import matplotlib  # takes a second, which only the end of a drive needs
    matplotlib.use("Agg")
    from matplotlib import pyplot
    paths = []
    for name, draw_one, size in (("campus_route.png", route, route_size(states)), ("campus_speed.png", speed, (13, 5.5))):
        figure, axes = pyplot.subplots(figsize=size)
        draw_one(axes, drive, tree, states)
        figure.suptitle(title)
        figure.tight_layout()
        figure.savefig(output / name, dpi=110)
        pyplot.close(figure)
        paths.append(output / name)
    return paths


def draw(drive, tree, output):
    """@return paths. @throws OSError"""
    states = [one for one in read_log(drive.simulator_log).get("state", [])
              if drive.began - 1.0 <= one["stamp"] <= drive.ended + 1.0]
    paths = draw_way(drive, tree, states, "%s, seed %d, %s: %s" % (tree["scenario"], tree["seed"], tree["transport"],
                                                                   tree["end"]), output)
    from matplotlib import pyplot
    tasks = [one for one in drive.observer.records.decisions if drive.began <= one["stamp"] <= drive.ended]
    if tasks:
        figure, axes = pyplot.subplots(2, 1, figsize=(13, 5.5))
        figure.suptitle("%s, seed %d, %s: where the tasks were done" % (tree["scenario"], tree["seed"],
                                                                       tree["transport"]))
        gantt(axes, [{**one, "stamp": one["stamp"] - drive.began} for one in tasks], drive.ended - drive.began)
        figure.tight_layout()
        figure.savefig(output / "campus_gantt.png", dpi=110)
        pyplot.close(figure)
        paths.append(output / "campus_gantt.png")
    return paths


def gantt(every, tasks, end):
    """A bar for each task from its stamp to its answer, in the row of who gave it: the whole drive, and the seconds in
    which the place changed most. @param tasks  decisions with stamps from 0 on"""
    def row_of(one):
        return "%s on board" % one["kind"] if one["how"] in ("local", "fallback") else \
            "%s at %s" % (one["kind"], one["node"]) if one["how"] == "remote" else "%s abandoned" % one["kind"]

    rows = sorted({row_of(one) for one in tasks})
    ordered = sorted((one for one in tasks if one["kind"] == "detection"), key=lambda one: one["stamp"])
    changes = [after["stamp"] for before, after in zip(ordered, ordered[1:]) if row_of(before) != row_of(after)]
    change = max(changes, key=lambda here: sum(abs(other - here) <= ZOOM_S / 2 for other in changes), default=end / 2)
    for axes, (begin, last) in zip(every, ((0.0, end), (change - ZOOM_S / 2, change + ZOOM_S / 2))):
        for one in tasks:
            if begin <= one["stamp"] <= last:
                axes.barh(rows.index(row_of(one)), max(one["response_time"], 0.0), left=one["stamp"], height=0.6,
                          color=COLOURS[one["how"]], edgecolor="none" if last - begin > ZOOM_S else "white",
                          hatch=None if one["by_deadline"] else "//")
        axes.set_yticks(range(len(rows)))
        axes.set_yticklabels(rows)
        axes.set_ylim(len(rows) - 0.5, -0.5)
        axes.set_xlim(begin, last)
        axes.grid(axis="x", alpha=0.3)
    every[-1].set_xlabel("time [s]; bars from the exposure or the end of speech to the answer; hatched: late")
    from matplotlib.patches import Patch
    every[0].legend(handles=[Patch(color=COLOURS[how], label=text) for how, text in (
        ("remote", "at an edge node"), ("local", "on board by choice"),
        ("fallback", "on board after the node did not answer in time"))], ncol=3, frameon=False, loc="lower left",
        bbox_to_anchor=(0.0, 1.0))


def route_size(states):
    """Of the picture [inch]: as wide and high as the way, within bounds."""
    spans = [max(values) - min(values) for values in zip(*(one["pose"][:2] for one in states))] or [1.0, 1.0]
    return 11, min(max(11.0 * (spans[1] + 4.0) / (spans[0] + 4.0), 3.5), 9.0)


class Labels:
    """Texts beside places in a plot, none of which covers another, or a mark."""

    MARK_PX = 5.0
    OFFSETS = [(8, 8), (8, -16), (8, 24), (8, -32), (8, 40), (8, -48), (-60, 8), (-60, -16), (-60, 40), (-60, -48)]
    ABOVE = [(0, 4 + 14 * step) for step in range(6)]

    def __init__(self, axes, offsets=None):
        self._axes = axes
        self._taken = []
        self._offsets = offsets or self.OFFSETS

    def keep_clear(self, places):
        """No text covers the marks at these places."""
        from matplotlib.transforms import Bbox
        for x, y in self._axes.transData.transform(places) if len(places) else []:
            self._taken.append(Bbox.from_extents(x - self.MARK_PX, y - self.MARK_PX, x + self.MARK_PX, y + self.MARK_PX))

    def add(self, text, place, colour, **style):
        renderer = self._axes.figure.canvas.get_renderer()
        for offset in self._offsets:
            label = self._axes.annotate(text, place, xytext=offset, textcoords="offset points", color=colour,
                                        **{"fontsize": 9, **style})
            box = label.get_window_extent(renderer)
            if not any(box.overlaps(other) for other in self._taken):
                break
            if offset != self._offsets[-1]:
                label.remove()
        self._taken.append(box)


def actor_places(states):
    """{actor: places in the map}, where it was the nearest."""
    places = {}
    for state in states[::ACTOR_EVERY]:
        one = state.get("nearest_actor")
        if one:
            x, y, heading = state["pose"]
            cosine, sine = math.cos(heading), math.sin(heading)
            px, py = one["position"]
            places.setdefault(one["actor"], []).append((x + cosine * px - sine * py, y + sine * px + cosine * py))
    return places


def route(axes, drive, tree, states):
    """@param states  with stamp, t, pose, speed: of the simulator, or as measured (tree["measured"])"""
    goal = [drive.facts["goal"]] if "goal" in drive.facts else []  # an incident may have none
    points = drive.facts["waypoints"] + goal + drive.facts["further_goals"]
    axes.plot([one[0] for one in points], [one[1] for one in points], "o--", color=COLOURS["route"], label="waypoints")
    axes.plot([one["pose"][0] for one in states], [one["pose"][1] for one in states], color=COLOURS["true"],
              linewidth=2.5, label="path" if tree.get("measured") else "true path")
    estimates = [one for one in drive.observer.records.estimates if drive.began <= one[0] <= drive.ended]
    if not tree.get("measured"):
        axes.plot([one[1] for one in estimates], [one[2] for one in estimates], color=COLOURS["estimated"],
                  linewidth=1.2, label="estimated path")
    places = actor_places(states)
    for spots in places.values():
        axes.plot([one[0] for one in spots], [one[1] for one in spots], ".", color=COLOURS["actor"], markersize=4)
    for one in tree["standstills"]:
        axes.plot(*one["pose"][:2], "s", color=COLOURS["stand"], markersize=9)
    collisions = [min(states, key=lambda state: abs(state["t"] - one["t"]))["pose"][:2] for one in tree["collisions"]]
    for place in collisions:
        axes.plot(*place, "X", color="red", markersize=13)
    nodes = drive.facts.get("edge_nodes", [])
    for node in nodes:
        axes.plot(*node["position"], "^", color=COLOURS["spoken"], markersize=9)
    axes.set(xlabel="x in the map [m]", ylabel="y in the map [m]")
    axes.margins(x=0.06, y=0.15)
    axes.set_aspect("equal", adjustable="datalim")
    axes.grid(alpha=0.3)
    axes.legend(frameon=False, ncol=3, loc="lower left", bbox_to_anchor=(0.0, 1.0))
    axes.figure.tight_layout()
    labels = Labels(axes)  # last: where they are depends on all before
    labels.keep_clear([one[:2] for one in points] + [one["position"][:2] for one in nodes])
    for place in collisions:
        labels.add("collision", place, "red")
    for one in tree["standstills"]:
        labels.add("stood %.0f s" % one["seconds"], one["pose"][:2], COLOURS["stand"])
    for name, spots in places.items():
        labels.add(name, spots[0], COLOURS["actor"])
    for node in nodes:
        labels.add("edge " + node["id"], node["position"], COLOURS["spoken"])


def speed(axes, drive, tree, states):
    begin = drive.began
    axes.plot([one["stamp"] - begin for one in states], [one["speed"] for one in states], color=COLOURS["true"],
              label="measured speed" if tree.get("measured") else "true speed")
    motions = [one for one in drive.observer.records.motions if drive.began - 1.0 <= one[0] <= drive.ended + 1.0]
    axes.plot([one[0] - begin for one in motions], [one[2] for one in motions], color=COLOURS["estimated"],
              linewidth=0.9, label="commanded by the arbiter")
    near = [(one["stamp"] - begin, one["nearest_actor"]["distance"]) for one in states if one.get("nearest_actor")]
    top = axes.twinx()
    top.plot([one[0] for one in near], [one[1] for one in near], ".", markersize=1.5, color=COLOURS["actor"])
    top.set_ylabel("distance of the nearest %s [m]" % ("obstacle" if tree.get("measured") else "actor"),
                   color=COLOURS["actor"])
    top.set_ylim(0, 30)
    for sound, text in zip(tree["played"], tree["said"]):
        axes.axvspan(sound["begin"] - begin, sound["speech_end"] - begin, color=COLOURS["spoken"], alpha=0.4)
        axes.annotate("\"%s\"" % text, (sound["speech_end"] - begin, 3.05), color=COLOURS["spoken"], fontsize=9)
    for one in tree["commands"]:
        if one["accepted"]:
            axes.axvline(one["arrival"] - begin, color=COLOURS["spoken"], linestyle=":", linewidth=1)
    for one in tree["triggers"]:
        if one["stamp"] < begin:
            continue  # it goes from the start of the world on
        axes.axvline(one["stamp"] - begin, color=COLOURS["actor"], linestyle="--", linewidth=0.8)
        axes.annotate(" %s goes" % one["actor"], (one["stamp"] - begin, 0.1), color=COLOURS["actor"], fontsize=8)
    for one in tree.get("incidents", []):
        axes.axvline(one["stamp"] - begin, color="red", linewidth=1)
        axes.annotate(" " + one["cause"], (one["stamp"] - begin, 1.5), color="red", fontsize=8, rotation=90)
    for kill in tree["kills"]:
        axes.axvline(kill["time"] - begin, color="red", linewidth=1)
        axes.annotate(" %s killed" % kill["node"], (kill["time"] - begin, 1.5), color="red", fontsize=8, rotation=90)
    axes.set(xlabel="time [s]", ylabel="speed [m/s]", xlim=(-1.0, drive.ended - begin + 1.0),
             ylim=(-0.2, 3.3))
    axes.grid(alpha=0.3)
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncol=2, frameon=False)


def detections(path, found):
    """Pictures beside each other with what was detected. @param found  [(seconds, sensor_msgs/Image, boxes)], as of
    pictures.SeenPeople. @throws OSError"""
    import matplotlib
    matplotlib.use("Agg")
    import numpy
    from matplotlib import pyplot
    figure, every = pyplot.subplots(1, len(found), figsize=(6.4 * len(found), 5.3), squeeze=False)
    for axes, (after, picture, boxes) in zip(every[0], found):
        rows = numpy.frombuffer(picture.data, numpy.uint8).reshape(picture.height, picture.step)
        if picture.encoding == "mono8":
            axes.imshow(rows[:, :picture.width], cmap="gray", vmin=0, vmax=255)
        else:  # bgr8
            axes.imshow(rows[:, :3 * picture.width].reshape(picture.height, picture.width, 3)[:, :, ::-1])
        axes.set_title("%.1f s" % after)
        axes.set_axis_off()
    figure.tight_layout()
    for axes, (_, _, boxes) in zip(every[0], found):
        labels = Labels(axes, Labels.ABOVE)
        for name, score, left, top, width, height in sorted(boxes, key=lambda box: -box[3]):
            colour = DETECTED.get(name, "#ffd92f")
            axes.add_patch(pyplot.Rectangle((left, top), width, height, fill=False, edgecolor=colour, linewidth=2))
            labels.add("%s %.2f" % (name, score), (left, top), "black", fontsize=10,
                       bbox={"facecolor": colour, "edgecolor": "none", "pad": 1})
    figure.savefig(path, dpi=80)
    pyplot.close(figure)
