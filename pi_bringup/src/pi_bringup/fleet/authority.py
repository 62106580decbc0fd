"""The fleet's certificates, made by the program openssl: keys of the curve P-256, each in a file of its owner alone."""

import hashlib
import os
import secrets
import subprocess
import tempfile
from datetime import datetime, timezone
from pathlib import Path

CERTIFICATE, KEY, AUTHORITY, AUTHORITY_KEY = "certificate.pem", "key.pem", "ca.pem", "ca.key"
NO_ERRORS = ("Certificate request self-signature ok", "subject=")  # that it also writes where it fails
NEW_KEY = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes")


class FleetError(Exception):
    """What is wrong, and the way out."""


def openssl(*arguments):
    """@return what it writes, as bytes. @throws FleetError"""
    try:
        done = subprocess.run(["openssl", *(str(one) for one in arguments)], capture_output=True, check=False)
    except FileNotFoundError:
        raise FleetError("the program openssl is missing: apt-get install openssl") from None
    except OSError as error:
        raise FleetError(f"openssl cannot be started: {error.strerror}") from None
    if done.returncode != 0:
        said = [line for line in done.stderr.decode(errors="replace").strip().splitlines()
                if not line.startswith(NO_ERRORS)] or [f"status {done.returncode}"]
        raise FleetError(f"openssl {arguments[0]}: {said[0]}")
    return done.stdout


def write(path, text, mode=0o644):
    """Replaces the file in one step: a reader gets the old or the new one. @throws OSError"""
    new = path.with_name(path.name + ".new")
    new.unlink(missing_ok=True)
    with open(os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "w", encoding="utf-8") as file:
        file.write(text)
    new.replace(path)


def make_authority(folder, fleet, days):
    """Writes ca.pem and ca.key."""
    openssl("req", "-x509", *NEW_KEY, "-days", days, "-subj", f"/O={fleet}/CN={fleet} authority {secrets.token_hex(4)}",
            "-addext", "basicConstraints=critical,CA:TRUE,pathlen:0", "-addext", "keyUsage=critical,keyCertSign",
            "-keyout", folder / AUTHORITY_KEY, "-out", folder / AUTHORITY)
    (folder / AUTHORITY_KEY).chmod(0o600)


def certify(authority, folder, subject, days, hosts=()):
    """Writes ca.pem, certificate.pem and key.pem of one end into the folder.
    @param subject  [(name, value)], the widest first, as [("O", fleet), ("OU", role), ("CN", name)].
    @param hosts    of a server, names and addresses; without, the certificate is that of a client.
    @return (fingerprint of the public key as nats-server's pinned_certs, when the certificate expires, as text)"""
    usage = "serverAuth, clientAuth" if hosts else "clientAuth"
    names = ",".join(("IP:" if is_address(host) else "DNS:") + host for host in hosts)
    extensions = ("basicConstraints = critical, CA:FALSE\nkeyUsage = critical, digitalSignature\n"
                  "subjectKeyIdentifier = hash\nauthorityKeyIdentifier = keyid\n"
                  f"extendedKeyUsage = {usage}\n" + (f"subjectAltName = {names}\n" if names else ""))
    with tempfile.TemporaryDirectory() as scratch:
        request, wanted = Path(scratch) / "request", Path(scratch) / "extensions"
        wanted.write_text(extensions, encoding="utf-8")
        openssl("req", "-new", *NEW_KEY, "-subj", "".join(f"/{name}={value}" for name, value in subject),
                "-keyout", folder / KEY, "-out", request)
        (folder / KEY).chmod(0o600)
        openssl("x509", "-req", "-in", request, "-days", days, "-extfile", wanted, "-CA", authority / AUTHORITY,
                "-CAkey", authority / AUTHORITY_KEY, "-set_serial", "0x" + secrets.token_hex(16),
                "-out", folder / CERTIFICATE)
    write(folder / AUTHORITY, (authority / AUTHORITY).read_text(encoding="utf-8"))
    key = openssl("pkey", "-in", folder / KEY, "-pubout", "-outform", "DER")
    return hashlib.sha256(key).hexdigest(), expiry(folder / CERTIFICATE).isoformat()


def expiry(certificate):
    """@return when it ends, in UTC"""
    text = openssl("x509", "-in", certificate, "-noout", "-enddate").decode().strip().partition("=")[2]
    return datetime.strptime(text, "%b %d %H:%M:%S %Y %Z").replace(tzinfo=timezone.utc)


def is_address(host):
    return ":" in host or host.replace(".", "").isdigit()
