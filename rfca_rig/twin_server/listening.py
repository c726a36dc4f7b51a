"""Listening sockets of the server."""

import socket
from ipaddress import ip_address

from rfca_rig.errors import BadInput

LOOPBACK = "127.0.0.1"
ANY_FREE = 0


def listening_tcp(host: str, port: int) -> socket.socket:
    """Opens a non-blocking listening TCP socket. Raises BadInput if host and port are not available."""
    return _bind(socket.SOCK_STREAM, host, port)


def bound_udp(host: str, port: int) -> socket.socket:
    """Opens a non-blocking UDP socket. Raises BadInput if host and port are not available."""
    return _bind(socket.SOCK_DGRAM, host, port)


def _bind(kind: socket.SocketKind, host: str, port: int) -> socket.socket:
    opened = socket.socket(socket.AF_INET, kind)
    try:
        if kind == socket.SOCK_STREAM:
            # A restarted server can take its port again at once, although old connections are still in TIME_WAIT.
            opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        opened.bind((host, port))
        if kind == socket.SOCK_STREAM:
            opened.listen()
    except (OSError, OverflowError) as error:
        opened.close()
        raise BadInput(f"cannot listen on {host} port {port}: {error}; another server may be running, port 0 takes any free one") from error
    opened.setblocking(False)
    return opened


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach `host`. Raises BadInput unless it is an IPv4 address."""
    try:
        address = ip_address(host)
    except ValueError as error:
        raise BadInput(f"{host!r} is no address to listen on; write it in numbers, as 127.0.0.1 or 192.168.1.10") from error
    if address.version != 4:
        raise BadInput(f"{host}: the twin listens on IPv4 only; for this machine that is {LOOPBACK}")
    return address.is_loopback
