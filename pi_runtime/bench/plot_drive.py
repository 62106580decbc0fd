#!/usr/bin/env python3
"""Draws the response times that `bench_runtime --only drive --output-csv FILE.csv` has written.

plot_drive.py FILE.csv FILE.png
"""

import csv
import sys

import matplotlib
matplotlib.use('Agg')
import matplotlib.pyplot as plt
from matplotlib.ticker import LogLocator, NullFormatter

# Name in the CSV file, title.
STREAMS = [
    ('front_end', 'SLAM front end: 30 pictures per second, about 3 ms of work each'),
    ('detection', 'Object detection: 10 pictures per second, about 70 ms of work each'),
    ('inertial', 'Inertial sensor: 200 readings per second, a few microseconds of work each'),
]
COLOURS = {'ours': '#1b7837', 'static': '#d95f02', 'starpu': '#2166ac'}


class Series:
    """Jobs of one stream under one contender."""

    def __init__(self, row):
        self.name = row['contender']
        self.title = row['title']
        self.deadline_ms = float(row['deadline_ms'])
        self.lost = int(row['lost'])
        self.responses_ms = []

    def late_percent(self):
        late = self.lost + sum(response > self.deadline_ms for response in self.responses_ms)
        return 100.0 * late / (self.lost + len(self.responses_ms))


def read_streams(path):
    """Series by stream and contender, in the order of the file."""
    streams = {}
    with open(path, newline='') as file:
        for row in csv.DictReader(file):
            series = streams.setdefault(row['stream'], {}).setdefault(row['contender'], Series(row))
            series.responses_ms.append(float(row['response_ms']))
    return streams


def draw_panel(axes, title, contenders):
    """One row per contender: a dot per job, its median as a bar, and the share of late jobs in words."""
    for row, series in enumerate(contenders):
        colour = COLOURS[series.name.split('_')[0]]
        count = len(series.responses_ms)
        # Spread over the height of the row in order of time, so that a dot's height is when the job ran.
        heights = [row - 0.35 + 0.7 * k / max(count - 1, 1) for k in range(count)]
        axes.scatter(series.responses_ms, heights, s=4, color=colour, alpha=0.5, linewidths=0)
        median = sorted(series.responses_ms)[count // 2]
        axes.plot([median, median], [row - 0.4, row + 0.4], color='black', lw=1.5)
        late = series.late_percent()
        axes.text(1.01, row, f'{late:.1f} % late' if late > 0 else 'none late', transform=axes.get_yaxis_transform(),
                  va='center', fontsize=9, color='#b2182b' if late > 0 else '#1b7837', fontweight='bold')
    deadline_ms = contenders[0].deadline_ms
    axes.axvline(deadline_ms, color='#b2182b', ls='--', lw=1.3)
    axes.text(deadline_ms, -0.62, f' deadline {deadline_ms:.0f} ms', color='#b2182b', fontsize=9, va='bottom')
    axes.set_xscale('log')
    axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.xaxis.set_major_formatter(lambda value, _: f'{value:g}')
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_yticks(range(len(contenders)), [series.title for series in contenders])
    axes.set_ylim(len(contenders) - 0.4, -0.95)
    axes.grid(axis='x', which='both', lw=0.3)
    axes.set_axisbelow(True)
    axes.set_title(title, fontsize=11, loc='left')


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    streams = read_streams(sys.argv[1])
    shown = [(title, list(streams[name].values())) for name, title in STREAMS if name in streams]
    if not shown:
        sys.exit(f'{sys.argv[1]} has no jobs')
    figure, panels = plt.subplots(len(shown), 1, figsize=(12, 4.2 * len(shown)), layout='constrained', squeeze=False)
    for axes, (title, contenders) in zip(panels[:, 0], shown):
        draw_panel(axes, title, contenders)
    panels[-1, 0].set_xlabel('time from the moment a picture is due until its result is there [ms]')
    figure.suptitle('Two jobs share the computing units: who keeps the deadlines?\n'
                    'Each dot is one job (higher in its row = earlier in the run), the black bar the median', fontsize=12)
    figure.savefig(sys.argv[2], dpi=110)


if __name__ == '__main__':
    main()
