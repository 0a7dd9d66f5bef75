"""`imuscope hold SOURCE --share ADDRESS`: the holder of a port, in the foreground, such as a unit of systemd.

This process becomes the holder (server/holder), so that nothing heavy stays in memory.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence

from imuscope.server.commands.common import UsageError
from imuscope.server.holder.shares import ShareAddress, ShareError
from imuscope.server.links import LinkSettings, open_link, steady_clock
from imuscope.server.links.base import LinkError
from imuscope.server.links.held import ROOT, holder_settings
from imuscope.server.links.serial import SerialLink
from imuscope.server.links.tcp import TcpLink


def hold(source: str, shares: Sequence[str]) -> None:
    """Become the holder of a port; returns only by an error.

    Raises:
        UsageError: the source has no port that can be shared, its rate is not given, or a share is invalid.
    """
    try:
        link = open_link(source, LinkSettings(now_ns=steady_clock()))
        addresses = [ShareAddress.parse(share) for share in shares]
    except (LinkError, ShareError) as error:
        raise UsageError(str(error)) from None
    if not isinstance(link, SerialLink | TcpLink):
        raise UsageError(f"{source} has no port that can be shared; give a serial port or tcp://host:port")
    if isinstance(link, SerialLink) and link.line.baud is None:
        raise UsageError(f"the rate of {source} is not given; add it: {source}?baud=115200")
    try:
        settings = holder_settings(link, addresses, stay=True)
    except OSError as error:
        raise UsageError(f"there is no folder for the socket of the holder: {error}") from None
    os.chdir(ROOT)
    os.execv(sys.executable, [sys.executable, "-m", "imuscope.server.holder", settings.to_text()])
