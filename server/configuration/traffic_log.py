"""What went to and fro between this host and a device, frame by frame? The log of the exchange.

    way   name                    hex            text                     ms
    tx    SetOutputConfiguration  fa ff c0 30 …  outputs: 12 entries
    rx    SetOutputConfigu…Ack    fa ff c1 30 …  outputs: 12 entries      31     since the request that it answers
    note                                         12 of 12 entries as asked

Every frame that is sent is in it, and of what the device sends every answer and indication; samples are not. Frames are
decoded by the protocol's own listing (protocols/*/listing.py). A device that floods its host with answers is cut off at
`MOST_A_SECOND`, and how many were left out is said. The log is bounded by number; browsers are told every entry as it
comes, and read older ones over HTTP.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from protocols.events import Batch, Event, Reply
from protocols.labels import device_label
from protocols.schema import Field
from server.streaming.hub import Hub
from server.wire import ExchangeEntry, Level

KEPT = 2000
MOST_A_SECOND = 40  # answers that nobody asked for
STREAMED = ("ForwardGnssDataAck",)  # corrections come all day; they are counted on their own panel
HEX_BYTES = 2048  # of a frame, shown
SHOWN_VALUES = 4
LONGEST = 160

Decode = Callable[[bytes], Mapping[str, Any] | None]
"""The first frame of some bytes: "message", "fields" and "size"; None where there is none."""


class TrafficLog:
    """The log of one device.

    Args:
        decode: reads a frame of the device's protocol.
        name_of: the name of a frame that is sent, where `decode` knows none.
        bytes_at: the bytes of the stream from an offset on; b"" where they are gone.
    """

    def __init__(
        self,
        hub: Hub,
        device: str,
        decode: Decode,
        name_of: Callable[[bytes], str],
        bytes_at: Callable[[int, int], bytes],
    ) -> None:
        self._hub = hub
        self._device = device
        self._decode = decode
        self._name_of = name_of
        self._bytes_at = bytes_at
        self._entries: deque[ExchangeEntry] = deque(maxlen=KEPT)
        self._fresh: list[tuple[Event, bool]] = []
        self._asked_at: float | None = None
        self._last_sent, self._again = b"", 0
        self._second, self._in_second, self._left_out = 0.0, 0, 0

    def tail(self, before: int | None = None, limit: int = 200) -> list[ExchangeEntry]:
        """The newest entries, older than `before` where that is given; newest last."""
        found = [entry for entry in self._entries if before is None or entry.seq < before]
        return found[-limit:] if limit > 0 else []

    # ── what is written into it ──────────────────────────────────────────────────────────────────────────────────────

    def sent(self, frame: bytes, what: str = "") -> None:
        """Bytes that go to the device now."""
        self.flush()
        self._asked_at = self._hub.now()
        if frame == self._last_sent:
            self._again += 1  # GoToConfig until it is heard, the byte that restores communication
            return
        self._say_again()
        self._last_sent = frame
        line = self._decode(frame) or {}
        name = what or str(line.get("message") or "") or self._name_of(frame)
        text = said(line.get("fields", {})) if line.get("size", len(frame)) == len(frame) else ""
        self._add("tx", name, frame, text)
        data = {"message": name, "hex": frame[:HEX_BYTES].hex()}
        self._hub.event(self._device, "command", "info", f"{name}: {text}" if text else name, data=data)

    def streamed(self, frame: bytes, text: str, level: Level = "info") -> None:
        """Of a stream that goes to the device all day: its first frame, and in words where it breaks and ends."""
        if frame:
            self.flush()
            self._say_again()
            name = str((self._decode(frame) or {}).get("message") or "") or self._name_of(frame)
            self._add("tx", name, frame, text)
        self._hub.event(self._device, "command", level, text, data={"hex": frame[:HEX_BYTES].hex()} if frame else None)

    def _say_again(self) -> None:
        """How often the last frame was sent again, before anything else is told."""
        again, self._again, self._last_sent = self._again, 0, b""
        if again:
            self._add("note", "", b"", f"Sent {again} more time{'s' if again > 1 else ''}.")

    def note(self, text: str, *, fault: bool = False) -> None:
        """A sentence between the frames."""
        self.flush()
        self._say_again()
        self._add("note", "", b"", text, level="fault" if fault else "info")

    def hear(self, event: Event) -> None:
        """An event of the decoder. Whether it answers a request is known only when all who listen have seen it."""
        if isinstance(event, Reply):
            self._keep(event, answers=False)

    def matched(self, event: Event) -> None:
        """This event is the answer to what was sent last."""
        for place, (one, _) in enumerate(self._fresh):
            if one is event:
                self._fresh[place] = (event, True)
                return
        if isinstance(event, Batch):  # samples are no exchange, unless somebody asked for them
            self._keep(event, answers=True)

    def _keep(self, event: Event, *, answers: bool) -> None:
        if not self._fresh:
            with contextlib.suppress(RuntimeError):  # without a loop: whoever reads or writes next flushes
                asyncio.get_running_loop().call_soon(self.flush)
        self._fresh.append((event, answers))

    def flush(self) -> None:
        """Write down what was heard."""
        fresh, self._fresh = self._fresh, []
        for event, answers in fresh:
            streamed = isinstance(event, Batch | Reply) and event.message.name in STREAMED
            if answers or (not streamed and self._may()):
                self._heard(event, answers)

    def _may(self) -> bool:
        """May one more answer that nobody asked for be told?"""
        now = self._hub.now()
        if now - self._second >= 1:
            left, self._left_out = self._left_out, 0
            self._second, self._in_second = now, 0
            if left:
                self._add("note", "", b"", f"{left} more messages came, left out here.")
        self._in_second += 1
        if self._in_second > MOST_A_SECOND:
            self._left_out += 1
            return False
        return True

    def _heard(self, event: Event, answers: bool) -> None:
        name, values, frame, arrival = self._read(event)
        self._say_again()
        ms = None
        if answers and self._asked_at is not None:
            ms = max(0.0, (arrival - self._asked_at) * 1e3)
            self._asked_at = None
        level: Level = "caution" if name in ("Error", "Warning") else "info"
        fields = event.message.fields if isinstance(event, Batch | Reply) else ()
        self._add("rx", name, frame, said(values, fields), ms=ms, level=level, time=arrival)

    def _read(self, event: Event) -> tuple[str, Mapping[str, Any], bytes, float]:
        """Name, values, bytes and arrival of what was heard."""
        if isinstance(event, Reply):
            frame = self._bytes_at(event.offset, event.size)
            line = self._decode(frame) if frame else None
            values = line.get("fields", {}) if line else event.values
            return event.message.name, values, frame, event.arrival_ns / 1e9
        assert isinstance(event, Batch)
        data = self._bytes_at(int(event.offset[-1]), HEX_BYTES)
        line = self._decode(data) if data else None
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
        entry = ExchangeEntry(
            seq=self._hub.next_exchange(),
            time=self._hub.now() if time is None else time,
            device=self._device,
            way="tx" if way == "tx" else "rx" if way == "rx" else "note",
            name=name,
            hex=shown,
            text=text,
            ms=ms,
            level=level,
        )
        self._entries.append(entry)
        self._hub.exchange(entry)


def said(values: Mapping[str, Any], fields: Sequence[Field] = ()) -> str:
    """The values of a frame, short enough for a line; those of enumerations with their meaning."""
    meanings = {field.name: field.choices for field in fields if field.choices}
    parts = [
        _said(name, value) + _meaning(meanings.get(name), value)
        for name, value in values.items()
        if not name.startswith("reserved")
    ]
    text = ", ".join(parts[:SHOWN_VALUES]) + (" …" if len(parts) > SHOWN_VALUES else "")
    return text if len(text) <= LONGEST else text[: LONGEST - 1] + "…"


def _meaning(choices: Mapping[int, str] | None, value: Any) -> str:
    """What stands behind a number that has a meaning."""
    return f" ({choices[value]})" if choices and isinstance(value, int) and value in choices else ""


def _said(name: str, value: Any) -> str:
    if isinstance(value, Sequence) and not isinstance(value, str | bytes):
        return f"{name}: {len(value)} entries" if len(value) > SHOWN_VALUES else f"{name} {list(value)}"
    if isinstance(value, Mapping):
        return f"{name}: {len(value)} fields"
    if isinstance(value, float):
        return f"{name} {value:.6g}"
    if name.endswith("device_id") and isinstance(value, int):
        return f"{name} {device_label(value)}"
    return f"{name} {value}"
