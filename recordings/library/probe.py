"""Metadata of a file, read without decoding it; quick enough for a list of hundreds of files.

MCAP: times, counts and devices come from the footer, or from the first records if the footer is missing (the file is
being recorded, or was truncated). Logs: the start comes from the name, or from UTC or the date in the first kilobytes.
Other captures: the first kilobytes give the protocol; the duration is known after opening.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path

from imuscope.protocols.registry.families import detect
from imuscope.recordings import sidecar
from imuscope.recordings.errors import RecordingError, check_format_version
from imuscope.recordings.importers.open_file import GUESS_BYTES, GUESS_SCORE, WEAK_SCORE, is_table, open_file, paced
from imuscope.recordings.library.recording_probe import RecordedDevice, RecordingProbe
from imuscope.recordings.mcap.messages import recorded_device
from imuscope.recordings.mcap.reader import TIME, McapReader
from imuscope.recordings.mcap.records import MAGIC
from imuscope.recordings.mcap.writer import DEVICE, EDIT, FORMAT, RECORDING, is_simulated
from imuscope.recordings.readers import vendor_logs
from imuscope.recordings.readers.file_suffixes import ALWAYS_LISTED, TABLES
from imuscope.recordings.readers.registry import HEAD_BYTES, marked_reader, suffix_reader
from imuscope.recordings.replay import extent
from imuscope.recordings.system.regular_file import open_regular, readable_name

TORN = "It was torn off, or is still being written; all that is there opens."


def probe(path: Path) -> RecordingProbe | None:
    """Read a file's metadata; None if it is not a recording."""
    if readable_name(path) != path.name:  # no page, address or table can have it
        suffix = Path(readable_name(path)).suffix.lower()
        damaged = "Its name is not UTF-8, so it cannot be opened. Give it another name."
        return RecordingProbe(suffix[1:], damaged=damaged) if suffix in ALWAYS_LISTED else None
    try:
        with open_regular(path) as file:
            head = file.read(GUESS_BYTES)
    except OSError as error:
        return RecordingProbe(
            path.suffix[1:].lower(), damaged=f"The recording cannot be read: {(error.strerror or 'it failed').lower()}."
        )
    suffix = path.suffix.lower()
    if head.startswith(MAGIC):
        return _mcap(path)
    if not head:
        return RecordingProbe(suffix[1:], damaged="It is empty.") if suffix in ALWAYS_LISTED else None
    if (reader := marked_reader(head[:HEAD_BYTES]) or suffix_reader(suffix)) is not None:
        return RecordingProbe(reader.name, devices=[RecordedDevice("1", path.name)], is_archive=reader.is_container)
    if suffix in TABLES:
        return RecordingProbe("csv", devices=[RecordedDevice("1", path.name)], edits=_csv_edits(path, head))
    return _capture(path, suffix, head)


def probe_files(paths: Sequence[Path]) -> list[RecordingProbe | None]:
    """Read the metadata of several files."""
    return [probe(path) for path in paths]


def extent_of(path: Path) -> tuple[int, int] | None:
    """Times of the first and last chunk of a file, ns; None if it has none.

    Raises:
        RecordingError: it cannot be read.
    """
    return extent(open_file(path))


def is_pinned(path: Path) -> bool:
    """Whether a recording says itself that it is pinned. An unreadable one is kept: it may say so."""
    try:
        with McapReader(path) as recording:
            return bool(sidecar.from_metadata(recording.meta(EDIT)).pinned)
    except RecordingError:
        return True


def _csv_edits(path: Path, head: bytes) -> sidecar.Edits:
    first = head.split(b"\n", 1)[0]
    if len(first) == len(head):  # many markers make a long line
        try:
            with open_regular(path) as file:
                first = file.readline(sidecar.MAX_BYTES)
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
    if why := check_format_version("It", about.get("format"), FORMAT):
        return RecordingProbe("mcap", about.get("title", ""), damaged=why.message)
    probe = RecordingProbe("mcap", about.get("title", ""), edits=sidecar.from_metadata(recording.meta(EDIT)))
    part = about.get("part", "1")
    if part not in ("", "0", "1"):
        probe.title = f"{probe.title}, part {part}".lstrip(", ")
    statistics = recording.statistics
    counts: Mapping[int, int] = statistics.channel_message_counts if statistics is not None else {}
    if statistics is not None and statistics.message_count:
        probe.started = statistics.message_start_time / 1e9
        probe.duration = (statistics.message_end_time - statistics.message_start_time) / 1e9
    elif first is not None:
        probe.started = int(first.table[TIME].min()) / 1e9
    names: Counter[str] = Counter()
    for channel, topic in recording.topics.items():
        of = recorded_device(topic)
        names[f"rx/{of}" if of else topic.topic] += counts.get(channel, 0)
    probe.markers = names["notes"]
    devices: dict[str, RecordedDevice] = {}
    for name, values in recording.metadata:
        if name.startswith(DEVICE):
            number = name.removeprefix(DEVICE)
            devices.pop(number, None)  # repeated: now it is the last
            devices[number] = _device(number, values)
            if statistics is not None and names[f"rx/{number}"] == 0:
                devices[number].messages = 0
    probe.devices = list(devices.values())
    if not recording.whole:
        probe.damaged = TORN
    else:
        probe.damaged = next((one.words for one in recording.damage if not one.is_remark), "")
    return probe


def _device(number: str, values: Mapping[str, str]) -> RecordedDevice:
    name = values.get("name") or values.get("product") or Path(values.get("source", "")).name or number
    return RecordedDevice(
        number,
        name,
        values.get("protocol", ""),
        values.get("product", ""),
        values.get("serial_number", ""),
        simulated=is_simulated(values),
    )


def _capture(path: Path, suffix: str, head: bytes) -> RecordingProbe | None:
    log = vendor_logs.marked_format(head) or vendor_logs.suffix_format(suffix)
    suffix = log[1].suffix if log is not None else suffix
    protocol = log[0].name if log is not None and log[1].certain else ""
    guesses = detect(head) if not protocol else []
    if not protocol:
        protocol = guesses[0].protocol if guesses and guesses[0].score >= GUESS_SCORE else ""
    probe = RecordingProbe(suffix[1:] if suffix in vendor_logs.log_suffixes() else "bin")
    if not protocol:
        if is_table(path):
            return RecordingProbe("csv", devices=[RecordedDevice("1", path.name)], edits=_csv_edits(path, head))
        protocol = guesses[0].protocol if guesses and guesses[0].score >= WEAK_SCORE else ""
    if not protocol:
        if suffix not in ALWAYS_LISTED:
            return None
        probe.damaged = "It is not a format imuscope knows."
        return probe
    name = vendor_logs.log_name(path)
    probe.devices = [
        RecordedDevice("1", path.name, protocol, serial_number=name.serial_number if name is not None else "")
    ]
    if name is not None:
        probe.started = name.started_ns / 1e9
    elif log is not None and log[1].dated:
        probe.started = _dated(protocol, head)
    return probe


def _dated(protocol: str, head: bytes) -> float | None:
    """Start of a log, unix s, by UTC in its first bytes or in its header; None without either."""
    pace = paced(BytesIO(head), protocol)
    for _ in pace.blocks():
        if pace.is_dated:
            break
    began = pace.dated_ns if pace.started_ns is None else pace.started_ns
    return began / 1e9 if began is not None else None
