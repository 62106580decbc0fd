"""Keys for the bridges of a test bed, as `pi_os keys` makes them."""

import os

from .devices import pi_os_program


def make_keys(testbed, name='keys', shared=False):
    """A fleet: the first device has the authority, or the key that all share. @return arguments of each device's
    bridge, by the name of the device."""
    folders = {device: os.path.join(testbed.folder, f'{name}_{device}') for device in testbed.devices}
    first, *others = testbed.devices.values()

    def run(*command):
        first.run('sh', '-c', 'cd "$0" && exec "$@"', testbed.folder, pi_os_program(), 'keys', *command)
    run('init', '--folder', folders[first.name], '--name', first.name, *['--shared-key'] * shared)
    for device in others:
        bundle = os.path.join(testbed.folder, device.name + '.pi_os_keys')
        run('add', device.name, '--folder', folders[first.name])
        run('install', bundle, '--folder', folders[device.name])
        os.remove(bundle)
    return {device: ('--secure', 'tls', '--keys', folder) for device, folder in folders.items()}
