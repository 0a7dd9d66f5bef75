"""Addresses that a webhook may reach: any network, but this machine and its link only where a setting names the host.

An alarm is added by a user who may control the server, through a fleet also one of another group. Services of this
machine often trust every client on it, and link-local addresses hold the secrets of machines in a cloud. A
name is judged by the address that the connection then goes to, so that it cannot mean another one a moment later.

Source: RFC 6890, special-purpose addresses; RFC 4291, section 2.5.5.2, IPv4-mapped IPv6 addresses.
"""

from __future__ import annotations

import ipaddress
import socket
from collections.abc import Collection
from ipaddress import IPv4Address, IPv6Address
from typing import Any

from imuscope.server.errors import DomainError

SETTING = "webhook_hosts"
HINT = f"If it should be reached, add the host to {SETTING} in the configuration file."
THIS_NETWORK = ipaddress.ip_network("0.0.0.0/8")


class TargetError(OSError):
    """An address that may not be reached; the text says why."""


def why_refused(address: str) -> str:
    """The reason that a webhook may not reach an address; "" if it may, or if the text is not an address."""
    try:
        host = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return ""
    host = _embedded(host)
    if host.is_loopback or host.is_unspecified or (host.version == 4 and host in THIS_NETWORK):
        return "is this machine"
    if host.is_link_local:
        return "is a link-local address"
    return "is not the address of one host" if host.is_multicast or host == IPv4Address("255.255.255.255") else ""


def _embedded(address: IPv4Address | IPv6Address) -> IPv4Address | IPv6Address:
    """The IPv4 address that an IPv6 address stands for, if it does."""
    if isinstance(address, IPv6Address):
        return address.ipv4_mapped or address
    return address


def check_host(host: str, allowed: Collection[str]) -> None:
    """Refuse a host that is known to be this machine, as its address or by name.

    Raises:
        DomainError: "bad-value".
    """
    if host in allowed:
        return
    is_local_name = host.rstrip(".") == "localhost" or host.rstrip(".").endswith(".localhost")
    if why := "is this machine" if is_local_name else why_refused(host):
        raise DomainError("bad-value", f"webhook: {host:.80} {why}.", HINT)


def connect(host: str, port: int, timeout_s: float, allowed: Collection[str]) -> socket.socket:
    """A connection to the first address of a host that may be reached and answers.

    Raises:
        TargetError: none of its addresses may be reached.
        OSError: none answers.
    """
    failure: OSError | None = None
    for family, kind, protocol, _, address in socket.getaddrinfo(host, port, type=socket.SOCK_STREAM):
        why = "" if host in allowed else why_refused(str(address[0]))
        if why:
            failure = failure or TargetError(f"{host} {why}: add it to {SETTING} in the configuration file")
            continue
        try:
            return _connected(socket.socket(family, kind, protocol), address, timeout_s)
        except OSError as error:
            failure = error
    raise failure or OSError("the name has no address")


def _connected(line: socket.socket, address: Any, timeout_s: float) -> socket.socket:
    try:
        line.settimeout(timeout_s)
        line.connect(address)
    except OSError:
        line.close()
        raise
    return line
