"""Common interface of imported files: blocks of bytes of one device, with the arrival time of each chunk.

    part    data     [chunk][chunk][chunk]···
            ends     after each chunk
            times    when each arrived, ns

A part is sized for efficient reading (up to some megabytes), so that an hour of chunks is a few hundred parts. `Source`
is one file, or the files of a split recording.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, Protocol

from imuscope.protocols.arrays import Ints


@dataclass(frozen=True, slots=True)
class FileDamage:
    """Start and cause of damage in the file or in a chunk of it.

    Args:
        torn: only an unfinished record follows, as after a killed writer or a power cut.
        is_remark: nothing is damaged: what of the file is left out, or how it was read.
    """

    offset: int
    words: str
    torn: bool = False
    is_remark: bool = False


def remark(words: str) -> FileDamage:
    """A statement on parts of a file that are left out, or on how it was read."""
    return FileDamage(-1, words, is_remark=True)


@dataclass(frozen=True, slots=True)
class ChunkBlock:
    """Consecutive chunks of one device.

    Args:
        data: the chunks, concatenated.
        ends: (n,) int64, end of each in `data`, ascending.
        times: (n,) int64, arrival (or sending) time of each, ns since the Unix epoch.
        done: share of the file read, 0..1.
    """

    device: str
    direction: Literal["rx", "tx"]
    data: bytes
    ends: Ints
    times: Ints
    done: float


@dataclass(slots=True)
class SourceDevice:
    """Metadata of a device before any byte is decoded; `protocol` "" if unknown."""

    id: str
    protocol: str = ""
    identity: Mapping[str, str] = field(default_factory=dict)


def add_outer_damage(source: "Source", damage: Sequence[FileDamage]) -> None:
    """Add damage of the archive that a file comes from, which stays when the file is read again."""
    if damage:
        vars(source)["outer_damage"] = [*vars(source).get("outer_damage", ()), *damage]


def damage_of(source: "Source") -> list[FileDamage]:
    """Damage of a file, and of the archive that it comes from."""
    return [*getattr(source, "outer_damage", ()), *source.damage]


class Source(Protocol):
    """A file that can be opened.

    Attributes:
        format: "mcap", "mtb", "raw", "dat", "bin".
        devices: those known beforehand; others may appear in parts.
        timed: whether the times of its chunks are real; else they are derived from the device's own clock.
        damage: unreadable parts of the file, complete after the parts have been read.
    """

    format: str
    path: Path
    timed: bool
    devices: dict[str, SourceDevice]
    header: Mapping[str, str]

    @property
    def damage(self) -> list[FileDamage]: ...

    def parts(self, start_ns: int | None = None, stop_ns: int | None = None) -> Iterator[ChunkBlock]:
        """All of them, or at least those with chunks between two times."""
        ...

    def metadata(self) -> Iterator[tuple[str, int, Mapping[str, Any]]]:
        """(channel, time ns, body) of data stored beside the bytes: events, notes, snapshots. Call after `parts`."""
