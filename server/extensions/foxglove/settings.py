"""Settings of the Foxglove protocol."""

import argparse
from dataclasses import dataclass
from typing import Annotated

from imuscope.server.settings.extension_settings import ExtensionSettings
from imuscope.server.settings.setting_types import Form

PORT = 8765


@dataclass(frozen=True, slots=True)
class FoxgloveSettings(ExtensionSettings):
    """Settings of the Foxglove protocol.

    Args:
        foxglove: loopback port of its server; 0 for any free one, −1 for none.
    """

    foxglove: Annotated[
        int, Form(lambda port: -1 <= port <= 65_535, "is neither a port, 0 … 65535, nor −1 for none")
    ] = -1

    @classmethod
    def add_options(cls, command: argparse.ArgumentParser) -> None:
        command.add_argument(
            "--foxglove",
            type=int,
            nargs="?",
            const=PORT,
            metavar="PORT",
            help=f"serve the Foxglove protocol on this local port (default {PORT}) and at /foxglove on the port of the "
            "page",
        )
