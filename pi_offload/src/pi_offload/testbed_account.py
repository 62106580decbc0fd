"""What became of the tasks of a phase of the test bed: numbers from what the vehicle saw."""

import math


def quantile(values, share):
    """The least value that is not below `share` of all; nan of none."""
    ordered = sorted(values)
    return ordered[max(math.ceil(share * len(ordered)), 1) - 1] if ordered else math.nan


def _ends(decisions):
    response = [decision["response_s"] for decision in decisions]
    late = [decision["response_s"] - decision["deadline_s"] for decision in decisions
            if decision["response_s"] > decision["deadline_s"]]
    ends = {how: sum(decision["how"] == how for decision in decisions)
            for how in ("local", "remote", "fallback", "abandoned")}
    ends.update(late=len(late), latest_s=max(late, default=0.0), p50_s=quantile(response, 0.5),
                p95_s=quantile(response, 0.95), p99_s=quantile(response, 0.99), max_s=max(response, default=math.nan))
    remote = [decision["response_s"] for decision in decisions if decision["how"] == "remote"]
    ends.update(remote_p50_s=quantile(remote, 0.5), remote_p95_s=quantile(remote, 0.95),
                remote_p99_s=quantile(remote, 0.99))
    nodes = [decision["node"] for decision in decisions if decision["node"]]
    ends["handovers"] = sum(a != b for a, b in zip(nodes, nodes[1:]))
    return ends


def detection_account(pictures, results, decisions):
    """What became of pictures.

    @param pictures   their stamps, in the order in which they were taken [ns]
    @param results    [(stamp, s from there until the result was seen)] in the order in which they came
    @param decisions  those of the coordinator, in the order in which they came
    @return numbers; each picture counts once in `once`, `twice` (or more often) and `never`, by its results; and in
            `late` if the coordinator had its result after the deadline, by `latest_s` at most. `unexpected` results are
            those of no picture; `overtaken` ones came after that of a later picture. `dropped` are those of `late` that
            were not published, as a later one was out.
    """
    counts = dict.fromkeys(pictures, 0)
    unexpected = overtaken = 0
    last = 0
    for stamp, _ in results:
        if stamp in counts:
            counts[stamp] += 1
        else:
            unexpected += 1
        overtaken += stamp < last
        last = max(last, stamp)
    mine = [decision for decision in decisions if decision["kind"] == "detection" and decision["stamp"] in counts]
    late = {decision["stamp"] for decision in mine if decision["response_s"] > decision["deadline_s"]}
    decided = {}
    for decision in mine:
        decided[decision["stamp"]] = decided.get(decision["stamp"], 0) + 1
    seen = [delay for stamp, delay in results if stamp in counts]
    account = {"tasks": len(pictures), "once": sum(count == 1 for count in counts.values()),
               "twice": sum(count > 1 for count in counts.values()),
               "never": sum(count == 0 and stamp not in late for stamp, count in counts.items()),
               "dropped": sum(count == 0 and stamp in late for stamp, count in counts.items()), "unexpected": unexpected,
               "overtaken": overtaken, "decided_twice": sum(count > 1 for count in decided.values()),
               "undecided": sum(stamp not in decided for stamp in counts),
               "seen_p50_s": quantile(seen, 0.5), "seen_p95_s": quantile(seen, 0.95)}
    account.update(_ends(mine))
    return account


def speech_account(decisions, commands):
    """What became of utterances.

    @param decisions  those of the coordinator
    @param commands   [(begin of the speech [ns], text, accepted, s from the end of the speech)] of the recogniser
    @return numbers as of detection_account(); `twice` are utterances that the recogniser answered more often than once.
    """
    mine = [decision for decision in decisions if decision["kind"] == "speech"]
    begins = [begin for begin, _, _, _ in commands]
    account = {"tasks": len(mine), "answered": len(set(begins)), "twice": len(begins) - len(set(begins)),
               "accepted": sum(bool(accepted) for _, _, accepted, _ in commands),
               "latency_p50_s": quantile([latency for _, _, _, latency in commands], 0.5)}
    account.update(_ends(mine))
    return account


def add(total, account):
    """Adds the counts of a phase; quantiles cannot be added and stay out, of the largest values the largest counts."""
    for name, value in account.items():
        if isinstance(value, int):
            total[name] = total.get(name, 0) + value
        elif name in ("latest_s", "max_s") and not math.isnan(value):
            total[name] = max(total.get(name, 0.0), value)
    return total


def violations(account, phase):
    """What is wrong whatever the load of the machine: tasks without exactly one answer, as texts."""
    return [f"{phase}: {account[name]} of {account['tasks']} {text}" for name, text in (
        ("twice", "answered twice"), ("never", "never answered"), ("unexpected", "results of no picture"),
        ("decided_twice", "ended twice"), ("undecided", "never ended"), ("abandoned", "given up"))
        if account.get(name)]
