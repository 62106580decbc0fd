"""Results of the drives of a suite: a row of the table for each, and JUnit's XML. No ROS."""

from xml.etree import ElementTree

from first_drive.report import number, table

TITLES = ["scenario", "seed", "reached", "collision", "nearest/m", "brake/m/s²", "no cause", "labels", "false", "loc/m",
          "s", "verdict"]


def collision_text(collisions):
    """The fastest one: with whom, and the vehicle's speed."""
    if not collisions:
        return "no"
    worst = max(collisions, key=lambda one: abs(one["speed"]))
    return "%s %.1f m/s" % (worst["with"]["actor"] or worst["with"]["class"], abs(worst["speed"]))


def row(result):
    """Texts of one drive. @param result  of drive_one() in scenario_suite: name, seed, wall seconds, tree or error"""
    begin = [result["name"], str(result["seed"])]
    tree = result["tree"]
    if tree is None:
        return begin + ["-"] * 8 + [number(result["seconds"], 0), "NO DRIVE"]
    labels = tree["labels"]
    reached = "yes" if tree["reached"] else "no"
    return begin + [
        reached if tree["expect"] == "reach" else "%s (%s)" % (reached, tree["expect"]),
        collision_text(tree["collisions"]), number(tree["nearest_m"], 2), number(tree["hardest_braking"], 1),
        str(sum(one["cause"] is None for one in tree["standstills"])),
        "%d/%d" % (labels["labelled"], labels["in_view"]) if labels["in_view"] else "-",
        "%d/%d" % (labels["false"], labels["pictures"]), number(tree["localisation"]["max_m"], 2),
        number(result["seconds"], 0), "FAILED" if tree["failures"] else "passed"]


def reasons(result):
    """Why it did not pass; empty: it did."""
    return [result["error"]] if result["tree"] is None else result["tree"]["failures"]


def lines(results):
    """The table, what failed, and a sentence."""
    text = [table([TITLES] + [row(one) for one in results], "<><<>>>>>>><")]
    for one in results:
        for reason in reasons(one):
            text.append("%s, seed %d: %s" % (one["name"], one["seed"], reason))
    passed = sum(not reasons(one) for one in results)
    collided = sum(bool(one["tree"] and one["tree"]["collisions"]) for one in results)
    text.append("%d of %d drives passed, %d with a collision, %d without a drive" % (
        passed, len(results), collided, sum(one["tree"] is None for one in results)))
    return text


def junit(results):
    """@return XML text: a test case for each drive. A drive that failed is a failure, one that did not begin an error."""
    root = ElementTree.Element("testsuite", {
        "name": "scenario_suite", "tests": str(len(results)),
        "failures": str(sum(one["tree"] is not None and bool(reasons(one)) for one in results)),
        "errors": str(sum(one["tree"] is None for one in results)),
        "time": "%.1f" % sum(one["seconds"] for one in results)})
    for one in results:
        case = ElementTree.SubElement(root, "testcase", {
            "classname": "scenario_suite.%s" % one["name"], "name": "seed_%d" % one["seed"],
            "time": "%.1f" % one["seconds"]})
        for reason in reasons(one)[:1]:
            kind = "error" if one["tree"] is None else "failure"
            ElementTree.SubElement(case, kind, {"message": reason}).text = "\n".join(reasons(one))
        if one["tree"] is not None:
            ElementTree.SubElement(case, "system-out").text = ", ".join(
                "%s %s" % pair for pair in zip(TITLES[2:], row(one)[2:]))
    ElementTree.indent(root)
    return "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n" + ElementTree.tostring(root, encoding="unicode") + "\n"
