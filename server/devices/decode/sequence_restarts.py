"""Restarted sequences of Secure devices of one link, and their sequence numbers over connections.

    connection ──> decoder ──state──> numbers ──restore──> decoder of the next connection
                      │                  └──> server/devices/decode/sequence_store.py, for the next start of the server
                      └─ stale, stale, stale ──> "Sequence restarted": a restart or a replay attack; needs re-arming

A Secure device that was power-cycled counts from 0 again, which looks exactly like a replay of captured frames. Only
the operator can distinguish the two, so the server reports it and waits to be re-armed.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from imuscope.protocols.events import Batch, Decoder, Event, RejectedFrame, Remembers
from imuscope.server.devices.decode.sequence_store import SequenceStore

FEWEST_STALE = 3  # old frames in a row, without an accepted one


@dataclass(slots=True)
class _Stale:
    """Old frames of a device since its last accepted one."""

    count: int = 0
    detail: str = ""


class Restarts:
    """Restarts and sequence numbers of the devices of one link.

    Args:
        kind: kind of the link. Files are meant to be replayed, so their numbers are not stored; those of simulators are
            not stored beyond this process.
        store: None to store nothing beyond this process.
    """

    def __init__(self, kind: str, store: SequenceStore | None) -> None:
        self._plays = kind == "file"
        self._store = store if kind not in ("file", "simulator") else None
        self._decoder: Remembers | None = None
        self._key: bytes | None = None
        self._numbers: dict[int, int] = {}
        self._stale: dict[str, _Stale] = {}
        self._secure = False

    def begin(self, decoder: Decoder) -> None:
        """Use a new decoder, and restore its numbers."""
        self.save()
        key = decoder.memory_key if isinstance(decoder, Remembers) else None
        if key != self._key:
            self._numbers = {}
        self._key, self._decoder = key, None
        self._stale.clear()
        self._secure = key is not None
        if isinstance(decoder, Remembers) and key is not None and not self._plays:
            stored = self._store.restore(key) if self._store is not None else {}
            self._numbers = {**stored, **self._numbers}
            decoder.restore(self._numbers)
            self._decoder = decoder

    def save(self) -> None:
        """Store the present numbers. Cheap; call it regularly, and before a decoder is replaced."""
        if self._decoder is None or self._key is None:
            return
        numbers = dict(self._decoder.state())
        if numbers != self._numbers:
            self._numbers.update(numbers)
            if self._store is not None:
                self._store.update(self._key, numbers)

    def on_events(self, events: Sequence[Event]) -> None:
        """Track old and accepted frames in decoded events."""
        if not self._secure:
            return
        for event in events:
            if isinstance(event, RejectedFrame) and event.reason == "stale" and event.device:
                stale = self._stale.setdefault(event.device, _Stale())
                stale.count += 1
                stale.detail = event.detail
            elif isinstance(event, Batch) and event.verified and self._stale:
                self._stale.pop(event.device, None)

    @property
    def waiting(self) -> dict[str, str]:
        """Devices of the stream that wait to be re-armed → text about them."""
        return {
            device: f"Sequence restarted: {device} sends old numbers ({stale.detail}), which Secure mode rejects."
            for device, stale in self._stale.items()
            if stale.count >= FEWEST_STALE
        }

    def rearm(self, decoder: object, device: str = "") -> None:
        """Accept any next number of one device, or of all ("").

        Raises:
            ValueError: invalid device identifier.
            OSError: the store cannot be written.
        """
        if device and not (device.isdecimal() and device.isascii() and int(device) <= 0xFFFF):
            raise ValueError(f"the device must be a number from 0 to 65535, not {device!r:.40}")
        if isinstance(decoder, Remembers):
            decoder.rearm(device)
        for name in [device] if device else list(self._stale):
            self._stale.pop(name, None)
        for number in [int(device)] if device else list(self._numbers):
            self._numbers.pop(number, None)
        if self._store is not None and self._key is not None:
            self._store.forget(self._key, int(device) if device else None)
