"""`imuscope hold SOURCE --share ADDRESS`: the holder of a port, in the foreground, such as a unit of systemd.

This process becomes the holder (server/extensions/shares/holder), so that nothing heavy stays in memory.
"""

import argparse
import contextlib
import os
import sys
from collections.abc import Callable, Iterator, Sequence

from imuscope.recordings.system.priority import PERMIT, has_raised_priority
from imuscope.server.diagnostics.checks import Finding
from imuscope.server.errors import UsageError
from imuscope.server.extensions.shares.holder.settings import MODULE
from imuscope.server.extensions.shares.holder.shares import ShareAddress, ShareError
from imuscope.server.extensions.shares.settings import OPTION
from imuscope.server.extensions.shares.shared_port_link import ROOT, holder_settings
from imuscope.server.links.base import LinkError, LinkSettings, steady_clock
from imuscope.server.links.serial import SerialLink
from imuscope.server.links.source_url import open_link
from imuscope.server.links.tcp import TcpLink
from imuscope.server.settings.config import Config
from imuscope.server.system.open_files import ROOT as ROOT_FOLDER
from imuscope.server.system.open_files import file_text, process_folders


def add(add_parser: Callable[..., argparse.ArgumentParser]) -> argparse.ArgumentParser:
    """Add `imuscope hold`."""
    command = add_parser(
        "hold",
        help="keep a port open and share it with other programs, whether or not a server runs",
        epilog="A server of the same user finds the holder when it opens the port.",
    )
    command.add_argument("source", metavar="SOURCE", help="/dev/ttyUSB0?baud=921600 or tcp://host:port")
    command.add_argument(
        OPTION,
        action="append",
        required=True,
        dest="shares",
        metavar="ADDRESS",
        help="PATH of a pseudo-terminal, tcp://HOST:PORT or udp://HOST:PORT; may be repeated",
    )
    return command


def findings(config: Config, root: str | os.PathLike[str] = ROOT_FOLDER) -> Iterator[Finding]:
    """Whether the holders that run come before other programs."""
    for folder in process_folders(root):
        with contextlib.suppress(OSError):
            if MODULE not in file_text(folder, "cmdline").split("\0") or has_raised_priority(int(folder.name)):
                continue
            message = f"The holder of a shared port (process {folder.name}) has no priority over other programs."
            yield Finding("warning", "shared ports", f"{message} Beside busy ones its bytes come later.", (PERMIT,))


def run(options: argparse.Namespace) -> None:
    _hold(options.source, options.shares)


def _hold(source: str, shares: Sequence[str]) -> None:
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
    os.execv(sys.executable, settings.command)
