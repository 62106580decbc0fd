#!/usr/bin/env python3
"""Draws the figures of bench_scheduler as the paper's figure 9, with the optimum: plot_scheduler.py FILE.csv FILE.png"""

import csv
import sys

import matplotlib
matplotlib.use('Agg')
import matplotlib.pyplot as plt

# Name in the CSV file, label, colour.
BARS = [
    ('diff_min', 'Diff-Min, largest Div first (paper, formal steps)', '#d95f02'),
    ('dm_min_div', 'Diff-Min, smallest Div first (paper, prose)', '#f4b183'),
    ('sufferage', 'Sufferage', '#a6a6a6'),
    ('search', 'search (default of pi_runtime)', '#1b7837'),
]


def read_cells(path):
    """Rows by number of units, number of tasks and policy."""
    cells = {}
    with open(path, newline='') as file:
        for row in csv.DictReader(file):
            cells.setdefault(int(row['units']), {}).setdefault(int(row['tasks']), {})[row['policy']] = row
    return cells


def draw_panel(axes, units, cells):
    tasks = sorted(cells)
    width = 0.8 / len(BARS)
    for k, (name, label, colour) in enumerate(BARS):
        rows = [cells[count][name] for count in tasks]
        axes.bar([x + (k - (len(BARS) - 1) / 2) * width for x in range(len(tasks))],
                 [float(row['normalised_makespan']) for row in rows], width, label=label, color=colour,
                 yerr=[2 * float(row['standard_error']) for row in rows], error_kw={'lw': 0.8, 'ecolor': '#404040'})
    for x, count in enumerate(tasks):
        optimum = float(cells[count]['optimum']['normalised_makespan'])
        axes.plot([x - 0.45, x + 0.45], [optimum, optimum], color='black', lw=1.5,
                  label='proven optimum' if x == 0 else None)
    axes.axhline(1.0, color='#2166ac', lw=1.2, ls='--', label='Min-Min (the baseline, 1)')
    axes.set_title(f'{units} computing units')
    axes.set_xticks(range(len(tasks)), tasks)
    axes.set_ylim(0.7, 1.15)
    axes.grid(axis='y', lw=0.3)
    axes.set_axisbelow(True)


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    cells = read_cells(sys.argv[1])
    figure, panels = plt.subplots(2, 2, figsize=(11, 8), sharey=True)
    for axes, units in zip(panels.flat, sorted(cells)):
        draw_panel(axes, units, cells[units])
    for axes in panels[:, 0]:
        axes.set_ylabel('time until all tasks are done\n(Min-Min = 1, axis from 0.7)')
    for axes in panels[1]:
        axes.set_xlabel('number of tasks')
    handles, labels = panels[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc='lower center', ncol=3, frameon=False)
    figure.suptitle('Mapping independent tasks to unequal units: the setting of the paper\'s figure 9\n'
                    'mean of the sets; bars with two standard errors', fontsize=12)
    figure.tight_layout(rect=(0, 0.07, 1, 1))  # room for the legend
    figure.savefig(sys.argv[2], dpi=110)


if __name__ == '__main__':
    main()
