"""`pi_os keys`: the keys by which bridges with `secure: tls` prove who they are, made by the program openssl.

A folder holds authority.pem, device.pem and device.key of this device, and authority.key where further devices are
added; or shared.key, lines of an id and a key. All files are for their owner alone. src/wire/tls_keys.h reads them.
"""
import contextlib
import io
import os
import re
import secrets
import shutil
import socket
import subprocess
import tarfile
import tempfile

FOLDER = '~/.config/pi_os/keys'
NAME = re.compile(r'[A-Za-z0-9._-]{1,64}')
AUTHORITY_DAYS, DEVICE_DAYS = 7300, 3650
AUTHORITY, AUTHORITY_KEY, DEVICE, DEVICE_KEY, SHARED = ('authority.pem', 'authority.key', 'device.pem', 'device.key',
                                                        'shared.key')
BUNDLE = '.pi_os_keys'
EXTENSIONS = '''basicConstraints = critical, CA:FALSE
keyUsage = critical, digitalSignature
extendedKeyUsage = serverAuth, clientAuth
subjectKeyIdentifier = hash
authorityKeyIdentifier = keyid
'''
NEW_KEY = ['-newkey', 'ec', '-pkeyopt', 'ec_paramgen_curve:P-256', '-nodes']


class KeysError(Exception):
    """Keys cannot be made; the text names the file and the way out."""


def add_commands(commands):
    """Adds `keys` and its own commands to a parser."""
    keys = commands.add_parser('keys', help='makes the keys by which bridges prove who they are')
    verbs = keys.add_subparsers(dest='verb', required=True)
    init = verbs.add_parser('init', help='makes the authority of the fleet, and the certificate of this device')
    init.add_argument('--name', default=socket.gethostname(), help='of this device (default: %(default)s)')
    init.add_argument('--shared-key', action='store_true', help='one key that all devices share, without certificates')
    add = verbs.add_parser('add', help='makes a bundle of keys for another device')
    add.add_argument('name', help='of that device')
    install = verbs.add_parser('install', help='unpacks such a bundle on that device')
    install.add_argument('bundle')
    for verb in (init, add, install):
        verb.add_argument('--folder', default=os.path.expanduser(FOLDER), help='of the keys (default: %(default)s)')


def run(options):
    """Does what `pi_os keys` was asked for. Raises KeysError."""
    os.umask(0o077)
    {'init': init, 'add': add, 'install': install}[options.verb](options)


def init(options):
    _require_name(options.name)
    os.makedirs(options.folder, mode=0o700, exist_ok=True)
    there = [name for name in (AUTHORITY, AUTHORITY_KEY, DEVICE, DEVICE_KEY, SHARED)
             if os.path.exists(os.path.join(options.folder, name))]
    if there:
        raise KeysError('%s exists already: move the folder away to begin anew, which ends the trust of all devices'
                        % os.path.join(options.folder, there[0]))
    if options.shared_key:
        key_id = 'fleet-' + secrets.token_hex(4)
        _write(os.path.join(options.folder, SHARED), '%s %s\n' % (key_id, secrets.token_hex(32)))
        print('shared key "%s" in %s' % (key_id, options.folder))
        return
    authority, authority_key = (os.path.join(options.folder, name) for name in (AUTHORITY, AUTHORITY_KEY))
    _openssl('req', '-x509', *NEW_KEY, '-days', AUTHORITY_DAYS, '-subj', '/CN=pi_os fleet ' + secrets.token_hex(4),
             '-addext', 'basicConstraints=critical,CA:TRUE', '-addext', 'keyUsage=critical,keyCertSign',
             '-keyout', authority_key, '-out', authority)
    _certify(options.folder, options.name, options.folder)
    print('authority of the fleet, and certificate of "%s", in %s' % (options.name, options.folder))


def add(options):
    _require_name(options.name)
    bundle = options.name + BUNDLE
    if os.path.exists(bundle):
        raise KeysError('%s exists already: move it away' % bundle)
    with tempfile.TemporaryDirectory() as made:
        if os.path.exists(os.path.join(options.folder, AUTHORITY_KEY)):
            _certify(options.folder, options.name, made)
            shutil.copy(os.path.join(options.folder, AUTHORITY), made)
        elif os.path.exists(os.path.join(options.folder, SHARED)):
            shutil.copy(os.path.join(options.folder, SHARED), made)
        else:
            raise KeysError('%s holds no key of an authority: run this where `pi_os keys init` was run'
                            % options.folder)
        packed = io.BytesIO()
        with tarfile.open(fileobj=packed, mode='w') as archive:
            for name in sorted(os.listdir(made)):
                archive.add(os.path.join(made, name), name)
        _write(bundle, packed.getvalue())
    print('%s: copy it to "%s", run there `rosrun pi_os_transport pi_os keys install %s`, delete it'
          % (bundle, options.name, bundle))


def install(options):
    try:
        with tarfile.open(options.bundle) as archive:
            files = {member.name: archive.extractfile(member).read() for member in archive if member.isfile()}
    except (OSError, tarfile.TarError) as error:
        raise KeysError('%s is no bundle of keys: %s' % (options.bundle, error)) from None
    if set(files) not in ({AUTHORITY, DEVICE, DEVICE_KEY}, {SHARED}):
        raise KeysError('%s holds %s, which is no bundle of keys'
                        % (options.bundle, ', '.join(sorted(files)) or 'nothing'))
    os.makedirs(options.folder, mode=0o700, exist_ok=True)
    if os.path.exists(os.path.join(options.folder, AUTHORITY_KEY)):
        raise KeysError('%s holds the authority of a fleet: move the folder away to join another' % options.folder)
    for name in (DEVICE, SHARED):  # of two kinds of keys the bridge would take one
        with contextlib.suppress(FileNotFoundError):
            os.remove(os.path.join(options.folder, name))
    for name, content in files.items():
        _write(os.path.join(options.folder, name), content)
    print('keys in %s; set secure: tls' % options.folder)


def _certify(authority, name, folder):
    """Makes key and certificate of a device."""
    with tempfile.TemporaryDirectory() as scratch:
        request, extensions = (os.path.join(scratch, file) for file in ('request', 'extensions'))
        _write(extensions, EXTENSIONS)
        _openssl('req', '-new', *NEW_KEY, '-subj', '/CN=' + name, '-keyout', os.path.join(folder, DEVICE_KEY),
                 '-out', request)
        _openssl('x509', '-req', '-in', request, '-days', DEVICE_DAYS, '-extfile', extensions,
                 '-CA', os.path.join(authority, AUTHORITY), '-CAkey', os.path.join(authority, AUTHORITY_KEY),
                 '-set_serial', '0x' + secrets.token_hex(16), '-out', os.path.join(folder, DEVICE))


def _openssl(*arguments):
    try:
        done = subprocess.run(['openssl', *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                              text=True)
    except FileNotFoundError:
        raise KeysError('the program openssl is missing: apt-get install openssl') from None
    if done.returncode != 0:
        raise KeysError('openssl %s: %s' % (arguments[0], done.stdout.strip().splitlines()[-1]))


def _write(path, content):
    """A file for its owner alone, in place of one of the same name."""
    with contextlib.suppress(FileNotFoundError):
        os.remove(path)
    with open(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600),
              'wb' if isinstance(content, bytes) else 'w') as file:
        file.write(content)


def _require_name(name):
    if not NAME.fullmatch(name):
        raise KeysError('the name "%s" must be 1 to 64 letters, digits, ".", "_" or "-"' % name)
