"""Status of a robot from its telemetry bus: devices with their figures, raised alarms, recording.

Loss is that of the last minute, from the counters of a device. It is unknown for a protocol that does not number its
samples, until a device has lost some after all.
"""

import re
from collections import deque
from collections.abc import Iterable, Mapping

import numpy as np

from imuscope.server import wire
from imuscope.server.devices.decode.protocol_set import device_counts_losses
from imuscope.server.devices.device.losses import LossWindow
from imuscope.server.extensions.fleet.model.reports import MAX_DEVICES, RobotDevice
from imuscope.server.streaming.bus import TelemetryBus
from imuscope.server.streaming.channel_store import ChannelStore, StoredChannel

LOSS_S = 60.0
RATE_S = 10.0  # shorter ones wobble by a sample
FRESH_S = 10.0  # a value that is older is not shown
MAX_TEXT_CHARS = 100
_FIX = re.compile(r"^fix_?type$", re.IGNORECASE)


def clipped(text: str, length: int = MAX_TEXT_CHARS) -> str:
    """Text of a device as one line, short enough for a report."""
    line = " ".join(text.encode("utf-8", "replace").decode().split())
    return line if len(line) <= length else line[: length - 1] + "…"


class DeviceFigures:
    """Figures of the devices of a server. To be called about once a second, in its event loop."""

    def __init__(self, bus: TelemetryBus, store: ChannelStore) -> None:
        self._bus, self._store = bus, store
        self._counts: dict[str, deque[tuple[float, Mapping[str, int]]]] = {}  # device → time, received
        self._losses: dict[str, LossWindow] = {}

    def devices(self) -> tuple[RobotDevice, ...]:
        """All devices, as many as fit into a report."""
        now = self._bus.now()
        infos = list(self._bus.devices.latest.values())[:MAX_DEVICES]
        for gone in self._counts.keys() - {info.id for info in infos}:
            del self._counts[gone], self._losses[gone]
        channels: dict[str, list[StoredChannel]] = {}
        for channel in self._store.all:
            channels.setdefault(channel.info.device, []).append(channel)
        return tuple(self._device(info, now, channels.get(info.id, [])) for info in infos)

    def _device(self, info: wire.DeviceInfo, now: float, channels: list[StoredChannel]) -> RobotDevice:
        health = self._bus.health_of(info.id)
        is_live = info.status == "live"
        rate, loss = (0.0, None) if health is None else self._rate_and_loss(info, health, channels)
        fresh = [one for one in channels if is_live and _arrival(one) > now - FRESH_S]
        return RobotDevice(
            id=clipped(info.id),
            name=clipped(info.name),
            status=info.status,
            product=clipped(info.product),
            serial_number=clipped(info.serial_number),
            firmware=clipped(info.firmware),
            protocol=clipped(info.protocol),
            rate=rate if is_live else 0.0,
            loss=loss,
            lost=0 if health is None else max(0, health.lost),
            fix=_fix(fresh),
            temperature=_temperature(fresh),
            clock_ppm=None if health is None or not is_live else _finite(health.drift_ppm),
            clock_ppm_uncertainty=None if health is None or not is_live else _finite(health.drift_bound_ppm),
            clock_uncertainty_ms=None if health is None or not is_live else _finite(health.uncertainty_ms),
        )

    def _rate_and_loss(
        self, info: wire.DeviceInfo, health: wire.DeviceHealth, channels: Iterable[StoredChannel]
    ) -> tuple[float, float | None]:
        """Rate of the fastest message of the last seconds, samples/s, and loss of the last minute."""
        now, counts = health.time, {message.name: message.count for message in health.messages}
        past = self._counts.setdefault(info.id, deque())
        losses = self._losses.setdefault(info.id, LossWindow(LOSS_S))
        if not losses.add(health) or any(
            counts.get(name, 0) < one for name, one in (past[-1][1] if past else {}).items()
        ):
            past.clear()  # its session was reopened
        if not past or now > past[-1][0]:
            past.append((now, counts))
        while len(past) > 1 and past[0][0] < now - RATE_S:
            past.popleft()
        span = now - past[0][0]
        rate = _most(counts, past[0][1]) / span if span > RATE_S / 2 else health.rate
        if not health.lost and not device_counts_losses(info, {one.info.name for one in channels}):
            return rate, None
        return rate, losses.share or 0.0


def _most(counts: Mapping[str, int], before: Mapping[str, int]) -> int:
    """Samples of the message that has most since."""
    return max((count - before.get(name, 0) for name, count in counts.items()), default=0)


def _finite(value: float | None) -> float | None:
    return None if value is None or not np.isfinite(value) else float(value)


def _arrival(channel: StoredChannel) -> float:
    rows = channel.ring.read(channel.ring.total - 1) if channel.ring.total else []
    return float(rows[0][-1]) if rows and len(rows[0]) else 0.0


def _newest(channel: StoredChannel, column: int) -> float | None:
    total = channel.ring.total
    rows = channel.ring.read(total - 1) if total else []
    return _finite(rows[2 + column][-1]) if rows and len(rows[0]) else None


def _temperature(channels: Iterable[StoredChannel]) -> float | None:
    for channel in channels:
        for at, column in enumerate(channel.info.columns):
            if "°C" in (column.unit, channel.info.unit):
                return _newest(channel, at)
    return None


def _fix(channels: Iterable[StoredChannel]) -> str:
    for channel in channels:
        for at, column in enumerate(channel.info.columns):
            if _FIX.match(column.name) and channel.info.kind != "table":
                value = _newest(channel, at)
                return "" if value is None else clipped(column.choices.get(str(int(value)), f"type {int(value)}"))
    return ""
