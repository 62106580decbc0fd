"""Which people in view the detector called people, and what else it called so: beside what was true. No ROS."""

import bisect

PERSON = "person"
LEAST_SCORE = 0.4
NEAR_M = 12.0          # people so near, and in the picture, have to be labelled
IMU_AHEAD_M = 0.8      # the cameras, before base_link
FOCAL_PX, MIDDLE_PX = 320.0, 320.0  # of the simulated camera: 640 px, 90 degrees
EDGE_PX = 20.0         # so far inside of the picture
TOLERANCE_PX = 25.0    # between the column of a person's middle and the box
LEAST_AHEAD_M = 1.0
LATE_S = 0.03          # between a picture and the judge's state


def column(place):
    """Of a place in base_link, in the left picture [px], which may be outside of it; None: not ahead."""
    ahead, left = place[0] - IMU_AHEAD_M, place[1]
    return MIDDLE_PX - FOCAL_PX * left / ahead if ahead > 0.0 else None


def in_view(place):
    """So near, and so far inside of the picture, that it has to be labelled."""
    u = column(place)
    return (LEAST_AHEAD_M <= place[0] - IMU_AHEAD_M <= NEAR_M and
            EDGE_PX <= u <= 2 * MIDDLE_PX - EDGE_PX)


def figures(states, reports):
    """@param states  of the simulator, with `people` in base_link. Those behind things count as in view: the judge does
    not see what hides them. @param reports  [(stamp, [(name, score, left, right)])] with columns in pixels.
    @return people in view, how many had the label, pictures, labels at no person"""
    stamps = [one["stamp"] for one in states]
    result = {"in_view": 0, "labelled": 0, "pictures": 0, "false": 0}
    for stamp, boxes in reports:
        index = bisect.bisect_left(stamps, stamp - LATE_S)
        if index == len(stamps) or abs(stamps[index] - stamp) > LATE_S or "people" not in states[index]:
            continue
        result["pictures"] += 1
        people = states[index]["people"]
        persons = [(left - TOLERANCE_PX, right + TOLERANCE_PX) for name, score, left, right in boxes
                   if name == PERSON and score >= LEAST_SCORE]
        for place in people:
            if in_view(place):
                result["in_view"] += 1
                result["labelled"] += any(left <= column(place) <= right for left, right in persons)
        columns = [u for u in map(column, people) if u is not None]
        result["false"] += sum(not any(left <= u <= right for u in columns) for left, right in persons)
    return result
