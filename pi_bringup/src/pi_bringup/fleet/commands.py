"""pi_edge fleet: makes the keys, certificates and configuration of a fleet whose sites and vehicles meet over NATS.

The folder holds fleet.yaml (who belongs to it), authority/ (ca.pem; ca.key can make members: keep it off the vehicles),
and for each member what is copied to its machine: sites/NAME/server and worker, vehicles/NAME, operators/NAME."""

import contextlib
import fcntl
import os
import re
import secrets
import shutil
import sys
import tempfile
from datetime import datetime, timedelta, timezone
from pathlib import Path

import yaml

from pi_bringup.fleet import authority, configuration
from pi_bringup.fleet.authority import FleetError

FOLDER = Path("~/.config/pi_edge/fleet")
DEVICE_FOLDER = "/etc/pi_edge/fleet"
AUTHORITY_DAYS, MEMBER_DAYS = 3650, 365
SOON_DAYS = 30
STATE = "fleet.yaml"
PORT, ROUTE_PORT, HTTP_PORT = 4222, 6222, 8222
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,31}")
HOST = re.compile(r"(\*\.)?[A-Za-z0-9]([A-Za-z0-9.-]*[A-Za-z0-9])?|[0-9A-Fa-f:]+:[0-9A-Fa-f:.]*")
FOLDERS = {"site": "sites", "vehicle": "vehicles", "operator": "operators"}
RELOAD = "systemctl reload nats-server (or kill -HUP), on every site"


def add_to(commands):
    """Adds the command to pi_edge."""
    verbs = commands.add_parser("fleet", help="makes keys, certificates and configuration of a fleet over NATS",
                                description=__doc__.partition("\n")[0]).add_subparsers(dest="verb", required=True)
    init = verbs.add_parser("init", help="begins a fleet: its authority")
    init.add_argument("--name", help="of the fleet; default: fleet-, and eight digits by chance")
    add = {}
    for role, text in (("site", "a place with nats-server and edge_server"), ("vehicle", "vehicles"),
                       ("operator", "people or programs that see everything and send nothing")):
        add[role] = verbs.add_parser(f"add-{role}", help=text)
        add[role].add_argument("name", metavar="NAME", nargs=1 if role == "site" else "+",
                               help="letters, digits, '_', '-'")
        add[role].add_argument("--device-folder", default=DEVICE_FOLDER, metavar="DIR",
                               help="where its files lie on its machine; default: %(default)s")
    add["vehicle"].add_argument("--host", action="append", default=[], metavar="HOST", help="name or address for "
                                "browsers, of its page by https; repeated: further ones")
    site = add["site"]
    site.add_argument("--host", action="append", required=True, metavar="HOST", help="name or address for vehicles and "
                      "other sites; repeated: further names of its certificate, as *.nats")
    site.add_argument("--port", type=int, default=PORT, help="for vehicles; default: %(default)s")
    site.add_argument("--route-port", type=int, default=ROUTE_PORT, help="for other sites; default: %(default)s")
    site.add_argument("--http-port", type=int, default=HTTP_PORT, help="on its machine alone; default: %(default)s")
    site.add_argument("--at", type=float, nargs=3, metavar=("X", "Y", "RANGE"), help="of its network in the map [m]")
    renew = verbs.add_parser("renew", help="gives members a new key and certificate; the old ones are refused")
    revoke = verbs.add_parser("revoke", help="takes members out: their certificates are refused")
    for verb in (renew, revoke):
        verb.add_argument("name", metavar="NAME", nargs="+")
    listing = verbs.add_parser("list", help="members, roles, and when their certificates expire")
    for verb, days in ((init, AUTHORITY_DAYS), *((one, MEMBER_DAYS) for one in (*add.values(), renew))):
        verb.add_argument("--days", type=int, default=days, help="until its certificate expires; default: %(default)s")
    for verb in (init, *add.values(), renew, revoke, listing):
        verb.add_argument("--folder", type=Path, default=FOLDER, metavar="DIR",
                          help="of the fleet; default: %(default)s")


def main(options):
    """@return the exit status"""
    try:
        folder = options.folder.expanduser().absolute()
        if options.verb == "init":
            return init(folder, options)
        with Fleet(folder) as fleet:
            if options.verb == "list":
                return show(fleet)
            if options.verb == "revoke":
                return revoke(fleet, options.name)
            if options.verb == "renew":
                return renew(fleet, options.name, options.days)
            return add(fleet, options.verb.partition("-")[2], options)
    except FleetError as error:
        print(f"pi_edge fleet {options.verb}: {error}", file=sys.stderr)
    except OSError as error:
        print(f"pi_edge fleet {options.verb}: {error.filename}: {error.strerror}; give another --folder, or its "
              "owner's rights", file=sys.stderr)
    return 1


class Fleet:
    """fleet.yaml, read and kept from other calls until the end of the context."""

    def __init__(self, folder):
        self.folder = folder
        self.authority = folder / "authority"
        self._lock = None

    def __enter__(self):
        path = self.folder / STATE
        if not path.is_file():
            raise FleetError(f"{self.folder} holds no fleet: call pi_edge fleet init, or give its --folder")
        self._lock = os.open(self.folder, os.O_RDONLY | os.O_CLOEXEC)
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX)
            tree = yaml.safe_load(path.read_text(encoding="utf-8"))
            self.name, self.members, self.revoked = tree["name"], tree["members"], tree["revoked"]
        except (yaml.YAMLError, UnicodeDecodeError, KeyError, TypeError) as error:
            os.close(self._lock)
            raise FleetError(f"{path} is damaged ({type(error).__name__}): restore it from a copy") from None
        return self

    def __exit__(self, *_):
        os.close(self._lock)

    def folder_of(self, name):
        return self.folder / FOLDERS[self.members[name]["role"]] / name

    def sites(self):
        return sorted(name for name, one in self.members.items() if one["role"] == "site")

    def save(self):
        """Also renews what follows from the members. @return the sites, whose servers must be reloaded"""
        authority.write(self.folder / STATE, yaml.safe_dump(
            {"name": self.name, "members": self.members, "revoked": self.revoked}, sort_keys=False), 0o600)
        for name, one in self.members.items():
            folder = self.folder_of(name)
            if one["role"] == "site":
                authority.write(folder / "server/nats-server.conf",
                                configuration.server_text(self.name, self.members, name))
                authority.write(folder / "worker/edge_server.yaml", configuration.edge_server_text(name, one))
            elif one["role"] == "vehicle":
                authority.write(folder / "coordinator.yaml", configuration.coordinator_text(name, one, self.members))
        return self.sites()

    def require_days(self, days):
        left = authority.expiry(self.authority / authority.AUTHORITY) - datetime.now(timezone.utc)
        if not 1 <= days <= left.days:
            raise FleetError(f"--days = {days}, must be in [1, {left.days}], the days that the fleet's authority has "
                             "left")

    def certify(self, name, member, days):
        """Makes the keys of a member in a folder beside its own, which replaces that at the end."""
        target = self.folder / FOLDERS[member["role"]] / name
        target.parent.mkdir(mode=0o700, exist_ok=True)
        made = Path(tempfile.mkdtemp(prefix=".new-", dir=target.parent))
        try:
            member["keys"], ends = {}, []
            for role, folder in ((("server", made / "server"), ("worker", made / "worker"))
                                 if member["role"] == "site" else ((member["role"], made),)):
                folder.mkdir(mode=0o700, exist_ok=True)
                member["keys"][role], end = authority.certify(
                    self.authority, folder, [("O", self.name), ("OU", role), ("CN", name)], days,
                    member.get("hosts", ()) if role in ("server", "vehicle") else ())
                ends.append(end)
            member["expires"] = min(ends)
            if name in self.members:
                shutil.rmtree(target)
            made.rename(target)
        except BaseException:
            shutil.rmtree(made, ignore_errors=True)
            raise
        self.members[name] = member


def require_name(name):
    if not NAME.fullmatch(name):
        raise FleetError(f"NAME = \"{name}\", must be 1 to 32 letters, digits, '_' or '-', as truck_7: subjects of "
                         "NATS hold it")


def require_members(fleet, names):
    for name in names:
        if name not in fleet.members:
            known = ", ".join(sorted(fleet.members)) or "nobody"
            raise FleetError(f"NAME = \"{name}\" is no member: there is {known}")


def init(folder, options):
    name = options.name or f"fleet-{secrets.token_hex(4)}"
    require_name(name)
    if not 1 <= options.days <= 36500:
        raise FleetError(f"--days = {options.days}, must be in [1, 36500]")
    if (folder / STATE).exists() or (folder / "authority").exists():
        raise FleetError(f"{folder} holds a fleet already: give another --folder; its keys are not overwritten")
    with contextlib.suppress(FileExistsError):
        folder.mkdir(mode=0o700, parents=True)
    made = Path(tempfile.mkdtemp(prefix=".new-", dir=folder))
    try:
        authority.make_authority(made, name, options.days)
        made.rename(folder / "authority")
    except BaseException:
        shutil.rmtree(made, ignore_errors=True)
        raise
    state = {"name": name, "members": {}, "revoked": []}
    authority.write(folder / STATE, yaml.safe_dump(state, sort_keys=False), 0o600)
    print(f"{name}: its authority, for {options.days} days, is in {folder / 'authority'}. Keep a copy of {folder} in a "
          "safe place: who has it can make members.\nNext: pi_edge fleet add-site NAME --host HOST")
    return 0


def hosts_of(options):
    """The names and addresses of a new member."""
    for host in options.host:
        if not HOST.fullmatch(host) or len(host) > 253:
            raise FleetError(f"--host = \"{host}\", must be the name or address of a machine, without port")
    return list(dict.fromkeys(options.host))


def site_of(fleet, options):
    """The settings of a new site."""
    hosts = hosts_of(options)
    if options.host[0].startswith("*"):
        raise FleetError(f"--host = \"{options.host[0]}\", the first must be one that vehicles can connect to")
    ports = {"port": options.port, "route_port": options.route_port, "http_port": options.http_port}
    for name, port in ports.items():
        if not 1 <= port <= 65535:
            raise FleetError(f"--{name.replace('_', '-')} = {port}, must be in [1, 65535]")
    if len(set(ports.values())) < len(ports):
        raise FleetError(f"--port, --route-port and --http-port = {', '.join(map(str, ports.values()))}, must differ")
    for name in fleet.sites():
        one = fleet.members[name]
        if one["hosts"][0] == options.host[0] and {one["port"], one["route_port"]} & {options.port, options.route_port}:
            raise FleetError(f"--host = {options.host[0]}: {name} has that address and one of its ports already")
    site = {"hosts": hosts, **ports}
    if options.at:
        x, y, reach = options.at
        if not (abs(x) < float("inf") and abs(y) < float("inf") and reach >= 0.0):
            raise FleetError(f"--at = {x:g} {y:g} {reach:g}, must be finite, with a range of at least 0")
        site.update(x=x, y=y, range=reach)
    return site


def add(fleet, role, options):
    names = list(dict.fromkeys(options.name))
    fleet.require_days(options.days)
    for name in names:
        require_name(name)
        if name in fleet.members:
            raise FleetError(f"NAME = \"{name}\" is taken by a {fleet.members[name]['role']}: choose another, or call "
                             f"pi_edge fleet renew {name}")
        target = fleet.folder / FOLDERS[role] / name
        if target.exists():
            raise FleetError(f"{target} is there already: move it away; keys are not overwritten")
    if not options.device_folder.startswith("/") or re.search(r"[\s\"'\\$]", options.device_folder):
        raise FleetError(f"--device-folder = \"{options.device_folder}\", must be an absolute path without spaces and "
                         "quotes")
    settings = site_of(fleet, options) if role == "site" else {"hosts": hosts_of(options)} if role == "vehicle" else {}
    for name in names:
        fleet.certify(name, {"role": role, "folder": options.device_folder.rstrip("/"), **settings}, options.days)
    return report(fleet, names, fleet.save())


def renew(fleet, names, days):
    names = list(dict.fromkeys(names))
    fleet.require_days(days)
    require_members(fleet, names)
    for name in names:
        fleet.certify(name, dict(fleet.members[name]), days)
    return report(fleet, names, fleet.save())


def report(fleet, names, sites):
    """Says what was made, and where to copy it."""
    for name in names:
        one = fleet.members[name]
        print(f"{name}: {one['role']}, until {one['expires'][:10]}. Copy {fleet.folder_of(name)} to {one['folder']} on "
              "its machine; only the user of the program may read the keys.")
    tell_sites(fleet, sites)
    return 0


def tell_sites(fleet, sites):
    if sites:
        print(f"New for {', '.join(sites)}: server/nats-server.conf in {fleet.folder / 'sites'}. Copy it, then "
              f"{RELOAD}.")
    else:
        print("There is no site yet: pi_edge fleet add-site NAME --host HOST")


def revoke(fleet, names):
    names = list(dict.fromkeys(names))
    require_members(fleet, names)
    for name in names:
        one = fleet.members[name]
        fleet.revoked.append({"name": name, "role": one["role"], "keys": sorted(one["keys"].values()),
                              "on": datetime.now(timezone.utc).isoformat(timespec="seconds")})
        shutil.rmtree(fleet.folder_of(name), ignore_errors=True)
        del fleet.members[name]
    sites = fleet.save()
    print(f"{', '.join(names)}: no member any more. It is refused, and disconnected, as soon as the sites know.")
    tell_sites(fleet, sites)
    return 0


def show(fleet):
    from first_drive.report import table
    now = datetime.now(timezone.utc)

    def ends(when):
        left = when - now
        return (f"{when:%Y-%m-%d}", "expired" if left < timedelta() else
                f"{left.days} days" + (": renew it" if left.days < SOON_DAYS else ""))

    rows = [["name", "role", "expires", "left", "address"],
            [fleet.name, "authority", *ends(authority.expiry(fleet.authority / authority.AUTHORITY)), ""]]
    for name, one in sorted(fleet.members.items(), key=lambda entry: (list(FOLDERS).index(entry[1]["role"]), entry[0])):
        rows.append([name, one["role"], *ends(datetime.fromisoformat(one["expires"])),
                     f"{one['hosts'][0]}:{one['port']}" if one["role"] == "site" else ""])
    rows += [[one["name"], one["role"], "revoked", one["on"][:10], ""] for one in fleet.revoked]
    print(table(rows, "<<<<<"))
    return 0
