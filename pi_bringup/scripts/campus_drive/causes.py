"""Why the vehicle stood: the cause that there truly was, whatever the vehicle said. No ROS."""

import math

BEFORE_S = 2.0       # a cause may be gone so long before the vehicle stands
AHEAD_M = 9.0        # of the way that the vehicle then drove, on which an actor is in the way
IN_THE_WAY_M = 2.0   # from the vehicle's middle to the middle of an actor: half widths, margin
AFTER_FAULT_S = 6.0  # services and devices are back, the vehicle drives again


def way_after(states, index):
    """Positions in the map of the next AHEAD_M of the way that was driven."""
    points, way = [], 0.0
    for before, after in zip(states[index:], states[index + 1:]):
        points.append(before["pose"][:2])
        way += math.dist(before["pose"][:2], after["pose"][:2])
        if way > AHEAD_M:
            break
    return points or [states[index]["pose"][:2]]


def actor_in_the_way(states, begin, end):
    """Name of an actor that was on the way ahead at some time in [begin, end]; None: there was none."""
    for index, state in enumerate(states):
        actor = state.get("nearest_actor")
        if not begin <= state["stamp"] <= end or not actor:
            continue
        x, y, heading = state["pose"]
        ahead, left = actor["position"]
        place = (x + math.cos(heading) * ahead - math.sin(heading) * left,
                 y + math.sin(heading) * ahead + math.cos(heading) * left)
        if min(math.dist(place, point) for point in way_after(states, index)) <= IN_THE_WAY_M:
            return actor["actor"]
    return None


def cause_of(standstill, states, records, faults):
    """@param standstill  with stamp and seconds. @param states  of the simulator.
    @param faults  [(begin, end, what)] of what was killed or unplugged. @return text; None: there was none."""
    begin, end = standstill["stamp"] - BEFORE_S, standstill["stamp"] + standstill["seconds"]
    earlier = [state for state in records.command_states if state["arrival"] < begin][-1:]
    meanwhile = [state for state in records.command_states if begin <= state["arrival"] <= end]
    if any(state["stopped"] for state in earlier + meanwhile):
        return "a spoken stop"
    for since, until, what in reversed(faults):
        if since <= standstill["stamp"] and begin - AFTER_FAULT_S <= until:
            return what
    lost = [reason for stamp, valid, reason in records.validity if not valid and begin <= stamp <= end]
    if lost:
        return "localisation: %s" % lost[0]
    return actor_in_the_way(states, begin, end)


def scripted(commands):
    """[(begin, end, what)] of the scenario's faults. @param commands  of the simulator's log; by hand: left out"""
    faults = [one for one in commands if "restores" in one]

    def end_of(fault):
        device = fault["line"].split()[0].replace("unplug", "plug")
        if device == "kill":
            return fault["stamp"]  # the node is started again; what else has no end stays
        return min((one["stamp"] for one in faults if one["restores"] and one["stamp"] >= fault["stamp"] and
                    one["line"].split()[0] == device), default=math.inf)
    return [(one["stamp"], end_of(one), "fault: " + one["line"]) for one in faults if not one["restores"]]


def faults_of(kills, unplugs):
    """In the order of their begins."""
    return sorted([(kill["time"], kill["time"], "%s was killed" % kill["node"]) for kill in kills] +
                  [(entry["time"], entry["plugged"] or entry["time"], "%s was unplugged" % entry["device"])
                   for entry in unplugs])


def add(standstills, states, records, kills, unplugs, commands=()):
    """Adds `cause` to each. @param commands  of the simulator's log. @return them"""
    faults = faults_of(kills, unplugs) + scripted(commands)
    for one in standstills:
        one["cause"] = cause_of(one, states, records, faults)
    return standstills
