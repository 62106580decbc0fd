"""What the benchmark programs have in common: parts of their arguments and output, their exit status."""

import argparse
import json
import os
import shlex
import sys

from .modes import LIBRARY_NAME, BenchError


def parse_positive(text):
    if not text.strip().isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f'{text!r}, must be a whole number of at least 1')
    return int(text)


def parse_list(parse):
    return lambda text: [parse(part) for part in text.split(',')]


def add_library(parser):
    parser.add_argument('--library', help=f'path of {LIBRARY_NAME}; default: that of the same prefix')


def add_json(parser):
    parser.add_argument('--json', metavar='FILE', help='write everything measured to FILE')


def parse(parser):
    """The arguments of this program, without the remappings such as __name:=x that rosrun and roslaunch add."""
    return parser.parse_args([argument for argument in sys.argv[1:] if ':=' not in argument])


def command(name):
    """What to type to repeat this run."""
    return f'rosrun pi_os_transport {name} {shlex.join(sys.argv[1:])}'.rstrip()


def require_writable(*paths):
    """Before anything is measured. A path that is None is not wanted."""
    for path in filter(None, paths):
        folder = os.path.dirname(os.path.abspath(path))
        if not os.access(folder, os.W_OK):
            raise BenchError(f'cannot write {path}: {folder} does not exist or is not writable')


def progress(text):
    print(text, file=sys.stderr, flush=True)


def print_machine(machine):
    print(f'\n{machine["cpu"]}, {machine["usable_cores"]} core(s), {machine["memory_gb"]} GB, '
          f'Linux {machine["kernel"]} {machine["architecture"]}, governor {machine["governor"]}, '
          f'load average at the start {machine["load_average"][0]:.2f}')
    print(', '.join([f'{name} {version}' for name, version in machine['versions'].items()] +
                    [f'{key}={value}' for key, value in machine['settings'].items()]))


def print_bars(bars):
    if bars:
        print('\nBars (median of the rounds, spread = min..max of the rounds)')
    for bar in bars:
        print('  ' + bar.line())


def print_warnings(warnings):
    for warning in sorted(set(warnings)):
        print('node wrote: ' + warning, file=sys.stderr)


def write_json(path, values, bars=()):
    """Nothing if `path` is None."""
    if not path:
        return
    if bars:
        values = {**values,
                  'bars': [{'text': bar.text, 'median': bar.value[0], 'min': bar.value[1], 'max': bar.value[2],
                            'bound': bar.bound, 'at_least': bar.at_least, 'unit': bar.unit, 'met': bar.met(),
                            'note': bar.note} for bar in bars]}
    with open(path, 'w') as file:
        json.dump(values, file, indent=1, ensure_ascii=False)
    print(f'\nwritten: {path}')


def exit_status(name, run, *arguments):
    """Of run(*arguments), which returns what failed, as texts; None: nothing."""
    try:
        failures = run(*arguments) or []
    except (BenchError, OSError) as error:
        failures = [str(error)]
    except KeyboardInterrupt:
        print(f'{name}: interrupted', file=sys.stderr)
        return 130
    for failure in failures:
        print(f'{name}: FAILED: {failure}', file=sys.stderr)
    return 1 if failures else 0
