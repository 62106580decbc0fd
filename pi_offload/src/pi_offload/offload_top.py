"""Where the vehicle's tasks are done and why: the latest decisions of a coordinator with what was expected and what came,
and its nodes. One table per second."""

import argparse
import collections
import sys
import threading
import time

CLEAR = "\x1b[H\x1b[2J"
PATIENCE_S = 10.0
WINDOW_S = 10.0
TASK = "%-9s %-16s %-9s %9s %7s %8s %9s %7s  %s"
NODE = "%-16s %-12s %8s %9s %7s %7s %8s %6s %8s %8s %10s"


def milliseconds(seconds):
    return "%.0f" % (1e3 * seconds)


def remarks(decision):
    """What is unusual in how it ended."""
    return [word for word, holds in (("LATE", not decision.by_deadline), ("DROPPED", decision.dropped),
                                     ("hedged", decision.hedged)) if holds]


def task_row(decision):
    return TASK % (decision.kind, (decision.node or "vehicle")[:16], decision.how, milliseconds(decision.expected_time),
                   milliseconds(decision.response_time), milliseconds(decision.deadline),
                   "%.3f" % decision.expected_energy, "%.3f" % decision.energy,
                   ", ".join([*remarks(decision), decision.reason]))


def summary(decisions, seconds):
    """One line. @param decisions  of the last so many seconds"""
    count = len(decisions)
    if not count:
        return "no tasks in %.0f s" % seconds
    return "%.1f tasks/s, %.0f %% done by nodes, %d late, %d dropped, %d hedged; %.2f W by the model (%.2f W expected)" % (
        count / seconds, 100.0 * sum(one.how == "remote" for one in decisions) / count,
        sum(not one.by_deadline for one in decisions), sum(one.dropped for one in decisions),
        sum(one.hedged for one in decisions), sum(one.energy for one in decisions) / seconds,
        sum(one.expected_energy for one in decisions) / seconds)


def node_rows(nodes):
    """@param nodes  EdgeNodeStatus"""
    rows = [NODE % ("node", "state", "trip ms", "Mbit/s", "sent", "late", "refused", "lost", "unasked", "checked",
                    "disagreed")]
    for one in nodes:
        state = ("distrusted" if one.distrusted else "out of range" if not one.in_range else
                 "connected" if one.connected else "silent")
        rows.append(NODE % (one.node.id[:16], state, "%.1f" % (1e3 * one.round_trip), "%.1f" % one.uplink, one.sent,
                            one.late, one.refused, one.lost, one.unasked, one.checked, one.disagreed))
        if one.distrusted:
            rows.append("  %s" % one.distrusted)
    return rows


class Recent:
    """Decisions of the last seconds. Any thread."""

    def __init__(self, clock=time.monotonic):
        self._clock, self._lock = clock, threading.Lock()
        self._decisions = collections.deque()
        self.came = threading.Event()

    def add(self, decision):
        with self._lock:
            self._decisions.append((self._clock(), decision))
        self.came.set()

    def lines(self, rows, nodes):
        """The table with so many tasks, the newest first."""
        with self._lock:
            while self._decisions and self._decisions[0][0] < self._clock() - WINDOW_S:
                self._decisions.popleft()
            decisions = [decision for _, decision in self._decisions]
        head = TASK % ("task", "where", "how", "expect ms", "real ms", "deadline", "expect J", "real J", "why")
        return [summary(decisions, WINDOW_S), "", head, *(task_row(one) for one in decisions[:-rows - 1:-1]), "",
                *node_rows(nodes)]


def main():
    import rospy
    from pi_offload.msg import OffloadDecision
    from pi_offload.srv import Nodes
    parser = argparse.ArgumentParser(prog="offload_top", description=__doc__)
    parser.add_argument("--node", default="/coordinator", help="of the coordinator; default: %(default)s")
    parser.add_argument("--tasks", type=int, default=15, help="lines of tasks; default: %(default)s")
    parser.add_argument("--count", type=int, default=0, metavar="N", help="ends after N tables; default: goes on")
    options = parser.parse_args(rospy.myargv()[1:])
    if options.tasks < 1:
        parser.error("--tasks %d: must be at least 1" % options.tasks)
    rospy.init_node("offload_top", anonymous=True, disable_signals=True)
    recent, topic, shown = Recent(), options.node + "/decisions", 0
    subscriber = rospy.Subscriber(topic, OffloadDecision, recent.add, queue_size=100)
    ask = rospy.ServiceProxy(options.node + "/nodes", Nodes)
    try:
        if not recent.came.wait(PATIENCE_S):
            print("offload_top: nothing on %s for %.0f s; start the coordinator and listen to its detections, or give "
                  "its name by --node" % (topic, PATIENCE_S), file=sys.stderr)
            return 1
        while True:
            lines = recent.lines(options.tasks, ask().nodes)
            print((CLEAR if sys.stdout.isatty() else "") + "\n".join(lines) + "\n", flush=True)
            shown += 1
            if shown == options.count:
                return 0
            threading.Event().wait(1.0)
    except rospy.ServiceException as error:
        print("offload_top: %s/nodes: %s" % (options.node, error), file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 0
    finally:
        subscriber.unregister()
