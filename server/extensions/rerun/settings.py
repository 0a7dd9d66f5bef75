"""Settings of Rerun."""

import argparse
import re
from dataclasses import dataclass
from typing import Annotated

from imuscope.server.settings.extension_settings import ExtensionSettings
from imuscope.server.settings.setting_types import empty_or

_ADDRESS = re.compile(r"rerun(\+https?)?://[^/\s]+/proxy")


@dataclass(frozen=True, slots=True)
class RerunSettings(ExtensionSettings):
    """Settings of Rerun.

    Args:
        rerun_connect: address of a Rerun viewer on another machine to stream to; "" for none.
    """

    rerun_connect: Annotated[
        str, empty_or(_ADDRESS.fullmatch, "is not a valid address such as rerun+http://host:9876/proxy")
    ] = ""

    @classmethod
    def add_options(cls, command: argparse.ArgumentParser) -> None:
        command.add_argument(
            "--rerun-connect", metavar="URL", help="stream to a Rerun viewer: rerun+http://host:9876/proxy"
        )
