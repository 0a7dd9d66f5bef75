"""Secure devices of one link whose sequence began anew, and the numbers that outlive a connection.

    connection ──> decoder ──remembered──> numbers ──recall──> decoder of the next connection
                      │                       └──> server/devices/sequence_store.py, for the next start of the server
                      └─ stale, stale, stale ──> "Sequence restarted": an operator re-arms, or somebody replays

A Secure device that was switched off and on counts from 0 again, and looks exactly like somebody who plays captured
frames once more. Only a person can tell the two apart, so the server says what it sees, and waits to be re-armed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from protocols.events import Batch, Decoder, Event, RejectedFrame, Remembers
from server.devices.decode_options import DecodeOptions
from server.devices.sequence_store import SequenceStore

FEWEST = 3  # old frames in a row, none of them accepted between


@dataclass(slots=True)
class _Stale:
    """Old frames of a device since its last one that was accepted."""

    count: int = 0
    detail: str = ""


class Restarts:
    """Of one link.

    Args:
        kind: of the link: what a file holds is played again as it was, and remembered by nobody; a simulator's numbers
            end with the server, as it does itself.
        store: None to keep nothing beyond this process.
    """

    def __init__(self, kind: str, store: SequenceStore | None) -> None:
        self._plays = kind == "file"
        self._store = store if kind not in ("file", "twin") else None
        self._decoder: Remembers | None = None
        self._key: bytes | None = None
        self._numbers: dict[int, int] = {}
        self._stale: dict[str, _Stale] = {}
        self._secure = False

    def begin(self, decoder: Decoder, reading: DecodeOptions) -> None:
        """A decoder takes over."""
        self.keep()
        if reading.key != self._key:
            self._numbers = {}
        self._key, self._decoder = reading.key, None
        self._stale.clear()
        self._secure = reading.key is not None
        if isinstance(decoder, Remembers) and reading.key is not None and reading.replay_check and not self._plays:
            kept = self._store.recall(reading.key) if self._store is not None else {}
            self._numbers = {**kept, **self._numbers}
            decoder.recall(self._numbers)
            self._decoder = decoder

    def keep(self) -> None:
        """Remember how far the devices are. Cheap; to be called now and then, and before a decoder goes."""
        if self._decoder is None or self._key is None:
            return
        numbers = dict(self._decoder.remembered())
        if numbers != self._numbers:
            self._numbers.update(numbers)
            if self._store is not None:
                self._store.note(self._key, numbers)

    def hear(self, events: Sequence[Event]) -> None:
        """What the decoder gave."""
        if not self._secure:
            return
        for event in events:
            if isinstance(event, RejectedFrame) and event.reason == "stale" and event.device:
                held = self._stale.setdefault(event.device, _Stale())
                held.count += 1
                held.detail = event.detail
            elif isinstance(event, Batch) and event.verified and self._stale:
                self._stale.pop(event.device, None)

    @property
    def waiting(self) -> dict[str, str]:
        """Devices of the stream that wait to be re-armed → what is said about them."""
        return {
            device: f"Sequence restarted: {device} sends old numbers ({held.detail}), which Secure mode refuses."
            for device, held in self._stale.items()
            if held.count >= FEWEST
        }

    def rearm(self, decoder: object, device: str = "") -> None:
        """Accept whatever number comes next, of one device or ("") of all.

        Raises:
            ValueError: no device identifier.
            OSError: the store cannot be written.
        """
        if device and not (device.isdecimal() and device.isascii() and int(device) <= 0xFFFF):
            raise ValueError(f"a device is a number from 0 to 65535, given {device!r:.40}")
        if isinstance(decoder, Remembers):
            decoder.rearm(device)
        for name in [device] if device else list(self._stale):
            self._stale.pop(name, None)
        for number in [int(device)] if device else list(self._numbers):
            self._numbers.pop(number, None)
        if self._store is not None and self._key is not None:
            self._store.forget(self._key, int(device) if device else None)
