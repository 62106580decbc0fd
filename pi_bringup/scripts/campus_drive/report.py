"""The report of a drive: on the terminal and as JSON."""

import json
import os

from first_drive.errors import DemoError
from first_drive.report import number, table

from . import labels, plots, unplugs
from .judge import quantile, read_log, seconds
from .sightings import sightings


def percent(cores):
    return "%.1f" % (100.0 * cores)


def services(power):
    """{service: mean cores, watts, greatest memory} of the messages of `power`."""
    result = {}
    for message in power:
        for name, one in message["services"].items():
            if one["running"]:
                entry = result.setdefault(name, {"cpu": [], "watts": [], "memory": []})
                for key in entry:
                    entry[key].append(one[key])
    return {name: {"cpu": sum(one["cpu"]) / len(one["cpu"]), "watts": sum(one["watts"]) / len(one["watts"]),
                   "memory_mb": max((value for value in one["memory"] if value == value), default=None)}
            for name, one in result.items()}


def camera_figures(statuses):
    return statuses.get("vehicle_simulator: cameras", (None, "", {}))[2]


def network(statuses):
    """The vehicle's detector, and why it stands in for another one; None if it did not say."""
    values = statuses.get("ssd: detection", (None, "", {}))[2]
    return values.get("stands in") or values.get("model") or None


def pairs_hz(pairs, begin, end):
    """Rate at which localisation used pairs of pictures, over its lives; None if it did not say.
    @param pairs  [(time, pairs so far)]"""
    said = [one for one in pairs if begin <= one[0] <= end]
    if len(said) < 2 or said[-1][0] <= said[0][0]:
        return None
    used = sum(after[1] - before[1] if after[1] >= before[1] else after[1] for before, after in zip(said, said[1:]))
    return used / (said[-1][0] - said[0][0])


def transports(links):
    """{transport: links}"""
    counts = {}
    for link in links:
        if "/drive_campus" not in link[1:3]:  # rospy, which knows TCPROS only
            counts[link[3]] = counts.get(link[3], 0) + 1
    return counts


def collect(drive, judged, facts):
    """All of a drive as a tree for JSON."""
    records = drive.observer.records
    states = [one for one in read_log(drive.simulator_log).get("state", [])
              if drive.began <= one["stamp"] <= drive.ended]
    return {
        "scenario": drive.scenario.name, "seed": drive.options.seed,
        "transport": "π-OS" if drive.options.preload else "TCPROS", "together": drive.options.together,
        "machine": facts, "ready_s": drive.readiness, **judged,
        "pairs_hz": pairs_hz(records.pairs, drive.began, drive.ended),
        "labels": labels.figures(states, drive.observer.reported_labels()),
        "sightings": sightings(states, drive.observer.reported_obstacles()),
        "transports": transports(drive.links),
        "links": [dict(zip(("topic", "publisher", "subscriber", "transport"), link)) for link in drive.links],
        "cameras": camera_figures(records.statuses), "network": network(records.statuses),
        "diagnostics": {name: {"level": level, "message": message}
                        for name, (level, message, _) in sorted(records.statuses.items())},
        "no_gantt": drive.no_gantt, "pictures": [path.name for path in drive.pictures]}


def topic_rows(tree):
    rows = [["topic", "Hz", "p50/ms", "p99/ms", "lost", "transport"]]
    for topic, figures in sorted(tree["topics"].items()):
        latency = figures.get("latency_ms") or {}
        if figures.get("messages", 0):
            rows.append([topic, number(figures.get("rate_hz"), 1), number(latency.get("p50"), 1),
                         number(latency.get("p99"), 1), number(figures.get("lost"), 0),
                         ", ".join(sorted(figures.get("transports") or {}))])
    return table(rows, "<>>>><")


def cpu_rows(tree):
    rows = [["node", "CPU %", "PSS/MB", "group"]]
    for group, nodes in sorted(tree["cpu_cores"].items(), key=lambda pair: pair[0] != "vehicle"):
        for node, cores in sorted(nodes.items(), key=lambda pair: -pair[1]):
            memory = tree["memory_mb"].get(node) or {}
            rows.append([node, percent(cores), number(memory.get("pss"), 0), group])
        rows.append(["", percent(sum(nodes.values())), number(sum(
            (tree["memory_mb"].get(node) or {}).get("pss", 0.0) for node in nodes), 0), "sum: " + group])
    return table(rows, "<>><")


def service_rows(tree):
    rows = [["service", "CPU %", "W", "MB"]]
    for name, one in tree["services"].items():
        memory = one["memory_mb"]
        rows.append([name, percent(one["cpu"]), number(one["watts"], 2),
                     number(memory / 2 ** 20 if memory is not None else None, 0)])
    return table(rows, "<>>>")


def stop_lines(tree):
    for one in tree["stops"]:
        verdict = "" if one["honoured"] else ": not judged, a service was dead" if one["deaf"] else ": TOO LATE"
        yield ("\"stop\" at %.1f m/s: heard %s after the end of the word, ordered %s, braking %s, standing %s%s" %
               (one["speed"] or 0.0, seconds(one["heard_s"]), seconds(one["ordered_s"]), seconds(one["braking_s"]),
                seconds(one["still_s"]), verdict))


def heard_lines(tree):
    for one in tree["commands"]:
        yield "heard \"%s\" (%.2f%s), %.0f ms after its end%s" % (
            one["text"], one["confidence"], ", fast" if one["fast"] else "", 1000 * one["latency"],
            "" if one["accepted"] else ": rejected")


def print_report(tree):
    facts = tree["machine"]
    print("\nDrive %s, seed %d, over %s%s" % (tree["scenario"], tree["seed"], tree["transport"],
                                             ", in one process" if tree["together"] else ""))
    print("Machine: %s, %d cores, %.1f GB, Linux %s, load %.1f at the start" %
          (facts["cpu"], facts["cores"], facts["memory_gb"], facts["kernel"], facts["load"]))
    print("Detector: %s" % (tree["network"] or "did not say its network"))
    print("%s after %.1f s and %.1f m, %.2f m from B, at most %.1f m/s" %
          (tree["end"], tree["seconds"], tree["distance_m"], tree["goal_distance_m"] or float("nan"),
           tree["max_speed"] or 0.0))
    print("\nWhat happened")
    print_happened(tree)
    for text in tree["failures"]:
        print("FAILED %s" % text)


def print_speed(tree):
    """Of a run on a recording."""
    print("\nThe vehicle on the recording, in real time, over %s, for %.1f s; other programs took %.0f %% of the computer" %
          (tree["transport"], tree["seconds"], 100 * tree["others_share"]))
    print("\nTopics: rate, latency from stamp to arrival")
    print(topic_rows(tree))
    print("\nCPU in % of one core, memory; stereo pairs into localisation: " + number(tree["pairs_hz"], 1) + " /s")
    print(cpu_rows(tree))
    print("\nServices as the node `power` has them; watts by %s" % tree["watts_source"])
    print(service_rows(tree))
    print("  the computer in all: %s W" % number(tree["watts"], 1))
    for node, text in tree["errors"]:
        print("  error of %s: %s" % (node, text))


def run_lines(tree):
    """What only a whole drive beside the simulator has: transports, truth, rendering."""
    local = tree["localisation"]
    by_tcp = sorted({link["topic"] for link in tree["links"] if link["transport"] == "TCPROS"
                     and "/drive_campus" not in (link["publisher"], link["subscriber"])})
    lines = ["transports: %s%s" % (
        ", ".join("%d links %s" % (count, name) for name, count in sorted(tree["transports"].items())),
        " (%s)" % ", ".join(by_tcp) if tree["transport"] != "TCPROS" and by_tcp else ""),
             "localisation: error RMS %s m, max %s m, heading max %s rad, %d corrections of the map" % (
                 number(local["rms_m"], 3), number(local["max_m"], 3), number(local["heading_max"], 3),
                 tree["corrections"]),
             "pictures: %s pairs rendered, %s skipped, p50 %s ms late" % (
                 tree["cameras"].get("pairs", "?"), tree["cameras"].get("skipped pairs", "?"),
                 tree["cameras"].get("delay of pictures p50 [ms]", "?"))]
    return lines


def happened(tree):
    """Lines of text."""
    lines = run_lines(tree) if "links" in tree else []
    lines += ["localisation was lost: %s" % one[2] for one in tree["losses"]]
    lines += ["met %s: nearest %.2f m after %.1f s, at %.1f m/s" % (name, one["distance"], one["t"], one["speed"])
              for name, one in sorted(tree["met"].items(), key=lambda pair: pair[1]["t"]) if one["actor"]]
    lines += ["%s was in view, %s" % (name, "never reported: MISSED" if one["first_s"] is None else
                                      "reported after %.1f s, and in %.0f %% of that time" % (
                                          one["first_s"], 100.0 * one["reported"] / one["in_view"]))
              for name, one in sorted(tree["sightings"].items())]
    lines += ["collisions: %d" % len(tree["collisions"])]
    lines += [standstill_line(one) for one in tree["standstills"]]
    lines += list(stop_lines(tree)) + list(heard_lines(tree))
    for kind, one in tree["offloading"].items():
        lines.append("%s: %d tasks, %s; %d late, %d dropped; %.1f J by the model; response p50 %s ms, p99 %s ms" % (
            kind, one["tasks"], ", ".join("%d %s" % (count, name) for name, count in sorted(one["by"].items())),
            one["missed"], one["dropped"], one["joules"], number(one["response_p50"] and 1000 * one["response_p50"], 0),
            number(one["response_p99"] and 1000 * one["response_p99"], 0)))
    lines += ["reaction \"%s\" (%s) to %s" % (one["rule"], one["action"], one["label"]) for one in tree["reactions"]]
    lines += ["killed %s at %.1f m/s: back after %s, %s" % (
        kill["node"], kill["speed"], seconds(kill["back_s"]), "stopped" if kill["stopped"] else "went on")
        for kill in tree["kills"]]
    if tree["no_gantt"]:
        lines.append("no chart of the runtime: %s" % tree["no_gantt"])
    counts = {}
    for _, node, text in tree["errors"]:
        counts[(node, text)] = counts.get((node, text), 0) + 1
    lines += ["error of %s%s: %s" % (node, " (%d times)" % count if count > 1 else "", text)
              for (node, text), count in counts.items()]
    if tree["unplugs"]:
        lines.append("unplugged for %.1f s and plugged in again:" % unplugs.UNPLUGGED_S)
        lines += list(unplugs.lines(tree["unplugs"]))
    return lines


def standstill_line(one):
    text = "stood %.1f s at (%.1f, %.1f)" % (one["seconds"], *one["pose"][:2])
    if "cause" in one:  # judged by the truth
        text += ", for " + one["cause"] if one["cause"] else ", WITHOUT A CAUSE"
    text += ": " + (one["reason"] or "no reason given")
    if "cause" in one:
        text += "; truly nearest: %s%s" % (
            one["nearest"], ", of the actors %s %.1f m" % (one["who"], one["nearest_actor"]) if one["who"] else "")
    return text


def print_happened(tree):
    print("\n".join("  " + line for line in happened(tree)))


def write(drive, tree, output):
    """drive_campus.json and the pictures in the folder. @return their paths. @throws DemoError"""
    try:
        drawn = plots.draw(drive, tree, output)
    except OSError as error:
        raise DemoError("the report cannot be written to %s: %s; make room there or choose another folder with "
                        "--output" % (output, error.strerror)) from error
    tree["pictures"] += [path.name for path in drawn]
    return [write_tree(tree, output / "drive_campus.json")] + drawn


def write_tree(tree, path):
    """As JSON. @return path. @throws DemoError"""
    temporary = path.with_name(path.name + ".tmp")
    try:
        temporary.write_text(json.dumps(tree, indent=1, ensure_ascii=False, default=str) + "\n", encoding="utf-8")
        os.replace(temporary, path)
    except OSError as error:
        raise DemoError("%s cannot be written: %s; make room there or choose another folder with --output" %
                        (path, error.strerror)) from error
    return path


def summary(tree):
    """A drive in one line."""
    stops = [one["braking_s"] for one in tree["stops"]]
    nearest = min((one["distance"] for one in tree["met"].values() if one["actor"]), default=None)
    without = sum(not one["cause"] for one in tree["standstills"])
    return "seed %d: %s, %.0f s, %.0f m, B %.2f m; nearest actor %s m; stop braking after %s; %d stops without a cause; " \
        "localisation %s m; %d errors" % (
            tree["seed"], "failed" if tree["failures"] else "passed", tree["seconds"], tree["distance_m"],
            tree["goal_distance_m"] or float("nan"), number(nearest, 2),
            ", ".join(seconds(one) for one in stops) or "-", without,
            number(tree["localisation"]["max_m"], 2), len(tree["errors"]))


def of_rounds(trees):
    """Lines about several drives."""
    stood = [one for tree in trees for one in tree["standstills"]]
    braking = [one["braking_s"] for tree in trees for one in tree["stops"] if one["braking_s"] is not None]
    nearest = [one["distance"] for tree in trees for one in tree["met"].values() if one["actor"]]
    killed = [kill for tree in trees for kill in tree["kills"]]
    lines = ["%d services killed, %d came back: %s" % (
        len(killed), sum(kill["back_s"] is not None for kill in killed), back_times(killed))] if killed else []
    farthest = [tree["localisation"]["max_m"] for tree in trees if tree["localisation"]["max_m"] is not None]
    return lines + [
        "%d collisions; nearest actor %s m; %d standstills, %d without a cause" % (
            sum(len(tree["collisions"]) for tree in trees), number(min(nearest, default=None), 2), len(stood),
            sum(not one["cause"] for one in stood)),
        "\"stop\" to braking: p50 %s s, most %s s; localisation: most %s m" % (
            number(quantile(braking, 0.5), 2), number(max(braking, default=None), 2),
            number(max(farthest, default=None), 2))]


def back_times(kills):
    times = [kill["back_s"] for kill in kills if kill["back_s"] is not None]
    return "p50 %s s, most %s s" % (number(quantile(times, 0.5), 2), number(max(times, default=None), 2))
