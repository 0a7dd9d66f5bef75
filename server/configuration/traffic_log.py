"""Traffic log: every frame between this host and a device.

    way   name                    hex            text                     ms
    tx    SetOutputConfiguration  fa ff c0 30 …  outputs: 12 entries
    rx    SetOutputConfigu…Ack    fa ff c1 30 …  outputs: 12 entries      31     since the request that it answers
    note                                         12 of 12 entries as requested

The log contains every frame that is sent, and every answer and indication of the device; samples are not logged. Frames
are decoded by the protocol's own lister (protocols/*/inspect.py). Unsolicited answers are limited to `MAX_A_SECOND`,
and the number left out is logged. The number of entries is bounded; new entries are sent to browsers at once, older
ones can be read over HTTP.
"""

import asyncio
import contextlib
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from imuscope.protocols.events import Batch, Event, Reply
from imuscope.protocols.schema.fields import Field
from imuscope.protocols.schema.labels import device_label
from imuscope.protocols.schema.plural import counted
from imuscope.server.concurrency.limiters import PeriodLimit
from imuscope.server.streaming.bus import TelemetryBus
from imuscope.server.wire import Level, TrafficEntry

MAX_ENTRIES = 2000
MAX_A_SECOND = 40  # unsolicited answers
STREAMED = ("ForwardGnssDataAck",)  # corrections are sent continuously; they are counted on their own panel
HEX_BYTES = 2048  # of a frame, shown
SHOWN_VALUES = 4
MAX_TEXT_CHARS = 160

Decode = Callable[[bytes], Mapping[str, Any] | None]
"""The first frame of some bytes: "message", "fields" and "size"; None if there is none."""


class TrafficLog:
    """The log of one device.

    Args:
        decode: reads a frame of the device's protocol.
        name_of: the name of a sent frame, if `decode` does not give one.
        bytes_at: the bytes of the stream from an offset on; b"" if they are no longer stored.
    """

    def __init__(
        self,
        bus: TelemetryBus,
        device: str,
        decode: Decode,
        name_of: Callable[[bytes], str],
        bytes_at: Callable[[int, int], bytes],
    ) -> None:
        self._bus = bus
        self._device = device
        self.decode = decode
        self._name_of = name_of
        self._bytes_at = bytes_at
        self._entries: deque[TrafficEntry] = deque(maxlen=MAX_ENTRIES)
        self._pending: list[tuple[Event, bool, bool]] = []
        self._sent_at: float | None = None
        self._last_sent, self._repeated = b"", 0
        self._unsolicited = PeriodLimit(MAX_A_SECOND, 1.0)

    def tail(self, before: int | None = None, limit: int = 200) -> list[TrafficEntry]:
        """The newest entries (older than `before` if given), newest last."""
        entries = [entry for entry in self._entries if before is None or entry.seq < before]
        return entries[-limit:] if limit > 0 else []

    # ── entries ──────────────────────────────────────────────────────────────────────────────────────────────────────

    def sent(self, frame: bytes, what: str = "", written_ns: int | None = None) -> None:
        """Log bytes that were sent to the device.

        Args:
            written_ns: when, as Chunk.arrival_ns; None: now.
        """
        self.flush()
        self._sent_at = self._bus.now() if written_ns is None else written_ns / 1e9
        if frame == self._last_sent:
            self._repeated += 1  # GoToConfig until it is answered, the byte that restores communication
            return
        self._log_repeats()
        self._last_sent = frame
        line = self.decode(frame) or {}
        name = what or str(line.get("message") or "") or self._name_of(frame)
        text = values_text(line.get("fields", {})) if line.get("size", len(frame)) == len(frame) else ""
        self._add("tx", name, frame, text, time=self._sent_at)
        data = {"message": name, "hex": frame[:HEX_BYTES].hex()}
        self._bus.event(self._device, "command", "info", f"{name}: {text}" if text else name, data=data)

    def client_sent(self, client: str, frame: bytes, line: Mapping[str, Any], time: float) -> None:
        """Log a frame that another client of a shared port sent to the device.

        Args:
            line: the decoded frame, {} if it is not one.
            time: when it was sent, unix s: an entry that is reported later may follow its answer.
        """
        self.flush()
        self._log_repeats()
        name = str(line.get("message") or "") or self._name_of(frame)
        values = values_text(line.get("fields", {}))
        self._add("tx", name, frame, f"{client}: {values}" if values else client, time=time)
        data = {"message": name, "hex": frame[:HEX_BYTES].hex(), "client": client}
        self._bus.event(self._device, "command", "info", f"{client} sent {name or 'bytes'}.", data=data)

    def streamed(self, frame: bytes, text: str, level: Level = "info") -> None:
        """Log a continuous stream to the device: its first frame, and texts on interruptions and its end."""
        if frame:
            self.flush()
            self._log_repeats()
            name = str((self.decode(frame) or {}).get("message") or "") or self._name_of(frame)
            self._add("tx", name, frame, text)
        self._bus.event(self._device, "command", level, text, data={"hex": frame[:HEX_BYTES].hex()} if frame else None)

    def _log_repeats(self) -> None:
        """Log how often the last frame was repeated, before the next entry."""
        repeats, self._repeated, self._last_sent = self._repeated, 0, b""
        if repeats:
            self._add("note", "", b"", f"Sent {counted(repeats, 'more time')}.")

    def add_note(self, text: str, *, error: bool = False) -> None:
        """Log a sentence between the frames."""
        self.flush()
        self._log_repeats()
        self._add("note", "", b"", text, level="error" if error else "info")

    def on_received(self, reply: Reply) -> None:
        """Take a reply of the device. It is logged later, when all listeners have had the chance to match it."""
        self._append(reply, answers=False)

    def matched(self, event: Event, *, may_refuse: bool = False) -> None:
        """Mark an event as the answer to the last request.

        Args:
            may_refuse: a refusal is one of the expected answers, and no warning.
        """
        for place, (one, *_) in enumerate(self._pending):
            if one is event:
                self._pending[place] = (event, True, may_refuse)
                return
        if isinstance(event, Batch):  # samples are logged only if a job requested them
            self._append(event, answers=True)

    def _append(self, event: Event, *, answers: bool) -> None:
        if not self._pending:
            with contextlib.suppress(RuntimeError):  # without a loop, the next access flushes
                asyncio.get_running_loop().call_soon(self.flush)
        self._pending.append((event, answers, False))

    def flush(self) -> None:
        """Log the received events."""
        pending, self._pending = self._pending, []
        for event, answers, may_refuse in pending:
            streamed = isinstance(event, Batch | Reply) and event.message.name in STREAMED
            if answers or (not streamed and self._may_log()):
                self._on_reply(event, answers, may_refuse)

    def _may_log(self) -> bool:
        """Whether another unsolicited answer may be logged."""
        if left := self._unsolicited.begin(self._bus.now()):
            self._add("note", "", b"", f"{left} more messages, not listed.")
        return self._unsolicited.allows()

    def _on_reply(self, event: Event, answers: bool, may_refuse: bool) -> None:
        name, values, frame, arrival = self._read(event)
        self._log_repeats()
        ms = None
        if answers and self._sent_at is not None:
            ms = max(0.0, (arrival - self._sent_at) * 1e3)
            self._sent_at = None
        level: Level = "warning" if name in ("Error", "Warning") and not may_refuse else "info"
        fields = event.message.fields if isinstance(event, Batch | Reply) else ()
        self._add("rx", name, frame, values_text(values, fields), ms=ms, level=level, time=arrival)

    def _read(self, event: Event) -> tuple[str, Mapping[str, Any], bytes, float]:
        """Name, values, bytes and arrival time of a received event."""
        if isinstance(event, Reply):
            frame = self._bytes_at(event.offset, event.size)
            line = self.decode(frame) if frame else None
            values = line.get("fields", {}) if line else event.values
            return event.message.name, values, frame, event.arrival_ns / 1e9
        assert isinstance(event, Batch)
        data = self._bytes_at(int(event.offset[-1]), HEX_BYTES)
        line = self.decode(data) if data else None
        size = int(line["size"]) if line else 0
        fields = line.get("fields", {}) if line else {}
        return event.message.name, fields, data[:size], float(event.arrival_ns[-1]) / 1e9

    def _add(
        self,
        way: str,
        name: str,
        frame: bytes,
        text: str,
        *,
        ms: float | None = None,
        level: Level = "info",
        time: float | None = None,
    ) -> None:
        shown = frame[:HEX_BYTES].hex() + ("…" if len(frame) > HEX_BYTES else "")
        entry = TrafficEntry(
            seq=self._bus.next_traffic_number(),
            time=self._bus.now() if time is None else time,
            device=self._device,
            direction="tx" if way == "tx" else "rx" if way == "rx" else "note",
            name=name,
            hex=shown,
            text=text,
            ms=ms,
            level=level,
        )
        self._entries.append(entry)
        self._bus.traffic.publish(entry)


def values_text(values: Mapping[str, Any], fields: Sequence[Field] = ()) -> str:
    """The values of a frame, short enough for a line; enumeration values with their meaning."""
    meanings = {field.name: field.choices for field in fields if field.choices}
    parts = [
        _value_text(name, value) + _meaning(meanings.get(name), value)
        for name, value in values.items()
        if not name.startswith("reserved")
    ]
    text = ", ".join(parts[:SHOWN_VALUES]) + (" …" if len(parts) > SHOWN_VALUES else "")
    return text if len(text) <= MAX_TEXT_CHARS else text[: MAX_TEXT_CHARS - 1] + "…"


def _meaning(choices: Mapping[int, str] | None, value: Any) -> str:
    return f" ({choices[value]})" if choices and isinstance(value, int) and value in choices else ""


def _value_text(name: str, value: Any) -> str:
    if isinstance(value, Sequence) and not isinstance(value, str | bytes):
        return f"{name}: {len(value)} entries" if len(value) > SHOWN_VALUES else f"{name} {list(value)}"
    if isinstance(value, Mapping):
        return f"{name}: {len(value)} fields"
    if isinstance(value, float):
        return f"{name} {value:.6g}"
    if name.endswith("device_id") and isinstance(value, int):
        return f"{name} {device_label(value)}"
    return f"{name} {value}"
