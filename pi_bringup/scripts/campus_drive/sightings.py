"""Which of the actors on the way were reported as obstacles: what the vehicle said beside what was true. No ROS."""

import bisect
import math

VIEW_M = 10.0        # an actor so near, and in the picture, has to be reported
LEAST_AHEAD_M = 2.0  # in front of base_link: nearer is below the cameras' picture
VIEW_SLOPE = 0.85    # sideways by metre ahead; the cameras see 90 degrees
TOLERANCE_M = 1.2    # between the true place and the middle of what was seen of it
LATE_S = 0.35        # between the picture that is reported on and the true place


def in_view(actor):
    x, y = actor["position"][:2]
    return actor["distance"] <= VIEW_M and x >= LEAST_AHEAD_M and abs(y) <= VIEW_SLOPE * x


def sightings(states, reports):
    """@param states  of the simulator. @param reports  [(stamp, [(x, y)])] in base_link, by stamp.
    @return {actor: states in which it was in view, in how many of them an obstacle was reported there, after how many
    seconds in view for the first time (None: never)}"""
    stamps = [one[0] for one in reports]
    found = {}
    for state in states:
        actor = state.get("nearest_actor")
        if not actor or not in_view(actor):
            continue
        index = bisect.bisect_right(stamps, state["stamp"])
        if index == 0 or state["stamp"] - stamps[index - 1] > LATE_S:
            near = False
        else:
            x, y = actor["position"][:2]
            near = any(math.hypot(px - x, py - y) <= TOLERANCE_M for px, py in reports[index - 1][1])
        entry = found.setdefault(actor["actor"], {"class": actor["class"], "in_view": 0, "reported": 0,
                                                  "began": state["stamp"], "first_s": None})
        entry["in_view"] += 1
        if near:
            entry["reported"] += 1
            if entry["first_s"] is None:
                entry["first_s"] = state["stamp"] - entry["began"]
    for entry in found.values():
        del entry["began"]
    return found
