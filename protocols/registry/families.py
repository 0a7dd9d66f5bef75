"""Registry of protocol families, and detection of the family of some bytes.

`PROTOCOLS` is the only list: each family found by protocols/family/plugins.py, loaded. One that fails to load is left
out and reported in `PROBLEMS`; the rest works. `detect` asks each family for the share of some bytes that it can
account for: the score, between 0 and 1, and `reason`, the same in words for the page and the port scan:

    "14 frames of Xbus (MTData2) in 1 022 of 1 024 B"
"""

from collections import Counter
from collections.abc import Container, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from imuscope.protocols.events import Batch, Decoder, Reply
from imuscope.protocols.family.decode_options import DecodeOption, merged
from imuscope.protocols.family.info import FrameLister, LogFormat, PositionFix, ProtocolInfo, RejectRemedy
from imuscope.protocols.family.plugins import ProtocolPlugin, each_usable, protocol_plugins
from imuscope.protocols.messages.family import MESSAGES

__all__ = ["PROBLEMS", "PROTOCOLS", "Detection", "FrameLister", "ProtocolInfo", "detect"]


@dataclass(frozen=True, slots=True)
class Detection:
    """Score of some bytes for a protocol."""

    protocol: str
    score: float
    reason: str


def load_families(plugins: Iterable[ProtocolPlugin]) -> tuple[dict[str, ProtocolInfo], list[str]]:
    """The families by name, and a sentence about each that is unusable.

    Raises:
        Exception: one of imuscope's own fails to load; a defect that must not be overlooked.
    """
    families: dict[str, ProtocolInfo] = {}

    def load(plugin: ProtocolPlugin) -> None:
        family = plugin.load(ProtocolInfo)
        if family.name in families:
            raise ValueError(f"there is a protocol {family.name!r} already")
        merged(option for one in (*families.values(), family) for option in one.decoding.options)
        families[family.name] = family

    return families, each_usable(plugins, "protocol", load)


PROTOCOLS, PROBLEMS = load_families(protocol_plugins())
OF_FILES = {name: PROTOCOLS.pop(name) for name, one in [*PROTOCOLS.items()] if not one.stream.is_offered}
"""Streams that only files have."""


def family_of(protocol: str) -> ProtocolInfo | None:
    """The family of that name, a stream that only files have, or that of messages (protocols/messages/); None if
    unknown. Messages are not a family of devices: they are neither detected nor offered as a choice.
    """
    return MESSAGES if protocol == MESSAGES.name else PROTOCOLS.get(protocol) or OF_FILES.get(protocol)


def counts_losses(protocol: str, channels: Container[str]) -> bool:
    """Whether frames of a protocol are numbered in what a device sent: none lost then means that none are missing.

    Args:
        channels: names of the quantities.
    """
    family = family_of(protocol)
    return (
        family is not None and family.stream.counts and (not family.stream.counter or family.stream.counter in channels)
    )


def decode_options() -> dict[str, DecodeOption]:
    """The decode options of all families, by name."""
    return merged(option for family in PROTOCOLS.values() for option in family.decoding.options)


def unit_flag() -> str:
    """Flag of the command line for the unit of the times of a table."""
    flags = [f"--{option.flag}" for option in decode_options().values() if option.table_role == "unit"]
    return flags[0] if flags else "--time-column"


def url_options() -> list[str]:
    """Names of the decode options that a source can contain, with "protocol".

    Files are left out: a source can be given over HTTP, which must not give access to the files of the server.
    """
    options = (one for one in decode_options().values() if "source" in one.scopes and one.kind != "file")
    return ["protocol", *(option.name for option in options)]


def remedies() -> dict[str, RejectRemedy]:
    """Reasons for rejecting frames that a decode option of any family would avoid."""
    return {reason: one for family in PROTOCOLS.values() for reason, one in family.decoding.remedies.items()}


def detect(data: bytes) -> list[Detection]:
    """Detection scores of `data` for each protocol, best first. A few hundred bytes suffice."""
    guesses = [Detection(row.name, *row.frames.likeness(data)) for row in PROTOCOLS.values()]
    return sorted(guesses, key=lambda one: one.score, reverse=True)


def permissive_decoder(protocol: str) -> Decoder:
    """A decoder that accepts frames unchecked: for inspecting bytes, not for trusting them."""
    row = PROTOCOLS[protocol]
    return row.decoding.decoder(**row.frames.permissive)


def count_messages(data: bytes) -> Counter[str]:
    """Number of messages of each protocol in some bytes: two protocols in one stream are a likely mistake.

    Messages that pass through any port (NMEA, u-blox, RTCM 3) are not counted.
    """
    count: Counter[str] = Counter()
    for name in PROTOCOLS:
        decoder = permissive_decoder(name)
        decoder.feed(data, 0)
        for event in decoder.drain(stalled=True):
            if isinstance(event, Batch):
                count[name] += len(event)
            elif isinstance(event, Reply) and event.message.id >= 0:  # a decoder's own notice is not a message
                count[name] += 1
    return count


def log_formats() -> list[tuple[ProtocolInfo, LogFormat]]:
    """The vendors' file formats of all families."""
    return [(family, one) for family in PROTOCOLS.values() for one in family.logs.log_formats]


def position_of(protocol: str, batch: Batch) -> PositionFix | None:
    """The newest position in a batch; None without one."""
    family = family_of(protocol)
    return family.device.position(batch) if family is not None else None


def entry_words(entry: Mapping[str, Any]) -> tuple[str, str] | None:
    """Title and value of a record with a key (schema.Field.key_mask); None for other records."""
    return next(
        (words for family in PROTOCOLS.values() if (words := family.configuration.entry_words(entry)) is not None), None
    )
