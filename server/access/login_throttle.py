"""Rate limit for wrong tokens: ten at once, then ten per minute; further tokens are not checked.

    Each failure takes one of the address's `MAX_FAILURES` attempts; they refill at MAX_FAILURES / WITHIN_S.
    None left: 429, Retry-After.

Many users may share one address (NAT, a proxy), and one who guesses must not lock out the others. But if a valid token
always passed, a correct guess would always succeed, and guessing would not be limited. So it depends on whether the
token could be guessed:

    valid token of `MIN_UNGUESSABLE_CHARS` or more      always passes. The server generates 24 characters with 144
                                                        random bits: 10²⁹ years at a million guesses per second.
    shorter token, from a configuration file            not checked while its address is locked; valid from other
                                                        addresses. A message at start says that it is short.

An address is an IPv4 address or the /64 of an IPv6 address, which a household or a machine is assigned (RFC 6177).
Loopback is limited as well, because a proxy on this machine forwards requests of others. X-Forwarded-For is not used,
because any client can set it.

Memory is constant: `MAX_ADDRESSES` are stored; the address whose last failure is oldest is removed first.
"""

import ipaddress
import time
from collections.abc import Callable

from imuscope.server.concurrency.limiters import TokenBuckets
from imuscope.server.settings.config import Config

MAX_FAILURES = 10
WITHIN_S = 60.0
MIN_UNGUESSABLE_CHARS = 20
MAX_ADDRESSES = 1024


class LoginThrottle:
    """Wrong tokens by address.

    Args:
        clock: monotonic clock, s.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._failures = TokenBuckets(MAX_FAILURES / WITHIN_S, MAX_FAILURES, MAX_ADDRESSES)

    def __len__(self) -> int:
        return len(self._failures)

    def wait_s(self, address: str) -> float:
        """Seconds until a token from this address is checked again; 0 if it is now."""
        return self._failures.wait_s(client_group(address), self._clock())

    def count(self, address: str) -> None:
        """Count a wrong token from this address."""
        self._failures.acquire(client_group(address), self._clock())


def short_tokens(config: Config) -> list[str]:
    """Configured tokens that could be guessed."""
    tokens = {"view_token": config.view_token, "control_token": config.control_token}
    return [name for name, token in tokens.items() if 0 < len(token) < MIN_UNGUESSABLE_CHARS]


def client_group(address: str) -> str:
    """Address or network that is counted as one client: 2001:db8::1 → 2001:db8::/64; ::ffff:192.0.2.7 → 192.0.2.7."""
    try:
        parsed_address = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return address[:64]
    if isinstance(parsed_address, ipaddress.IPv4Address):
        return str(parsed_address)
    if parsed_address.ipv4_mapped is not None:
        return str(parsed_address.ipv4_mapped)
    return str(ipaddress.ip_network((parsed_address, 64), strict=False))
