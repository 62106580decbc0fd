"""Checks of the network: the bridge's port, edge nodes."""

import http.client
import socket

from pi_bringup.doctor.result import fail, ok, warn

BRIDGE_PORT = 8814
HEALTH_OFFSET = 1    # the health port of an edge_server is the one behind its own
CONNECT_S = 3.0


def check_port(port=BRIDGE_PORT):
    """That the bridge to other computers can listen, or does."""
    name = "bridge port"
    with socket.socket() as listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind(("0.0.0.0", port))
            listener.listen(1)
        except PermissionError:
            return fail(name, f"port {port} needs rights of root", "choose one above 1023 in config/bridge.yaml")
        except OSError as error:
            return warn(name, f"port {port} is in use ({error.strerror})",
                        "good if the bridge has it: rosrun pi_os_transport pi_os status")
    return ok(name, f"{port} is free")


def split_address(address):
    """(host, port) of HOST:PORT or [HOST]:PORT. @throws ValueError"""
    host, separator, port = address.rpartition(":")
    if not separator or not host or not port.isdigit() or not 0 < int(port) < 65536:
        raise ValueError(f"{address!r}, must be HOST:PORT")
    return host.strip("[]"), int(port)


def check_node(address, health_port=None, limit_s=CONNECT_S):
    """An edge node: its port takes connections, /readyz says that it works."""
    name = f"edge node {address}"
    try:
        host, port = split_address(address)
    except ValueError as error:
        return fail(name, str(error), "write it as 10.0.0.17:5680")
    try:
        socket.create_connection((host, port), limit_s).close()
    except OSError as error:
        return fail(name, f"takes no connection ({error})",
                    "is edge_server started there, and its port open? the network and its routes: ping, ip route")
    connection = http.client.HTTPConnection(host, health_port or port + HEALTH_OFFSET, timeout=limit_s)
    try:
        connection.request("GET", "/readyz")
        answer = connection.getresponse()
        said = answer.read(200).decode(errors="replace").strip()
    except (OSError, http.client.HTTPException) as error:
        return warn(name, f"takes connections, but does not say its health ({error})",
                    "name its health/port with --health-port, or open it")
    finally:
        connection.close()
    if answer.status != 200:
        return fail(name, f"is not ready: {answer.status} {said}",
                    "wait until its models are loaded; its log says more")
    return ok(name, "takes connections and is ready")
