"""Pictures of a drive: the way, speed over time, CPU by service."""

import math

from .cpu import group_of
from .judge import read_log

COLOURS = {"true": "#222222", "estimated": "#1f8a70", "route": "#8ab6d6", "actor": "#bd4b4b", "stand": "#d98324",
           "spoken": "#6a51a3"}
ACTOR_EVERY = 10  # of 20 Hz


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
    return paths


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
        axes.annotate(name, places[0], color=COLOURS["actor"], fontsize=9)
    for one in tree["standstills"]:
        axes.plot(*one["pose"][:2], "s", color=COLOURS["stand"], markersize=9)
        axes.annotate(" %.0f s" % one["seconds"], one["pose"][:2], color=COLOURS["stand"], fontsize=9)
    for one in tree["collisions"]:
        place = min(states, key=lambda state: abs(state["t"] - one["t"]))["pose"]
        axes.plot(*place[:2], "X", color="red", markersize=13, label="collision")
    for node in drive.facts.get("edge_nodes", []):
        axes.plot(*node["position"], "^", color=COLOURS["spoken"], markersize=9)
        axes.annotate(" edge " + node["id"], node["position"], color=COLOURS["spoken"], fontsize=9)
    axes.set(xlabel="x in the map [m]", ylabel="y in the map [m]")
    axes.set_aspect("equal")
    axes.grid(alpha=0.3)
    axes.legend(frameon=False)


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
    axes.legend(loc="upper left", frameon=False)


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
