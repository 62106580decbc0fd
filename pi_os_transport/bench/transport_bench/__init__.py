"""Compares transports between unmodified roscpp nodes: stock TCPROS, TCPROS with tcpNoDelay, and π-OS.

The nodes (bench_publisher, bench_subscriber) know only the topic API of roscpp; whether a round runs over π-OS is
decided by LD_PRELOAD alone and verified afterwards by getBusInfo of every node. Nodes are steered by lines on their
standard input and answer on standard output, so nothing here depends on timing: the script waits for answers, with
deadlines.
"""

from . import small_messages
from .group import Group
from .measurements import Comparison, Plan, percentile
from .modes import FULL_HD, LIBRARY_NAME, MODES, BenchError, find_library
from .nodes import Master, parse_smaps
from .output import plot, report, require_matplotlib
from .results import Results, bars, machine

__all__ = ['FULL_HD', 'LIBRARY_NAME', 'MODES', 'BenchError', 'Comparison', 'Group', 'Master', 'Plan', 'Results', 'bars',
           'find_library', 'machine', 'parse_smaps', 'percentile', 'plot', 'report', 'require_matplotlib',
           'small_messages']
