"""Recent samples of every channel, in ring buffers.

    advertise(info) ─> id          append(rows) ─> ring of the channel ─> RingBuffer.frames, .read, …
                                                    oldest blocks dropped

Memory is bounded: a ring holds at most `history_s` before the newest sample of its device, so that a file that has
ended or a sensor that was unplugged keeps its samples; all rings together hold at most `budget` bytes. Above it the
oldest block of all is dropped first, so that all channels reach about equally far back.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

from imuscope.server import wire
from imuscope.server.streaming.channel_rows import ChannelRows, WireRows
from imuscope.server.streaming.channels import factors_of
from imuscope.server.streaming.ring_buffer import RingBuffer

TRIM_S = 1.0
HISTORY_S = 600.0
BUDGET_BYTES = 256 * 1024 * 1024


@dataclass(frozen=True, slots=True)
class StoredChannel:
    """Description of a channel, and the ring buffer of its samples."""

    info: wire.ChannelInfo
    ring: RingBuffer


class ChannelStore:
    """The channels of all devices.

    Args:
        now: unix seconds that never step.
        history_s: how long samples are kept, before the newest one of their device.
        budget: bytes of all rings together.
        reserved: part of the budget that something else uses at present, bytes.
    """

    def __init__(
        self,
        now: Callable[[], float],
        history_s: float = HISTORY_S,
        budget: int = BUDGET_BYTES,
        reserved: Callable[[], int] = lambda: 0,
    ) -> None:
        self.history_s = history_s
        self._now = now
        self._budget = budget
        self._reserved = reserved
        self._channels: dict[int, StoredChannel] = {}
        self._next = 1
        self._next_trim = 0.0

    def advertise(self, info: wire.ChannelInfo) -> wire.ChannelInfo:
        """Open a channel; returns its description with its id, which is never used again in this run."""
        info = replace(info, id=self._next)
        self._next += 1
        self._channels[info.id] = StoredChannel(
            info, RingBuffer([column.dtype for column in info.columns], factors_of(info))
        )
        return info

    def append(self, pieces: Iterable[ChannelRows | WireRows]) -> list[int]:
        """Store samples, except those of removed devices; returns the channels with new ones."""
        touched = []
        for piece in pieces:
            channel = self._channels.get(piece.channel)
            if channel is None or not len(piece):
                continue
            if isinstance(piece, WireRows):
                channel.ring.append_wire(piece)
            else:
                channel.ring.append(piece.columns)
            touched.append(piece.channel)
        now = self._now()
        if now >= self._next_trim:
            self._next_trim = now + TRIM_S
            self._trim()
        return touched

    def remove_device(self, device: str) -> None:
        self._channels = {number: one for number, one in self._channels.items() if one.info.device != device}

    def remove_channel(self, channel: int) -> None:
        """Remove one channel; its later samples are ignored."""
        self._channels = {number: one for number, one in self._channels.items() if number != channel}

    def get(self, channel: int) -> StoredChannel | None:
        """A channel by its id; None if its device was removed, or the id is unknown."""
        return self._channels.get(channel)

    def of(self, channel: int) -> StoredChannel:
        """A channel by its id; KeyError for an unknown id."""
        return self._channels[channel]

    @property
    def all(self) -> list[StoredChannel]:
        """Every channel, in order of advertisement."""
        return list(self._channels.values())

    def of_device(self, device: str) -> dict[int, wire.ChannelInfo]:
        """The channels of a device, by id."""
        return {number: one.info for number, one in self._channels.items() if one.info.device == device}

    def newest(self) -> dict[str, float]:
        """Arrival of the newest sample of each device that has one, unix s."""
        newest: dict[str, float] = {}
        for one in self._channels.values():
            if len(one.ring):
                newest[one.info.device] = max(newest.get(one.info.device, -math.inf), one.ring.newest)
        return newest

    @property
    def nbytes(self) -> int:
        """Memory of all rings."""
        return sum(one.ring.nbytes for one in self._channels.values())

    def _trim(self) -> None:
        rings = [channel.ring for channel in self._channels.values()]
        newest = self.newest()
        for one in self._channels.values():
            if len(one.ring):
                one.ring.drop_before(newest[one.info.device] - self.history_s)
        excess = self.nbytes + self._reserved() - self._budget
        while excess > 0:
            droppable = [ring for ring in rings if ring.blocks > 1]
            if not droppable:
                return
            oldest = min(droppable, key=lambda ring: ring.oldest_end)
            before = oldest.nbytes
            oldest.drop_oldest()
            excess -= before - oldest.nbytes
