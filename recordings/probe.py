"""What does a file say of itself without being decoded? Enough for a list of hundreds of files.

Of an MCAP file the end tells its times, counts and devices, or, where it has none (it is being recorded, or was torn
off), its first records. Of a log the name tells when it began; of an .mtb its first kilobytes do, by UTC or the date at
its head. Of other captures they tell the protocol; how long they last is known when they have been opened.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path

from protocols.registry import detect
from recordings import inertial_sense_logs, sidecar
from recordings.importers import GUESS_BYTES, GUESS_SCORE, is_dat, paced
from recordings.mcap_reader import MAGIC, TIME, McapReader
from recordings.mcap_writer import DEVICE, EDIT, RECORDING, RecordingError, check_format_version

ASK_ANYWAY = (".mcap", ".mtb", ".raw", ".dat", ".bin", ".csv")  # shown, even where nothing known is found in them
TORN = "It was torn off, or is still being written; all that is there opens."


@dataclass(slots=True)
class RecordedDevice:
    """A device in a file; `messages`: its frames, 0 where it sent nothing, None until they have been counted."""

    id: str
    name: str = ""
    protocol: str = ""
    product: str = ""
    serial_number: str = ""
    messages: int | None = None
    lost: int = 0
    rejects: int = 0


@dataclass(slots=True)
class RecordingProbe:
    """What a file says of itself.

    Args:
        started: unix s; None where it is not known. So is `duration`, s.
        damaged: one sentence, "" where nothing is known to be wrong.
        edits: what a person changed, as the file itself holds it.
    """

    format: str
    title: str = ""
    started: float | None = None
    duration: float | None = None
    devices: list[RecordedDevice] = field(default_factory=list)
    damaged: str = ""
    edits: sidecar.Edits = field(default_factory=sidecar.Edits)
    markers: int = 0


def probe(path: Path) -> RecordingProbe | None:
    """Look into a file; None where it is nothing that anybody would call a recording."""
    try:
        with path.open("rb") as file:
            head = file.read(GUESS_BYTES)
    except OSError as error:
        return RecordingProbe(
            path.suffix[1:].lower(), damaged=f"It cannot be read: {(error.strerror or 'it failed').lower()}."
        )
    suffix = path.suffix.lower()
    if head.startswith(MAGIC):
        return _mcap(path)
    if not head:
        return RecordingProbe(suffix[1:], damaged="It is empty.") if suffix in ASK_ANYWAY else None
    if suffix == ".csv":
        return RecordingProbe("csv", devices=[RecordedDevice("1", path.name)], edits=_csv_edits(path, head))
    return _capture(path, suffix, head)


def _csv_edits(path: Path, head: bytes) -> sidecar.Edits:
    first = head.split(b"\n", 1)[0]
    if len(first) == len(head):  # many markers are a long line
        try:
            with path.open("rb") as file:
                first = file.readline(sidecar.MOST_BYTES)
        except OSError:
            return sidecar.Edits()
    return sidecar.from_csv(first)


def _mcap(path: Path) -> RecordingProbe:
    try:
        with McapReader(path) as recording:
            return _recording(recording)
    except RecordingError as error:
        return RecordingProbe("mcap", damaged=error.message)


def _recording(recording: McapReader) -> RecordingProbe:
    first = None
    if not recording.chunks:
        first = next(iter(recording.blocks()), None)
    about = recording.meta(RECORDING)
    if why := check_format_version("It", about.get("format")):
        return RecordingProbe("mcap", about.get("title", ""), damaged=why.message)
    found = RecordingProbe("mcap", about.get("title", ""), edits=sidecar.from_metadata(recording.meta(EDIT)))
    part = about.get("part", "1")
    if part not in ("", "0", "1"):
        found.title = f"{found.title}, part {part}".lstrip(", ")
    told = recording.statistics
    counts: Mapping[int, int] = told.channel_message_counts if told is not None else {}
    if told is not None and told.message_count:
        found.started = told.message_start_time / 1e9
        found.duration = (told.message_end_time - told.message_start_time) / 1e9
    elif first is not None:
        found.started = int(first.table[TIME].min()) / 1e9
    names = {topic.name: counts.get(number, 0) for number, topic in recording.topics.items()}
    found.markers = names.get("notes", 0)
    devices: dict[str, RecordedDevice] = {}
    for name, values in recording.metadata:
        if name.startswith(DEVICE):
            number = name.removeprefix(DEVICE)
            devices.pop(number, None)  # told again: now it is the last
            devices[number] = _device(number, values)
            if told is not None and names.get(f"rx/{number}", 0) == 0:
                devices[number].messages = 0
    found.devices = list(devices.values())
    if not recording.whole:
        found.damaged = TORN
    elif recording.damage:
        found.damaged = recording.damage[0].words
    return found


def _device(number: str, values: Mapping[str, str]) -> RecordedDevice:
    name = values.get("name") or values.get("product") or Path(values.get("source", "")).name or number
    return RecordedDevice(
        number,
        name,
        values.get("protocol", ""),
        values.get("product", ""),
        values.get("serial_number", ""),
    )


def _capture(path: Path, suffix: str, head: bytes) -> RecordingProbe | None:
    protocol = {".mtb": "xbus"}.get(suffix, "")
    if is_dat(head):
        suffix, protocol = ".dat", "isb"
    if not protocol:
        guesses = detect(head)
        protocol = guesses[0].protocol if guesses and guesses[0].score >= GUESS_SCORE else ""
    found = RecordingProbe(suffix[1:] if suffix in (".mtb", ".raw", ".dat") else "bin")
    if not protocol:
        if suffix not in ASK_ANYWAY:
            return None
        found.damaged = "It is not a format imuscope knows."
        return found
    name = inertial_sense_logs.log_name(path)
    found.devices = [
        RecordedDevice("1", path.name, protocol, serial_number=name.serial_number if name is not None else "")
    ]
    if name is not None:
        found.started = name.started_ns / 1e9
    elif suffix == ".mtb":
        found.started = _dated(protocol, head)
    return found


def _dated(protocol: str, head: bytes) -> float | None:
    """When a log began, unix s, by UTC in its first bytes, or what stands at its head; None where neither is."""
    pace = paced(BytesIO(head), protocol)
    for _ in pace.blocks():
        if pace.is_dated:
            break
    began = pace.dated_ns if pace.started_ns is None else pace.started_ns
    return began / 1e9 if began is not None else None
