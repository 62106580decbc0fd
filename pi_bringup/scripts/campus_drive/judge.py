"""Figures and verdict of a drive, from what the simulator's judge wrote and the graph said. No ROS."""

import bisect
import json
import math

from . import causes, unplugs

STOP_LIMIT_S = 0.7      # from the end of "stop" until standstill is commanded
HEARING = ("recognizer", "command", "arbiter", "chassis", "coordinator", "vehicle_manager")  # from word to brake
LISTENS_S = 1.0         # after it is back, the recogniser knows the noise
STANDSTILL = 0.05       # [m/s]
NEAR_GOAL_M = 1.0
BRAKING = 0.06          # [m/s] slower than at most since the command: it brakes
HELD_S = 1.0            # a standstill of so long is one
MET_M = 8.0             # a thing so near was met
BRAKING_STATES = 4      # braking is the mean over so many states of 20 Hz
WARN = 1                # level of a status
SET_OFF_M = 1.0         # a vehicle that refuses goes no farther; one that is to stop has to


def read_log(path):
    """The simulator's facts: lists by type. A line that is cut off, at the end, is left out."""
    facts = {}
    with open(path, encoding="utf-8") as file:
        for line in file:
            try:
                one = json.loads(line)
            except ValueError:
                continue
            facts.setdefault(one["type"], []).append(one)
    return facts


def quantile(values, share):
    """The least of the values that `share` of them do not exceed; None if there are none."""
    return sorted(values)[max(0, math.ceil(share * len(values)) - 1)] if values else None


class Truth:
    """Of the simulator: where the vehicle was."""

    def __init__(self, states, begin, end):
        self.states = [one for one in states if begin <= one["stamp"] <= end]
        self._stamps = [one["stamp"] for one in self.states]

    def at(self, stamp):
        """(x, y, heading) between two states; None outside."""
        index = bisect.bisect_right(self._stamps, stamp)
        if index == 0 or index == len(self._stamps):
            return None
        a, b = self.states[index - 1], self.states[index]
        part = (stamp - a["stamp"]) / (b["stamp"] - a["stamp"])
        turn = math.remainder(b["pose"][2] - a["pose"][2], 2 * math.pi)
        x, y = (a["pose"][axis] + part * (b["pose"][axis] - a["pose"][axis]) for axis in (0, 1))
        return x, y, a["pose"][2] + part * turn

    def state_at(self, stamp):
        index = bisect.bisect_right(self._stamps, stamp)
        return self.states[max(0, index - 1)] if self.states else None

    @property
    def distance(self):
        poses = [one["pose"] for one in self.states]
        return sum(math.hypot(b[0] - a[0], b[1] - a[1]) for a, b in zip(poses, poses[1:]))


def is_valid(validity, stamp):
    """Whether the pose could be driven by, as the pose keeper said; yes where it said nothing yet."""
    index = bisect.bisect_right([one[0] for one in validity], stamp)
    return index == 0 or validity[index - 1][1]


def localisation(estimates, truth, validity=()):
    """Errors of the estimated pose in the map, while it is said to be valid [m, rad]."""
    errors = []
    for stamp, x, y, heading in estimates:
        true = truth.at(stamp) if is_valid(validity, stamp) else None
        if true:
            errors.append((math.hypot(x - true[0], y - true[1]),
                           abs(math.remainder(heading - true[2], 2 * math.pi))))
    if not errors:
        return {"count": 0, "max_m": None, "rms_m": None, "end_m": None, "heading_max": None}
    return {"count": len(errors), "max_m": max(error[0] for error in errors),
            "rms_m": math.sqrt(sum(error[0] ** 2 for error in errors) / len(errors)), "end_m": errors[-1][0],
            "heading_max": max(error[1] for error in errors)}


def obstacles_met(states):
    """{who: least distance [m], when, and how fast the vehicle was then}"""
    met = {}
    for state in states:
        for key in ("nearest", "nearest_actor"):
            one = state.get(key)
            if one and one["distance"] < MET_M:
                name = one["actor"] or "%s %d" % (one["class"], one["id"])
                if name not in met or one["distance"] < met[name]["distance"]:
                    met[name] = {"distance": one["distance"], "t": state["t"], "speed": state["speed"],
                                 "class": one["class"], "actor": bool(one["actor"])}
    return met


def standstills(states, arbiter):
    """Pieces of HELD_S and more without motion between the begin and the end of the way, with who caused them."""
    found, begin = [], None
    moved = False
    for state in states:
        moving = abs(state["speed"]) > STANDSTILL
        if moving:
            if begin is not None and moved and state["stamp"] - begin["stamp"] >= HELD_S:
                found.append({"t": begin["t"], "stamp": begin["stamp"], "seconds": state["stamp"] - begin["stamp"],
                              "pose": begin["pose"],
                              "reason": reason_at(arbiter, begin["stamp"], state["stamp"]),
                              "nearest": "%s %.1f m" % (begin["nearest"]["class"], begin["nearest"]["distance"])
                              if begin.get("nearest") else "nothing",
                              "nearest_actor": (begin.get("nearest_actor") or {}).get("distance"),
                              "who": (begin.get("nearest_actor") or {}).get("actor")})
            begin, moved = None, True
        elif begin is None:
            begin = state
    return found


def reason_at(arbiter, begin, end):
    """What limited the speed when it came to stand, and what did until it went on."""
    before = [one for one in arbiter if one[0] <= begin + 0.1]
    during = [one for one in arbiter if begin < one[0] < end - 0.1]
    texts = []
    for _, driver, limited_by, reason in before[-1:] + during:
        text = "%s: %s" % (limited_by or driver, reason)
        if text not in texts:
            texts.append(text)
    return "; ".join(texts)


def deaf(played, kills):
    """Whether what has to hear was killed, and not back yet, when this was said."""
    return any(kill["node"] in HEARING and kill["time"] < played["speech_end"] + STOP_LIMIT_S and
               (kill["back_s"] is None or played["begin"] < kill["time"] + kill["back_s"] + LISTENS_S)
               for kill in kills)


def stops(played, words, records, truth, kills=()):
    """What became of each "stop" that was said: seconds from the end of the word. None: it did not happen."""
    found = []
    for sound, text in zip(played, words):
        if text != "stop":
            continue
        end = sound["speech_end"]
        heard = next((one for one in records.commands
                      if one["text"] == "stop" and one["accepted"] and one["arrival"] > sound["begin"]), None)
        latched = next((one["arrival"] for one in records.command_states
                        if one["stopped"] and one["arrival"] > sound["begin"]), None)
        command = next((one[0] for one in records.motions
                        if latched is not None and one[0] >= latched - 0.1 and abs(one[2]) < 1e-3), None)
        # The arbiter brings the commanded speed down by a ramp: braking begins with the first lower one.
        at_latch = truth.state_at(latched or end)
        braking = still = None
        if at_latch is not None and latched is not None:
            later = [one for one in truth.states if one["stamp"] >= latched]
            fastest = at_latch["speed"]  # since then: a vehicle that was speeding up brakes when it is slower again
            for one in later:
                fastest = max(fastest, one["speed"])
                if one["speed"] < fastest - BRAKING or abs(one["speed"]) <= STANDSTILL:
                    braking = one["stamp"]
                    break
            still = next((one["stamp"] for one in later if abs(one["speed"]) <= STANDSTILL), None)

        def since(stamp):
            return None if stamp is None else stamp - end

        found.append({"end_of_word": end, "speed": at_latch["speed"] if at_latch else None,
                      "heard_s": since(heard["arrival"]) if heard else None,
                      "confidence": heard["confidence"] if heard else None, "ordered_s": since(latched),
                      "standstill_command_s": since(command), "braking_s": since(braking), "still_s": since(still),
                      "deaf": deaf(sound, kills),
                      "honoured": latched is not None and braking is not None and braking - end <= STOP_LIMIT_S})
    return found


def offloaded(decisions, begin, end):
    """{kind: {how and node: tasks}} with response times."""
    result = {}
    for kind in sorted({one["kind"] for one in decisions}):
        tasks = [one for one in decisions if one["kind"] == kind and begin <= one["stamp"] <= end]
        by = {}
        for one in tasks:
            name = "%s %s" % (one["how"], one["node"]) if one["node"] else one["how"]
            by[name] = by.get(name, 0) + 1
        times = [one["response_time"] for one in tasks]
        result[kind] = {"tasks": len(tasks), "by": by, "missed": sum(not one["by_deadline"] for one in tasks),
                        "dropped": sum(one["dropped"] for one in tasks),
                        "joules": sum(one["energy"] for one in tasks),
                        "response_p50": quantile(times, 0.5), "response_p99": quantile(times, 0.99)}
    return result


def hardest_braking(states):
    """[m/s^2], by the true speed; None: too few states."""
    return max(((abs(a["speed"]) - abs(b["speed"])) / (b["stamp"] - a["stamp"])
                for a, b in zip(states, states[BRAKING_STATES:]) if b["stamp"] > a["stamp"]), default=None)


def nearest(states):
    """Least distance from the vehicle's outline to a thing [m]; None: there was none."""
    return min((one["nearest"]["distance"] for one in states if one.get("nearest")), default=None)


def unexpected(drive, result):
    """In what the end of the way is not what the scenario expects, as texts."""
    arrived = drive.result is not None and drive.result["success"]
    if result["expect"] == "refuse":
        if result["distance_m"] > SET_OFF_M:
            return ["the vehicle was to refuse, and drove %.1f m" % result["distance_m"]]
        warnings = ["%s: %s" % (name, message)
                    for name, (level, message, _) in sorted(drive.observer.records.statuses.items()) if level >= WARN]
        return [] if any(drive.facts["reason"] in text for text in warnings) else \
            ["the vehicle was to refuse, and does not say \"%s\"; it says %s" % (
                drive.facts["reason"], "; ".join(warnings) or "nothing is wrong")]
    if result["expect"] == "stop":
        if result["distance_m"] <= SET_OFF_M:
            return ["the vehicle was to set off and to stop, and drove %.1f m" % result["distance_m"]]
        moves = result["end_speed"] is None or abs(result["end_speed"]) > STANDSTILL
        return (["the vehicle was to stop before B, and reached it"] if arrived else []) + \
            (["the vehicle was to stop, and still moved at the end"] if moves else [])
    if not arrived:
        return ["B was not reached: %s" % drive.end]
    if result["goal_distance_m"] is None or result["goal_distance_m"] > NEAR_GOAL_M:
        return ["the vehicle says it arrived, and is %.1f m from B" % (result["goal_distance_m"] or math.nan)]
    return []


def failures(drive, result):
    """Why the drive is none that counts, as texts."""
    texts = unexpected(drive, result)
    texts += ["fault \"%s\" was not done: %s" % (one["line"], one["problem"]) for one in drive.faults if one["problem"]]
    texts += ["a fault was refused: %s" % one["text"] for one in result["refused"]]
    for one in result["collisions"]:
        thing = one["with"]
        texts.append("collision after %.1f s with %s at %.2f m/s" %
                     (one["t"], thing["actor"] or thing["class"], one["speed"]))
    for one in result["stops"]:
        if not one["honoured"] and not one.get("deaf"):
            texts.append("\"stop\" was not honoured within %.1f s: heard after %s, braking after %s" % (
                STOP_LIMIT_S, seconds(one["heard_s"]), seconds(one["braking_s"])))
    unsaid = [entry["text"] for entry in drive.facts.get("spoken", []) if not entry.get("said")]
    if unsaid:
        texts.append("not said, as the place was not reached: %s" % ", ".join(unsaid))
    for kill in result["kills"]:
        if kill["back_s"] is None:
            texts.append("%s did not come back after it was killed" % kill["node"])
    return texts + unplugs.failures(result.get("unplugs", []), result.get("not_unplugged", []))


def seconds(value):
    return "never" if value is None else "%.2f s" % value


def judge(drive):
    """All figures of a drive as a tree for JSON."""
    records = drive.observer.records
    facts = read_log(drive.simulator_log)
    states = [one for one in facts.get("state", []) if drive.began <= one["stamp"] <= drive.ended]
    truth = Truth(facts.get("state", []), drive.began - 1.0, drive.ended + 1.0)
    goal = (drive.facts["further_goals"] or [drive.facts["goal"]])[-1]
    last = states[-1]["pose"] if states else None
    said = [entry["text"] for entry in sorted((one for one in drive.facts["spoken"] if one.get("said")),
                                              key=lambda one: one["said"])]
    result = {
        "end": drive.end, "seconds": drive.ended - drive.began, "distance_m": truth.distance, "action": drive.result,
        "goal_distance_m": math.hypot(last[0] - goal[0], last[1] - goal[1]) if last else None,
        "expect": drive.facts["expect"], "reached": drive.result is not None and drive.result["success"],
        "end_speed": states[-1]["speed"] if states else None, "hardest_braking": hardest_braking(states),
        "nearest_m": nearest(states), "faults": drive.faults,
        "max_speed": max((one["speed"] for one in states), default=None),
        "localisation": localisation([one for one in records.estimates if drive.began <= one[0] <= drive.ended], truth,
                                     sorted(records.validity)),
        "losses": [one for one in records.validity if not one[1] and drive.began <= one[0] <= drive.ended],
        "corrections": len(records.corrections), "met": obstacles_met(states),
        "collisions": facts.get("collision", []), "refused": facts.get("error", []),
        "triggers": facts.get("trigger", []), "standstills": standstills(states, records.arbiter),
        "stops": stops(records.played, said, records, truth, drive.kills), "said": said, "played": records.played,
        "commands": records.commands, "command_states": records.command_states,
        "reactions": [one for one in records.reactions if drive.began <= one["stamp"] <= drive.ended],
        "offloading": offloaded(records.decisions, drive.began, drive.ended), "kills": drive.kills,
        "not_unplugged": drive.not_unplugged,
        "unplugs": unplugs.finish(drive.unplugs, facts.get("state", []), records, lambda begin, end: localisation(
            [one for one in records.estimates if begin <= one[0] < end], truth, sorted(records.validity))["max_m"]),
        "errors": [one for one in records.errors if one[0] >= drive.began - 60.0]}
    causes.add(result["standstills"], states, records, result["kills"], result["unplugs"],
               facts.get("command", []))
    result["failures"] = failures(drive, result)
    return result
