"""Pictures of a drive: the way, speed over time, CPU by service."""

import math

from .cpu import group_of
from .judge import read_log

COLOURS = {"true": "#222222", "estimated": "#1f8a70", "route": "#8ab6d6", "actor": "#bd4b4b", "stand": "#d98324",
            "spoken": "#6a51a3", "remote": "#8ab6d6", "local": "#1f8a70", "fallback": "#d98324",
           "abandoned": "#bd4b4b"}
DETECTED = {"person": "#ff7f50", "car": "#66c2ff"}
ACTOR_EVERY = 10  # of 20 Hz
ZOOM_S = 3.0


def draw(drive, tree, output):
    """@return paths. @throws OSError"""
    import matplotlib  # takes a second, which only the end of a drive needs
    matplotlib.use("Agg")
    from matplotlib import pyplot
    states = [one for one in read_log(drive.simulator_log).get("state", [])
              if drive.began - 1.0 <= one["stamp"] <= drive.ended + 1.0]
    paths = []
    for name, draw_one, size in (("campus_route.png", route, (11, 8.5)), ("campus_speed.png", speed, (13, 5.5)),
                                 ("campus_cpu.png", cpu, (9, 5.5))):
        figure, axes = pyplot.subplots(figsize=size)
        draw_one(axes, drive, tree, states)
        figure.suptitle("%s, seed %d, %s: %s" % (tree["scenario"], tree["seed"], tree["transport"], tree["end"]))
        figure.tight_layout()
        figure.savefig(output / name, dpi=110)
        pyplot.close(figure)
        paths.append(output / name)
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


def beside(trees, titles, path):
    """Latencies of topics and processor time of nodes of drives beside each other. @throws OSError"""
    import matplotlib
    matplotlib.use("Agg")
    from matplotlib import pyplot
    topics = [topic for topic in sorted(trees[0]["topics"])
              if all(((tree["topics"].get(topic) or {}).get("latency_ms") or {}).get("p50", 0) > 0 for tree in trees)]
    nodes = sorted({node for tree in trees for node in tree["cpu_cores"].get("vehicle", {})},
                   key=lambda node: -trees[0]["cpu_cores"]["vehicle"].get(node, 0.0))
    figure, (left, right) = pyplot.subplots(1, 2, figsize=(13, 6), gridspec_kw={"width_ratios": [3, 2]})
    height = 0.8 / len(trees)
    for index, (tree, title, colour) in enumerate(zip(trees, titles, (COLOURS["estimated"], COLOURS["actor"]))):
        offset = (index - (len(trees) - 1) / 2) * height
        figures = [tree["topics"][topic]["latency_ms"] for topic in topics]
        left.barh([row + offset for row in range(len(topics))], [one["p50"] for one in figures], height * 0.9,
                  color=colour, label=title + ", p50")
        left.plot([one["p99"] for one in figures], [row + offset for row in range(len(topics))], "|", markersize=14,
                  markeredgewidth=2, color=colour, label="p99")
        right.barh([row + offset for row in range(len(nodes))],
                   [100 * tree["cpu_cores"]["vehicle"].get(node, 0.0) for node in nodes], height * 0.9, color=colour,
                   label="%s: %.0f %% in all" % (title, 100 * tree["vehicle_cores"]))
    left.set_xscale("log")
    for axes, names, label in ((left, topics, "from the stamp to arrival [ms]; pictures: from the exposure"),
                               (right, nodes, "processor in % of one core")):
        axes.set_yticks(range(len(names)))
        axes.set_yticklabels(names)
        axes.invert_yaxis()
        axes.set_xlabel(label)
        axes.grid(axis="x", which="both", alpha=0.3)
        axes.legend(frameon=False, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncol=2)
    figure.tight_layout()
    figure.savefig(path, dpi=110)
    pyplot.close(figure)


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
    points = drive.facts["waypoints"] + [drive.facts["goal"]]
    axes.plot([one[0] for one in points], [one[1] for one in points], "o--", color=COLOURS["route"], label="waypoints")
    axes.plot([one["pose"][0] for one in states], [one["pose"][1] for one in states], color=COLOURS["true"],
              linewidth=2.5, label="true path")
    estimates = [one for one in drive.observer.records.estimates if drive.began <= one[0] <= drive.ended]
    axes.plot([one[1] for one in estimates], [one[2] for one in estimates], color=COLOURS["estimated"],
              linewidth=1.2, label="estimated path")
    for name, places in actor_places(states).items():
        axes.plot([one[0] for one in places], [one[1] for one in places], ".", color=COLOURS["actor"], markersize=4)
        axes.annotate(name, places[0], xytext=(4, -13), textcoords="offset points", color=COLOURS["actor"], fontsize=9)
    for one in tree["standstills"]:
        axes.plot(*one["pose"][:2], "s", color=COLOURS["stand"], markersize=9)
        axes.annotate("stood %.0f s" % one["seconds"], one["pose"][:2], xytext=(9, 9), textcoords="offset points",
                      color=COLOURS["stand"], fontsize=9)
    for one in tree["collisions"]:
        place = min(states, key=lambda state: abs(state["t"] - one["t"]))["pose"]
        axes.plot(*place[:2], "X", color="red", markersize=13, label="collision")
    for node in drive.facts.get("edge_nodes", []):
        axes.plot(*node["position"], "^", color=COLOURS["spoken"], markersize=9)
        axes.annotate(" edge " + node["id"], node["position"], color=COLOURS["spoken"], fontsize=9)
    axes.set(xlabel="x in the map [m]", ylabel="y in the map [m]")
    axes.margins(x=0.12)
    axes.set_aspect("equal")
    axes.grid(alpha=0.3)
    axes.legend(frameon=False, loc="center left")


def speed(axes, drive, tree, states):
    begin = drive.began
    axes.plot([one["stamp"] - begin for one in states], [one["speed"] for one in states], color=COLOURS["true"],
              label="true speed")
    motions = [one for one in drive.observer.records.motions if drive.began - 1.0 <= one[0] <= drive.ended + 1.0]
    axes.plot([one[0] - begin for one in motions], [one[2] for one in motions], color=COLOURS["estimated"],
              linewidth=0.9, label="commanded by the arbiter")
    near = [(one["stamp"] - begin, one["nearest_actor"]["distance"]) for one in states if one.get("nearest_actor")]
    top = axes.twinx()
    top.plot([one[0] for one in near], [one[1] for one in near], ".", markersize=1.5, color=COLOURS["actor"])
    top.set_ylabel("distance of the nearest actor [m]", color=COLOURS["actor"])
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
    for kill in tree["kills"]:
        axes.axvline(kill["time"] - begin, color="red", linewidth=1)
        axes.annotate(" %s killed" % kill["node"], (kill["time"] - begin, 1.5), color="red", fontsize=8, rotation=90)
    axes.set(xlabel="time [s]", ylabel="speed [m/s]", xlim=(-1.0, drive.ended - begin + 1.0),
             ylim=(-0.2, 3.3))
    axes.grid(alpha=0.3)
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncol=2, frameon=False)


def cpu(axes, drive, tree, _):
    edge_names = [node["id"] for node in drive.facts.get("edge_nodes", [])]
    rows = sorted(((group_of(node, edge_names) != "vehicle", -cores, node, group)
                   for group, nodes in tree["cpu_cores"].items() for node, cores in nodes.items()))
    names = [row[2] for row in rows]
    axes.barh(range(len(rows)), [-100 * row[1] for row in rows],
              color=["#aaaaaa" if row[0] else COLOURS["estimated"] for row in rows])
    axes.set_yticks(range(len(rows)))
    axes.set_yticklabels(names)
    axes.invert_yaxis()
    for index, row in enumerate(rows):
        axes.annotate(" %.0f" % (-100 * row[1]), (-100 * row[1], index), va="center", fontsize=8)
    axes.set_xlabel("CPU in %% of one core; grey: not of the vehicle; vehicle %.0f %%" % (100 * tree["vehicle_cores"]))
    axes.grid(axis="x", alpha=0.3)


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
        else:  # bgr8, the simulator's other one
            axes.imshow(rows[:, :3 * picture.width].reshape(picture.height, picture.width, 3)[:, :, ::-1])
        for name, score, left, top, width, height in boxes:
            colour = DETECTED.get(name, "#ffd92f")
            axes.add_patch(pyplot.Rectangle((left, top), width, height, fill=False, edgecolor=colour, linewidth=2))
            axes.text(left, top - 4, "%s %.2f" % (name, score), color="black", fontsize=10,
                      bbox={"facecolor": colour, "edgecolor": "none", "pad": 1})
        axes.set_title("%.1f s" % after)
        axes.set_axis_off()
    figure.tight_layout()
    figure.savefig(path, dpi=80)
    pyplot.close(figure)
