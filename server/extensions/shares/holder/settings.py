"""Settings of a holder, as text for its command line."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping

from imuscope.server.extensions.shares.holder.shares import ShareAddress
from imuscope.server.system.light_modules import Any, NamedTuple

MODULE = "imuscope.server.extensions.shares.holder"


class HolderSettings(NamedTuple):
    """Settings of a holder.

    Args:
        source: of the port, see port.Port.
        socket: path of the Unix socket for the server.
        shares: offered from the start.
        stay: run until a signal, whether or not anybody is there.
        kernel: library and name of the loop as machine code (process.Relay); () without.
    """

    source: Mapping[str, Any]
    socket: str
    shares: tuple[ShareAddress, ...] = ()
    stay: bool = False
    kernel: tuple[str, ...] = ()

    @property
    def command(self) -> list[str]:
        """Command line of a holder with these settings."""
        return [sys.executable, "-m", MODULE, self.to_text()]

    def to_text(self) -> str:
        """The inverse of `from_text`."""
        shares = [share.to_json() for share in self.shares]
        return json.dumps(
            {"source": self.source, "socket": self.socket, "shares": shares, "stay": self.stay, "kernel": self.kernel}
        )

    @classmethod
    def from_text(cls, text: str) -> HolderSettings:
        body = json.loads(text)
        shares = tuple(ShareAddress.from_json(one) for one in body["shares"])
        return cls(body["source"], body["socket"], shares, body["stay"], tuple(body["kernel"]))
