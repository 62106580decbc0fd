"""The report of `make demo`: what the vehicle did in the closed loop, and how fast it is on the recording of that drive,
over π-OS and over TCPROS. The same numbers on the screen, as JSON and on a page. No ROS."""

import statistics

from first_drive.report import number, table

from pi_bringup.battery import ratio

from . import report
from .judge import STOP_LIMIT_S, quantile
from .speed import BUSY

LIMIT_CPU = 1.4          # cores, of the whole vehicle
LIMIT_SPEECH_S = 0.5     # from the end of speech to the command
STEREO_HZ, POSE_HZ, DETECTION_HZ = 20.0, 200.0, 10.0
SHARE = 0.95
TITLES = ("over π-OS", "over TCPROS")


def rate_of(tree, topic):
    return (tree["topics"].get(topic) or {}).get("rate_hz")


def latency_of(tree, topic, key):
    return tree["latency_ms"][topic][key]


def heard(tree):
    """Latencies of the commands that were heard [s]."""
    return [one["latency"] for one in tree["commands"] if one["accepted"]]


def understood(tree):
    """How many of the commands that were said were heard as what they were, in their order."""
    texts = iter([one["text"] for one in tree["commands"] if one["accepted"]])
    return sum(any(text == heard_one for heard_one in texts) for text in tree["said"])


def milliseconds(seconds):
    return None if seconds is None else 1000.0 * seconds


def integer(text):
    return int(text) if str(text).isdigit() else None


def figure(value, digits, unit, met=None):
    """A value as JSON and screen have it: rounded once. @param met  whether the rounded value is within its bar."""
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        value = round(value, digits)
        text = number(value, digits) + unit
    else:
        text = {True: "yes", False: "no", None: "-"}[value]
    return {"value": value, "text": text,
            "met": None if met is None else value is not None and bool(met(value))}


def at_least(limit):
    return lambda value: value >= limit


def at_most(limit):
    return lambda value: value <= limit


# ------------------------------------------------------------------------------------------------------------ function

def function_rows(tree):
    """[{what, bar, figure}] of the drive in the closed loop."""
    braking = [one["braking_s"] for one in tree["stops"]]
    stop = max(braking, default=None) if None not in braking else None
    arrived = bool(tree["action"] and tree["action"]["success"])
    missed = sum(one["reported"] == 0 for one in tree["sightings"].values())
    without = sum(one["cause"] is None for one in tree["standstills"])
    rows = [
        ("reaches B", "yes", figure(arrived, 0, "", bool)),
        ("collisions", "0", figure(len(tree["collisions"]), 0, "", at_most(0))),
        ("\"stop\", end of word to braking", "<= %.1f s" % STOP_LIMIT_S,
         figure(stop, 2, " s", at_most(STOP_LIMIT_S) if braking else None)),
        ("commands heard of those said", "all",
         figure(understood(tree), 0, " of %d" % len(tree["said"]), at_least(len(tree["said"])))),
        ("commands heard that nobody said", "0", figure(len(heard(tree)) - understood(tree), 0, "", at_most(0))),
        ("standstills without a cause", "0", figure(without, 0, "", at_most(0))),
        ("people and things on the way that were never reported", "0", figure(missed, 0, "", at_most(0))),
        ("error of the localisation, most", "", figure(tree["localisation"]["max_m"], 2, " m")),
        ("nearest distance to a thing", "", figure(tree["nearest_m"], 2, " m")),
        ("hardest braking", "", figure(tree["hardest_braking"], 1, " m/s²")),
        ("errors in the log of the drive", "0", figure(len(tree["errors"]), 0, "", at_most(0)))]
    return [{"what": what, "bar": bar, "figure": value} for what, bar, value in rows]


# --------------------------------------------------------------------------------------------------------------- speed

def quantities(tree):
    """[(what, bar, value, digits, unit, condition)] of one run on the recording."""
    memory = sum((tree["memory_mb"].get(node) or {}).get("pss", 0.0) for node in tree["cpu_cores"].get("vehicle", {}))
    return [
        ("stereo pairs into localisation", ">= %.0f /s" % STEREO_HZ, tree["pairs_hz"], 1, " /s", at_least(STEREO_HZ)),
        ("pose", ">= %.0f Hz" % POSE_HZ, rate_of(tree, "/odometry"), 0, " Hz", at_least(POSE_HZ)),
        ("detection", ">= %.0f Hz" % DETECTION_HZ, rate_of(tree, "/detections"), 1, " Hz", at_least(DETECTION_HZ)),
        ("obstacles", "", rate_of(tree, "/obstacles"), 1, " Hz", None),
        ("processor, whole vehicle", "<= %.0f %%" % (100 * LIMIT_CPU), 100 * tree["vehicle_cores"], 0, " %",
         at_most(100 * LIMIT_CPU)),
        ("memory (PSS)", "", memory, 0, " MB", None),
        ("power of the computer (%s)" % tree["watts_source"], "", tree["watts"], 1, " W", None),
        ("hours of the computer on %s (%s)" % (tree["battery"], tree["watts_source"]), "",
         ratio(tree["battery_wh"], tree["watts"]), 1, " h", None),
        ("spoken command, p95 from the end of the word", "<= %.0f ms" % (1000 * LIMIT_SPEECH_S),
         milliseconds(quantile(heard(tree), SHARE)) if len(heard(tree)) == tree["said"] else None, 0, " ms",
         at_most(1000 * LIMIT_SPEECH_S)),
        ("picture to obstacles, p50", "", latency_of(tree, "/obstacles", "p50"), 0, " ms", None),
        ("picture to obstacles, p99", "", latency_of(tree, "/obstacles", "p99"), 0, " ms", None),
        ("picture to detections, p50", "", latency_of(tree, "/detections", "p50"), 0, " ms", None),
        ("picture to detections, p99", "", latency_of(tree, "/detections", "p99"), 0, " ms", None),
        ("errors in the logs of the recording's runs", "0", len(tree["errors"]), 0, "", at_most(0))]


def median(values):
    there = [value for value in values if value is not None]
    return statistics.median(there) if there else None


def speed_rows(runs):
    """[{what, bar, figures: [ours, theirs], ratio}] with medians of the runs. The ratio is theirs by ours, with the
    least and the greatest of the rounds. @param runs  [trees over π-OS, trees over TCPROS], in the order of rounds"""
    every = [[quantities(tree) for tree in trees] for trees in runs]
    pattern = next((one[0] for one in every if one), [])
    rows = []
    for index, (what, bar, _, digits, unit, condition) in enumerate(pattern):
        values = [[one[index][2] for one in rounds] for rounds in every]
        figures = [figure(median(one), digits, unit, condition) for one in values]
        ratios = [theirs / ours for ours, theirs in zip(*values) if ours and theirs is not None]
        rows.append({"what": what, "bar": bar, "figures": figures, "ratio": None if not ratios else {
            "median": round(statistics.median(ratios), 2), "least": round(min(ratios), 2),
            "greatest": round(max(ratios), 2)}})
    return rows


def busy(runs):
    """Share of the computer that others took, if speed is not judged for it; else None."""
    share = max((tree["others_share"] for trees in runs for tree in trees), default=0.0)
    return round(share, 2) if share > BUSY else None


# --------------------------------------------------------------------------------------------------------------- report

def compare(drive, runs, reasons, alone_reason):
    """@param drive  the tree of the closed loop. @param runs  as in speed_rows().
    @param reasons  [why a run over π-OS failed, likewise TCPROS]; "": it did not.
    @param alone_reason  likewise the drive in one process. @return the tree of the report"""
    function, speed = function_rows(drive), speed_rows(runs)
    missed = [one["what"] for one in function if one["figure"]["met"] is False]
    others_share = busy(runs)
    if others_share is None:
        missed += [one["what"] for one in speed if one["figures"][0]["met"] is False]
    return {"scenario": drive["scenario"], "seed": drive["seed"], "machine": drive["machine"],
            "failures": drive["failures"], "function": function, "speed": speed, "others_share": others_share,
            "reasons": dict(zip(TITLES, reasons)), "missed": missed, "rounds": [len(trees) for trees in runs],
            "one_process_reason": alone_reason,
            "passed": not (drive["failures"] or missed or reasons[0] or alone_reason),
            "nodes": nodes(runs), "services": services(runs), "links": [links(trees) for trees in runs],
            "drive": drive, "runs": runs}


def verdict(tree):
    if tree["failures"]:
        return "FAILED: %s" % "; ".join(tree["failures"])
    if tree["missed"]:
        return "The vehicle drove from A to B, but missed: %s" % ", ".join(tree["missed"])
    if tree["reasons"][TITLES[0]]:
        return "The vehicle drove from A to B; its speed over π-OS is not known: %s" % tree["reasons"][TITLES[0]]
    if tree["one_process_reason"]:
        return "The vehicle drove from A to B, but not in one process: %s" % tree["one_process_reason"]
    if tree["others_share"] is not None:
        return ("PASSED: the vehicle drove from A to B; its speed is not judged, as other programs took %.0f %% of the "
                "computer" % (100 * tree["others_share"]))
    return "PASSED: the vehicle drove from A to B, and all bars are met"


def links(trees):
    counts = trees[0]["transports"] if trees else {}
    return ", ".join("%d %s" % (count, name) for name, count in sorted(counts.items())) or "-"


def nodes(runs):
    """[{node, group, cpu percent and PSS of each transport}], the vehicle's first, then by what they take."""
    rows = {}
    for index, trees in enumerate(runs):
        for tree in trees:
            for group, members in tree["cpu_cores"].items():
                for node, cores in members.items():
                    row = rows.setdefault(node, {"node": node, "group": group, "cpu": [[], []], "pss_mb": [[], []]})
                    row["cpu"][index].append(100 * cores)
                    row["pss_mb"][index].append((tree["memory_mb"].get(node) or {}).get("pss"))
    for row in rows.values():
        for key in ("cpu", "pss_mb"):
            row[key] = [None if median(values) is None else round(median(values), 1) for values in row[key]]
    return sorted(rows.values(), key=lambda row: (row["group"] != "vehicle", row["group"],
                                                  -max(value or 0.0 for value in row["cpu"])))


def services(runs):
    """[{service, cpu percent, watts and memory of each transport}] as the node `power` has them."""
    names = list(dict.fromkeys(name for trees in runs for tree in trees for name in tree["services"]))

    def value(trees, name, field, scale, digits):
        middle = median([(tree["services"].get(name) or {}).get(field) for tree in trees])
        return None if middle is None else round(scale * middle, digits)

    return [{"service": name, **{key: [value(trees, name, field, scale, digits) for trees in runs]
                                 for key, field, scale, digits in (("cpu", "cpu", 100.0, 1), ("watts", "watts", 1.0, 2),
                                                                   ("memory_mb", "memory_mb", 2.0 ** -20, 0))}}
            for name in names]


def ratio_text(ratio):
    return "" if ratio is None else "%.2f (%.2f to %.2f)" % (ratio["median"], ratio["least"], ratio["greatest"])


def first_rows(tree):
    """The table of the first screen: function, then speed."""
    rows = [["what", "bar", *TITLES, "TCPROS / π-OS"]]
    for one in tree["function"]:
        rows.append([one["what"], one["bar"], one["figure"]["text"] + (" !" if one["figure"]["met"] is False else ""),
                     "", ""])
    judged = tree["others_share"] is None
    for one in tree["speed"]:
        rows.append([one["what"], one["bar"]] + [
            value["text"] + (" !" if judged and value["met"] is False else "") for value in one["figures"]] +
            [ratio_text(one["ratio"])])
    return rows


def notes(tree):
    """Sentences below the table."""
    facts = tree["machine"]
    yield "! misses its bar. The first %d rows are of the closed loop, in simulated time, over π-OS; the others of its " \
        "recording, in real time, medians of %d runs" % (len(tree["function"]), max(tree["rounds"]))
    for title, reason in tree["reasons"].items():
        if reason:
            yield "%s: no figures: %s" % (title, reason)
    yield "%s, seed %d; %s, %d cores, %.1f GB, load %.1f at the start" % (
        tree["scenario"], tree["seed"], facts["cpu"], facts["cores"], facts["memory_gb"], facts["load"])
    yield "detector: %s" % (tree["drive"]["network"] or "did not say its network")


def print_first(tree):
    """The first screen."""
    drive = tree["drive"]
    print("\n%s, %.0f m in %.0f s: %s\n" % (tree["scenario"], drive["distance_m"], drive["seconds"], verdict(tree)))
    print(table(first_rows(tree), "<<<<<"))
    for text in notes(tree):
        print("  " + text)


def print_rest(tree):
    print("\nProcessor in % of one core, memory (PSS); the group tells what is not of the vehicle")
    rows = [["node"] + [text for title in TITLES for text in (title + ": CPU %", "MB")] + ["group"]]
    for one in tree["nodes"]:
        rows.append([one["node"]] + [text for index in (0, 1) for text in (
            number(one["cpu"][index], 1), number(one["pss_mb"][index], 0))] + [one["group"]])
    print(table(rows, "<>>>><"))
    print("\nServices, as the node `power` has them")
    rows = [["service"] + [text for title in TITLES for text in (title + ": CPU %", "W", "MB")]]
    for one in tree["services"]:
        rows.append([one["service"]] + [text for index in (0, 1) for text in (
            number(one["cpu"][index], 1), number(one["watts"][index], 2), number(one["memory_mb"][index], 0))])
    print(table(rows, "<>>>>>>"))
    print("  links: %s" % "; ".join("%s: %s" % pair for pair in zip(TITLES, tree["links"])))


def write(tree, output):
    """demo.json in the folder. @return its path. @throws DemoError"""
    return report.write_tree({"verdict": verdict(tree), **tree}, output / "demo.json")
