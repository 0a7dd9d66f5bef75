"""A recording as one file that another imuscope opens with everything in it, and the bytes of one device as they came.

a recording of ours     packed again, with what a person changed in its metadata `edit`
a capture, a log        wrapped: its bytes as chunks with the times that were made for them
another's MCAP, CSV     as it is: it has no bytes of a device
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from protocols.framing import Ints
from recordings.blocks import Recording, Topic
from recordings.container import DEVICE, EDIT, RAW_ENCODING, RECORDING
from recordings.importers import open_file
from recordings.library import Entry
from recordings.packing import packed, wrapped
from recordings.parts import Source


def whole(entry: Entry, out: BinaryIO) -> None:
    """Write everything of a recording.

    Raises:
        RecordingError, OSError: it cannot be read.
    """
    if entry.peek.format == "mcap":
        with Recording(entry.path) as recording:
            if recording.is_ours:
                packed(recording, out, edit=entry.edits.as_metadata())
                return
    if entry.peek.format in ("mcap", "csv"):
        with entry.path.open("rb") as file:
            shutil.copyfileobj(file, out, 1 << 20)
        return
    source = open_file(entry.path)
    topics = {n: Topic(n, f"rx/{device}", RAW_ENCODING) for n, device in enumerate(source.devices, start=1)}
    metadata = {
        RECORDING: {"title": entry.title, "source": entry.path.name, **source.about},
        **{DEVICE + name: _about(source, name) for name in source.devices},
        EDIT: entry.edits.as_metadata(),
    }
    wrapped(topics, _pieces(source, topics), metadata, out)


def original(path: Path, device: str, out: BinaryIO) -> None:
    """Write the bytes that came from one device. Raises as `whole` does."""
    for part in open_file(path).parts():
        if part.way == "rx" and part.device == device:
            out.write(part.data)


def _about(source: Source, device: str) -> dict[str, str]:
    told = source.devices[device]
    return {"protocol": told.protocol, "link": "file", **told.about}


def _pieces(source: Source, topics: dict[int, Topic]) -> Iterator[tuple[int, bytes, Ints, Ints]]:
    numbers = {topic.name: number for number, topic in topics.items()}
    for part in source.parts():
        yield numbers[f"{part.way}/{part.device}"], part.data, part.ends, part.times
