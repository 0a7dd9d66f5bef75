"""Words on the time axis of bytes and messages of devices, and what the events say on their clocks."""

from collections.abc import Iterable, Mapping, Sequence

from imuscope.recordings.importers.open_file import CaptureSource
from imuscope.recordings.readers.message_source import MessageFile
from imuscope.recordings.sources import Source
from imuscope.server import wire

TOPICS_NAMED = 4
GNSS_WORDS = "The time axis is the time in the messages of the GNSS receiver."
PERIOD_WORDS = {
    "day": "The time axis is the time of day in the messages of the GNSS receiver.",
    "week": "The time axis is the time of week in the messages of the GNSS receiver.",
}
RECORDING_WORDS = "The time axis is the time of the devices, on the clock of the host that recorded them."
CAN_WORDS = "The time axis is the clock of the device, on the times of the log."
DEVICE_WORDS = "The time axis is the clock of the device."
ARRIVAL_WORDS = "The time axis is the arrival, as chosen for this file."
LOG_TIME_WORDS = "The time axis is the log time of each message, as chosen for this file."


def axis_words(axes: Iterable[Mapping[str, str]]) -> str:
    """A sentence on the clocks that give the times of messages; "" if there are none.

    Args:
        axes: of each device, topic → words on its clock.
    """
    topics: dict[str, list[str]] = {}
    for of_device in axes:
        for topic, axis in of_device.items():
            topics.setdefault(axis, []).append(topic)
    if len(topics) == 1:
        return f"The time axis is {next(iter(topics))} of each message."
    each = [f"of {', '.join(names[:TOPICS_NAMED])} {axis}" for axis, names in topics.items()]
    return f"The time axis is {'; '.join(each)}." if each else ""


def capture_words(source: CaptureSource) -> list[str]:
    """Sentences on the time axis of bytes without arrival times, after they were read."""
    words = "" if source.guessed else DEVICE_WORDS
    if source.by_gnss:
        words = PERIOD_WORDS.get(source.gnss_kind, GNSS_WORDS)
    date = f"Its date is that of {source.dated_by}." if source.dated_by else ""
    return [one for one in (words, date) if one]


def axis_event(events: Sequence[wire.EventInfo]) -> str:
    """The sentence on the time axis, from the events; "" without one."""
    return next((one.text for one in events if one.kind == "clock" and one.data.get("kind") == "axis"), "")


def axis_sentences(source: Source, events: Sequence[wire.EventInfo], *, is_empty: bool) -> list[str]:
    """The clock that is the time axis of a file that imuscope did not record, and what its date comes from.

    Args:
        is_empty: whether there are no samples with a clock of their own.
    """
    if isinstance(source, CaptureSource) and not is_empty:
        return capture_words(source)
    words = axis_event(events)
    if not words and not is_empty and isinstance(source, MessageFile):
        words = CAN_WORDS if source.timed else DEVICE_WORDS
    return [words] if words else []


def segments_of(events: Sequence[wire.EventInfo], source: Source) -> dict[str, list[float]]:
    """Times at which the clock of a device stepped, unix s, by device; and those that a file of messages names."""
    segments: dict[str, list[float]] = {}
    for event in events:
        if event.kind == "clock" and event.data.get("kind") in ("jump", "reset", "log"):
            segments.setdefault(event.device, []).append(event.time)
    if isinstance(source, MessageFile) and source.segments:
        device = next(iter(source.devices))
        segments[device] = sorted({*segments.get(device, ()), *source.segments})
    return segments
