"""Addresses that a webhook may reach: any network, but this machine and its link only where a setting names the host.

An alarm is added by a user who may control the server, through a fleet also one of another group. Services of this
machine often trust every client on it, and link-local addresses hold the secrets of machines in a cloud. A
name is judged by the address that the connection then goes to, so that it cannot mean another one a moment later.

Source: RFC 6890, special-purpose addresses; RFC 4291, section 2.5.5, IPv4-mapped and -compatible addresses; RFC 6052
and 8215, NAT64; RFC 3056, 6to4; RFC 4380, Teredo; RFC 5214, section 6.1, ISATAP; RFC 2765, section 2.1,
IPv4-translated; inet_aton(3).
"""

import ipaddress
import re
import socket
from collections.abc import Collection, Iterator
from ipaddress import IPv4Address, IPv6Address
from typing import Any

from imuscope.server.errors import DomainError

SETTING = "webhook_hosts"
HINT = f"If it should be reached, add the host to {SETTING} in the configuration file."
THIS_NETWORK = ipaddress.ip_network("0.0.0.0/8")
TRANSLATED = tuple(map(ipaddress.ip_network, ("::/96", "::ffff:0:0:0/96", "64:ff9b::/96", "64:ff9b:1::/48")))
"""IPv4-compatible, IPv4-translated and NAT64: the last 32 bits are an IPv4 address."""
ISATAP_PREFIXES = (0x00005EFE, 0x02005EFE)  # before the last 32 bits, which are an IPv4 address
NUMERIC = re.compile(r"(0[xX][0-9a-fA-F]+|[0-9]+)(\.(0[xX][0-9a-fA-F]+|[0-9]+)){0,3}")


class TargetError(OSError):
    """An address that may not be reached; the text says why."""


def why_refused(address: str) -> str:
    """The reason that a webhook may not reach an address; "" if it may, or if the text is not an address."""
    host = _address_of(address.partition("%")[0].strip("[]"))
    if host is None:
        return ""
    return next(filter(None, map(_why_refused, (host, *_embedded(host)))), "")


def _why_refused(host: IPv4Address | IPv6Address) -> str:
    if host.is_loopback or host.is_unspecified or (host.version == 4 and host in THIS_NETWORK):
        return "is this machine"
    if host.is_link_local:
        return "is a link-local address"
    return "is not the address of one host" if host.is_multicast or host == IPv4Address("255.255.255.255") else ""


def _address_of(text: str) -> IPv4Address | IPv6Address | None:
    """An address in any notation that a connection takes: 127.1, 2130706433 and 0x7f000001 are 127.0.0.1."""
    try:
        return ipaddress.ip_address(text)
    except ValueError:
        pass
    try:
        return IPv4Address(socket.inet_aton(text)) if NUMERIC.fullmatch(text) else None
    except OSError:
        return None


def _embedded(address: IPv4Address | IPv6Address) -> Iterator[IPv4Address]:
    """The IPv4 addresses to which a network may translate an IPv6 address."""
    if not isinstance(address, IPv6Address):
        return
    last = IPv4Address(int(address) & 0xFFFFFFFF)
    if any(address in one for one in TRANSLATED) or int(address) >> 32 & 0xFFFFFFFF in ISATAP_PREFIXES:
        yield last
    yield from filter(None, (address.ipv4_mapped, address.sixtofour, *(address.teredo or ())))


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
