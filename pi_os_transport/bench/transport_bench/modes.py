"""What is compared, transports and payload sizes, and where the programs and the library are."""

import dataclasses
import os
import re

LIBRARY_NAME = 'libpi_os_transport.so'
FULL_HD = 1920 * 1080 * 3


class BenchError(Exception):
    """The comparison is void: a message was lost, corrupt or out of order, a node died, or a transport was wrong."""


@dataclasses.dataclass(frozen=True)
class Mode:
    key: str              # in options and JSON
    label: str            # in tables
    transport: str        # what getBusInfo must say of every link
    preload: bool
    subscriber_args: tuple = ()
    variables: tuple = ()  # environment of its nodes: (name, value)
    usual: bool = True     # compared unless the caller chooses
    bridge_args: tuple = ()


MODES = {mode.key: mode for mode in (
    Mode('tcpros', 'TCPROS', 'TCPROS', False),
    Mode('nodelay', 'tcpNoDelay', 'TCPROS', False, ('--tcp-no-delay',)),
    Mode('pi_os', 'π-OS', 'SHMROS', True),
    Mode('pi_os_filled', 'π-OS zero fill', 'SHMROS', True, variables=(('PI_OS_SKIP_ZERO_FILL', '0'),), usual=False),
)}


def format_size(size):
    if size == FULL_HD:
        return '6.2 MB'
    for unit, factor in (('MB', 1e6), ('kB', 1e3)):
        if size >= factor:
            return f'{size / factor:.3g} {unit}'
    return f'{size} B'


def program_folder():
    """Folder of bench_publisher and its siblings: that of this package, in the devel space as in the install space."""
    package = os.path.dirname(os.path.realpath(__file__))
    folder = os.path.dirname(package)
    if not os.access(os.path.join(folder, 'bench_publisher'), os.X_OK):
        raise BenchError(f'bench_publisher is not beside {package}: build the package and start bench_transport from '
                         'its devel or install space (rosrun pi_os_transport bench_transport)')
    return folder


def find_library(given=None):
    """Path of the library to preload: the one given, or the one of the prefix that this module was started from."""
    if given:
        candidates = [os.path.abspath(given)]
    else:
        prefixes = [os.path.dirname(os.path.dirname(program_folder()))]
        prefixes += [p for p in os.environ.get('CMAKE_PREFIX_PATH', '').split(':') if p]
        candidates = [os.path.join(prefix, 'lib', LIBRARY_NAME) for prefix in dict.fromkeys(prefixes)]
    for candidate in candidates:
        if os.path.isfile(candidate):
            return candidate
    raise BenchError(f'{LIBRARY_NAME} not found, looked for ' + ', '.join(candidates) +
                     '; build the package, name the file with --library, or leave π-OS out with --modes tcpros,nodelay')


def environment(extra=None):
    """Environment of the nodes: that of the caller without any preload of π-OS."""
    env = dict(os.environ)
    preload = [p for p in re.split(r'[:\s]+', env.pop('LD_PRELOAD', '')) if p and LIBRARY_NAME not in p]
    if preload:
        env['LD_PRELOAD'] = ':'.join(preload)
    env.update(extra or {})
    return env
