"""Shows an evaluation as text, JSON and plots."""

import math
import re

import numpy as np

from pi_speech import plots
from pi_speech.evaluation import by_speaker, confusion, one_command, operating_curve, per_word, rates

CURVE_POINTS = 200  # of a curve in JSON
RATES = (("accuracy", "right command"), ("wrong", "wrong command"), ("rejected", "rejected command"),
         ("false_other", "false alarms, other speech"), ("false_background", "false alarms, background"),
         ("closed_accuracy", "right whether or not accepted"))


def _latency(results):
    """Of right commands."""
    known = results.latencies_ms[results.accepted & results.right & np.isfinite(results.latencies_ms)]
    if not len(known):
        return {"clips": 0, "median_ms": math.nan, "p95_ms": math.nan}
    return {"clips": len(known), "median_ms": float(np.median(known)), "p95_ms": float(np.percentile(known, 95))}


def figures(results, safety_word, draws, seed):
    """All figures of a file; nan where there is none."""
    curve = operating_curve(results)
    keep = np.unique(np.linspace(0, len(curve["threshold"]) - 1, CURVE_POINTS).round().astype(int))
    rows, columns, counts = confusion(results)
    truth = results.truth
    return {
        "label": results.label,
        "clips": {"commands": int(truth.is_command.sum()), "other": int(truth.is_other.sum()),
                  "background": int(truth.is_background.sum())},
        "rates": rates(results),
        "words": per_word(results),
        "safety": one_command(results, safety_word) if safety_word in truth.commands else None,
        "speakers": by_speaker(results, draws, seed),
        "latency": _latency(results),
        "curve": {name: [float(v) for v in values[keep]] for name, values in curve.items()},
        "confusion": {"said": rows, "recognised": columns, "counts": counts.tolist()},
    }


def plain(value):
    """For JSON, which has no nan."""
    if isinstance(value, dict):
        return {key: plain(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(entry) for entry in value]
    if isinstance(value, float):
        return round(value, 6) if math.isfinite(value) else None
    return value


def _percent(value, width=6):
    return f"{'-':>{width}}" if math.isnan(value) else f"{100 * value:{width}.1f}"


def text(entry):
    """Tables of one file's figures."""
    clips, shares, speakers = entry["clips"], entry["rates"], entry["speakers"]
    lines = [f"{entry['label']}: {clips['commands']} commands, {clips['other']} of other speech, "
             f"{clips['background']} of background", ""]
    for name, title in RATES:
        line = f"{title:32}{_percent(shares[name])} %"
        interval = speakers["intervals_95"].get(name) if speakers else None
        if interval and not math.isnan(interval[0]):
            line += f"   95 % over speakers: {100 * interval[0]:.1f} .. {100 * interval[1]:.1f}"
        lines.append(line)
    if speakers and speakers["accuracy_of_speakers"]:
        spread = speakers["accuracy_of_speakers"]
        lines.append(f"{'accuracy of speakers':32}10 % of {spread['speakers']} have at most "
                     f"{_percent(spread['p10'], 0)} %, half at most {_percent(spread['p50'], 0)} %, "
                     f"90 % at most {_percent(spread['p90'], 0)} %")
    latency = entry["latency"]
    if latency["clips"]:
        lines.append(f"{'latency':32}median {latency['median_ms']:.0f} ms, p95 {latency['p95_ms']:.0f} ms "
                     f"({latency['clips']} clips)")
    width = max([len(word) for word in entry["words"]] + [7])
    lines += ["", f"{'command':{width}}  clips  recall  wrong  rejected  precision  taken for   [%]"]
    for word, row in entry["words"].items():
        taken = ", ".join(f"{name} {count}" for name, count in list(row["taken_for"].items())[:4])
        lines.append(f"{word:{width}} {row['clips']:6d}  {_percent(row['recall'])} {_percent(row['wrong'])}  "
                     f"{_percent(row['rejected'], 8)}  {_percent(row['precision'], 9)}  {taken}".rstrip())
    safety = entry["safety"]
    if safety:
        lines += ["", f'"{safety["word"]}": recall {_percent(safety["recall"], 0)} %, taken for another command '
                  f'{_percent(safety["taken_for_others"], 0)} %, rejected {_percent(safety["rejected"], 0)} %; false '
                  f'on other commands {_percent(safety["false_commands"], 0)} %, other speech '
                  f'{_percent(safety["false_other"], 0)} %, background {_percent(safety["false_background"], 0)} %'
                  + ("" if math.isnan(safety["latency_median_ms"]) else
                     f'; latency median {safety["latency_median_ms"]:.0f} ms')]
    return "\n".join(lines)


def comparison(entries):
    """One line per file."""
    width = max([len(entry["label"]) for entry in entries] + [5])
    lines = [f"{'':{width}}  right  wrong  rejected  other  background   [%]"]
    for entry in entries:
        shares = entry["rates"]
        lines.append(f"{entry['label']:{width}} {_percent(shares['accuracy'])} {_percent(shares['wrong'])}  "
                     f"{_percent(shares['rejected'], 8)} {_percent(shares['false_other'])}  "
                     f"{_percent(shares['false_background'], 10)}")
    return "\n".join(lines)


def plot_curve(results, entry, path):
    """Right commands over false alarms, as the threshold falls; dots: as accepted in the file."""
    pyplot = plots.pyplot()
    figure, axes = pyplot.subplots(figsize=(7, 5))
    curve, shares = operating_curve(results), entry["rates"]
    for name, title in (("false_other", "other speech"), ("false_background", "background"),
                        ("wrong", "wrong command")):
        if np.isnan(curve[name]).any():
            continue
        line, = axes.plot(100 * curve[name], 100 * curve["accuracy"], label=title, drawstyle="steps-post")
        axes.plot([100 * shares[name]], [100 * shares["accuracy"]], "o", color=line.get_color())
    axes.set(xlim=(0, 50), ylim=(0, 102), xlabel="false alarms, or commands taken for another [% of clips]",
             ylabel="commands accepted and right [%]", title=f"{entry['label']} (dots: as accepted)")
    axes.grid(alpha=0.3)
    if axes.lines:
        axes.legend(frameon=False)
    plots.save(figure, path)


def plot_confusion(entry, path):
    """Shares of each row."""
    pyplot = plots.pyplot()
    table = entry["confusion"]
    counts = np.array(table["counts"])
    shares = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
    figure, axes = pyplot.subplots(figsize=(2 + 0.55 * counts.shape[1], 1.5 + 0.45 * counts.shape[0]))
    axes.imshow(shares, cmap="Blues", vmin=0, vmax=1, aspect="auto")
    axes.set_xticks(range(counts.shape[1]), table["recognised"], rotation=45, ha="right")
    axes.set_yticks(range(counts.shape[0]), table["said"])
    axes.set(xlabel="recognised", ylabel="said", title=f"{entry['label']} [% of row]")
    for (row, column), value in np.ndenumerate(shares):
        if counts[row, column]:
            axes.text(column, row, f"{100 * value:.0f}" if value >= 0.005 else "<1", ha="center", va="center",
                      fontsize=8, color="white" if value > 0.5 else "black")
    plots.save(figure, path)


def plot_latency(results, entry, path):
    """Histogram of right commands. @return False if no latency is known"""
    known = results.latencies_ms[results.accepted & results.right & np.isfinite(results.latencies_ms)]
    if not len(known):
        return False
    pyplot = plots.pyplot()
    figure, axes = pyplot.subplots(figsize=(7, 4))
    axes.hist(known, bins=np.arange(math.floor(known.min() / 20) * 20, known.max() + 40, 20))
    axes.axvline(entry["latency"]["median_ms"], color="black", linewidth=1,
                 label=f"median {entry['latency']['median_ms']:.0f} ms")
    axes.set(xlabel="from the end of speech to the decision [ms]", ylabel="commands", title=entry["label"])
    axes.legend(frameon=False)
    plots.save(figure, path)
    return True


def decibels(label):
    """The number of a label such as "10 dB"; None if it is no such label."""
    match = re.fullmatch(r"\s*([-+]?\d+(?:\.\d+)?)\s*dB\s*", label, re.IGNORECASE)
    return float(match.group(1)) if match else None


def plot_comparison(entries, path):
    """Rates of several files: over the ratio of speech to noise if all labels are such ones, else side by side."""
    pyplot = plots.pyplot()
    levels = [decibels(entry["label"]) for entry in entries]
    is_curve = None not in levels
    order = np.argsort(levels, kind="stable") if is_curve else np.arange(len(entries))
    positions = [levels[i] for i in order] if is_curve else list(range(len(entries)))
    figure, axes = pyplot.subplots(figsize=(7, 4.5))
    for name, title in RATES[:5]:
        values = [100 * entries[i]["rates"][name] for i in order]
        if not np.isnan(values).all():
            axes.plot(positions, values, marker="o", label=title, linestyle="-" if is_curve else "none")
    if is_curve:
        axes.set_xlabel("speech over noise [dB]")
    else:
        axes.set_xticks(positions, [entries[i]["label"] for i in order], rotation=30, ha="right")
    axes.set(ylim=(0, 102), ylabel="share of clips [%]")
    axes.grid(alpha=0.3)
    axes.legend(frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    plots.save(figure, path)
