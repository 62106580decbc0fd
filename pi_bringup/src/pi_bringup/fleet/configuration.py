"""What the fleet's members are started with: nats-server's configuration of a site, parameters of edge_server and of
the coordinator.

Subjects: requests of vehicles on edge.>, answers on _INBOX.<vehicle>.>, the state of a site on edge.status.<site>. A
user is a certificate: its subject names the user, and its key must be one of those that the fleet has not revoked."""

import yaml

from pi_bringup.fleet.authority import AUTHORITY, CERTIFICATE, KEY

HEADER = "# Written by \"pi_edge fleet\", which also renews it: changes here are lost.\n"
SERVER = HEADER + """\
server_name: "{name}"
listen: "0.0.0.0:{port}"
http: "127.0.0.1:{http_port}"  # /healthz, /varz, /connz, for this machine alone
no_sys_acc: true

# A picture is 0.1 to 6 MB.
max_payload: 8MB
max_pending: 32MB
write_deadline: "2s"
# Strangers: who has not shown a certificate after 2 s is disconnected. Members: how many at once, and what each may do.
max_connections: {max_connections}
max_subscriptions: 64
max_control_line: 4096
ping_interval: "5s"
ping_max: 2

tls {{
{files}
  verify_and_map: true
  timeout: 2
  pinned_certs: [{member_keys}]
}}
authorization {{
  timeout: 3
  users: [{users}]
}}

cluster {{
  name: "{fleet}"
  listen: "0.0.0.0:{route_port}"
  advertise: "{host}:{route_port}"
  no_advertise: true  # vehicles know the sites by their own configuration
  authorization {{ timeout: 3 }}
  # Only the keys of sites: a vehicle's certificate opens no route.
  tls {{
{files}
    verify: true
    timeout: 2
    pinned_certs: [{site_keys}]
  }}
  routes: [{routes}]
}}
"""
MAX_CONNECTIONS = 10000


def user(fleet, name, role):
    """As nats-server prints the subject of a certificate."""
    return f"CN={name},OU={role},O={fleet}"


def permissions(name, role):
    """Text of the permissions of a user."""
    if role == "vehicle":
        return ('publish: { allow: ["edge.>"], deny: ["edge.status.>"] }, '
                f'subscribe: {{ allow: ["_INBOX.{name}.>", "edge.status.>"] }}')
    if role == "worker":  # requests in queue groups alone: no worker listens to what others are asked
        return (f'publish: {{ allow: ["edge.status.{name}"] }}, subscribe: {{ allow: ["edge.> *", "edge.status.>"] }}, '
                'allow_responses: { max: 1, expires: "1m" }')
    return 'publish: { deny: [">"] }, subscribe: { allow: [">"] }'


def ip_literal(host):
    return f"[{host}]" if ":" in host else host


def _list(lines):
    return "".join(f"\n    {line}" for line in lines) + ("\n  " if lines else "")


def server_text(fleet, members, name):
    """nats-server's configuration of the site `name`. @param members  {name: as in fleet.yaml}"""
    site = members[name]
    files = "\n".join(f'  {key}: "{site["folder"]}/server/{file}"' for key, file in (
        ("cert_file", CERTIFICATE), ("key_file", KEY), ("ca_file", AUTHORITY)))
    users, keys = [], []
    for member, one in sorted(members.items()):
        role = "worker" if one["role"] == "site" else one["role"]
        users.append(f'{{ user: "{user(fleet, member, role)}", permissions: {{ {permissions(member, role)} }} }}')
        keys.append(f'"{one["keys"][role]}"')
    sites = [one for one in members.values() if one["role"] == "site"]
    routes = [f'"tls://{ip_literal(one["hosts"][0])}:{one["route_port"]}"' for one in sites if one is not site]
    return SERVER.format(
        name=name, fleet=fleet, host=ip_literal(site["hosts"][0]), port=site["port"], route_port=site["route_port"],
        http_port=site["http_port"], max_connections=MAX_CONNECTIONS, files=files, users=_list(users),
        member_keys=_list(keys), site_keys=_list([f'"{one["keys"]["server"]}"' for one in sites]),
        routes=_list(routes))


def _parameters(folder, sites):
    return {"transport": "nats", "nats": {
        "servers": [f"{ip_literal(site['hosts'][0])}:{site['port']}" for site in sites],
        "ca_file": f"{folder}/{AUTHORITY}", "certificate_file": f"{folder}/{CERTIFICATE}",
        "key_file": f"{folder}/{KEY}"}}


def edge_server_text(name, site):
    """Parameters of the site's edge_server."""
    tree = {"id": name, **_parameters(f"{site['folder']}/worker", [site])}
    if "x" in site:
        tree.update(has_position=True, x=site["x"], y=site["y"], range=site["range"])
    return HEADER + yaml.safe_dump(tree, sort_keys=False)


def coordinator_text(name, vehicle, members):
    """Parameters of the vehicle's coordinator."""
    sites = [one for _, one in sorted(members.items()) if one["role"] == "site"]
    return HEADER + yaml.safe_dump({"vehicle": name, **_parameters(vehicle["folder"], sites)}, sort_keys=False)
