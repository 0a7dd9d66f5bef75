"""Settings of shared ports: the addresses at which the port of a source is offered to other programs."""

import argparse
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from imuscope.server.extensions.shares.holder.shares import ShareAddress, ShareError
from imuscope.server.settings.extension_settings import ExtensionSettings

if TYPE_CHECKING:
    from imuscope.server.settings.config import Config

OPTION = "--share"


@dataclass(frozen=True, slots=True)
class ShareSettings(ExtensionSettings):
    """Settings of shared ports.

    Args:
        shares: addresses (holder/shares.py), by source.
    """

    shares: dict[str, tuple[str, ...]] = field(default_factory=dict)

    @classmethod
    def add_options(cls, command: argparse.ArgumentParser) -> None:
        command.add_argument(
            OPTION,
            action="append",
            dest="shares",
            metavar="ADDRESS",
            help="offer the port of the source before it to other programs: PATH of a pseudo-terminal, tcp://HOST:PORT "
            "or udp://HOST:PORT, each with ?mode=read to forbid writing; may be repeated",
        )
        command.set_defaults(parse_part=command.parse_known_intermixed_args)

    @classmethod
    def from_options(cls, options: argparse.Namespace) -> Mapping[str, Any]:
        """The addresses by the source before each, whose place argparse does not keep.

        Raises:
            UsageError: an address is before all sources.
        """
        from imuscope.server.commands.common import normalized_sources
        from imuscope.server.errors import UsageError

        by_source: dict[str, list[str]] = {}
        addresses = iter(options.shares or ())
        for at, word in enumerate(options.words if options.shares else ()):
            if word == OPTION or word.startswith(f"{OPTION}="):
                share, before = next(addresses), options.parse_part(options.words[:at])[0].sources
                if not before:
                    words = f"{OPTION} {share} has no source before it: give the source first, then its shares"
                    raise UsageError(words)
                by_source.setdefault(normalized_sources(before)[-1], []).append(share)
        return {"shares": by_source or None}

    def check(self) -> None:
        names: list[str] = []
        for source, texts in self.shares.items():
            try:
                names += [ShareAddress.parse(text).text for text in texts]
            except ShareError as error:
                raise ValueError(f"shares of {source}: {error}.") from None
        if twice := next((name for name in names if names.count(name) > 1), ""):
            raise ValueError(f"shares has {twice} twice; give each address once.")


def check_sources(config: "Config") -> None:
    """Check that every shared port is one of the sources.

    Raises:
        ValueError: one is not; the text is for a user.
    """
    for source in config.of(ShareSettings).shares:
        if source not in config.sources:
            raise ValueError(f"shares has {source!r}, which is not among the sources: {', '.join(config.sources)}.")
