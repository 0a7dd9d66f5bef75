"""How many wrong tokens may come from one address? Ten at once, then ten a minute; what comes beyond is not looked at.

    a failure takes one of an address's `MOST`; they come back at MOST / WITHIN_S. With none left: 429 and Retry-After.

Who is locked out then? Behind one address may be a whole house (NAT, a proxy), and one of them who guesses must not
keep the others away. But a right token that always passes is also a guess that always succeeds: then nothing would be
limited. What separates the two is whether a token could be guessed at all. So:

    a right token of at least `UNGUESSABLE` characters    passes always. The server makes its own with 24, of 144 random
                                                          bits: at a million guesses a second that is 10²⁹ years.
    a shorter one, from a configuration file              is not looked at either while its address is locked: from
                                                          others it passes, and at start a line says that it is short

An address is an IPv4 address or the /64 of an IPv6 one, which is what one household or one machine is given (RFC 6177).
Loopback counts like any other: a proxy on this machine speaks for strangers. Its word for whom it speaks is not taken,
because anybody can write X-Forwarded-For.

Memory is constant: `ADDRESSES` are remembered, the one that failed longest ago is forgotten first.
"""

from __future__ import annotations

import ipaddress
import time
from collections import OrderedDict
from collections.abc import Callable

from server.config import Config

MOST = 10
WITHIN_S = 60.0
UNGUESSABLE = 20
ADDRESSES = 1024


class LoginThrottle:
    """Wrong tokens by address.

    Args:
        clock: seconds, never running backwards.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._left: OrderedDict[str, tuple[float, float]] = OrderedDict()  # how many are left, and when that was so

    def __len__(self) -> int:
        return len(self._left)

    def wait_s(self, address: str) -> float:
        """Until a token from there is looked at again; 0 when it is now."""
        return max(0.0, (1.0 - self._now(client_group(address))) * WITHIN_S / MOST)

    def count(self, address: str) -> None:
        """A wrong token came from there."""
        group = client_group(address)
        self._left[group] = (max(0.0, self._now(group) - 1.0), self._clock())
        self._left.move_to_end(group)
        while len(self._left) > ADDRESSES:
            self._left.popitem(last=False)

    def _now(self, group: str) -> float:
        left, then = self._left.get(group, (float(MOST), 0.0))
        return min(float(MOST), left + (self._clock() - then) * MOST / WITHIN_S)


def short_tokens(config: Config) -> list[str]:
    """Which configured tokens could be guessed."""
    tokens = {"view_token": config.view_token, "control_token": config.control_token}
    return [name for name, token in tokens.items() if 0 < len(token) < UNGUESSABLE]


def client_group(address: str) -> str:
    """Whom an address stands for: 2001:db8::1 → 2001:db8::/64; ::ffff:192.0.2.7 → 192.0.2.7."""
    try:
        found = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return address[:64]
    if isinstance(found, ipaddress.IPv4Address):
        return str(found)
    if found.ipv4_mapped is not None:
        return str(found.ipv4_mapped)
    return str(ipaddress.ip_network((found, 64), strict=False))
