"""A capture or a log as a recording of imuscope: its bytes as chunks, with the times derived for them."""

from collections.abc import Iterator
from typing import BinaryIO

from imuscope.protocols.arrays import Ints
from imuscope.protocols.messages.records import MessageChannel
from imuscope.recordings import sidecar
from imuscope.recordings.mcap.compaction import write_recording
from imuscope.recordings.mcap.writer import DEVICE, EDIT, RAW_ENCODING, RECORDING
from imuscope.recordings.sources import Source


def wrap_capture(source: Source, title: str, edits: sidecar.Edits, out: BinaryIO) -> None:
    """Write a capture or a log as a recording: its bytes as chunks with the times derived for them.

    Raises:
        RecordingError, OSError: it cannot be read.
    """
    topics = {n: MessageChannel(n, f"rx/{device}", RAW_ENCODING) for n, device in enumerate(source.devices, start=1)}
    metadata = {
        RECORDING: {"title": title, "source": source.path.name, **source.header},
        **{DEVICE + name: _about(source, name) for name in source.devices},
        EDIT: edits.as_metadata(),
    }
    write_recording(topics, _pieces(source, topics), metadata, source.path.stat().st_size, out)


def _about(source: Source, device: str) -> dict[str, str]:
    known = source.devices[device]
    return {"protocol": known.protocol, "link": "file", **known.identity}


def _pieces(source: Source, topics: dict[int, MessageChannel]) -> Iterator[tuple[int, bytes, Ints, Ints]]:
    numbers = {topic.topic: number for number, topic in topics.items()}
    for part in source.parts():
        yield numbers[f"{part.direction}/{part.device}"], part.data, part.ends, part.times
