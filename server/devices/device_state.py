"""What is told about a device: its state, its name, who it said it is, its figures?

One `DeviceInfo` that changes whole and only when something in it changed, so that every page is told once; and the
health figures, put together when they are asked for.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

from protocols.clock_sync import ClockSync
from server import wire
from server.devices.ingest import DeviceIdentity
from server.devices.link_stats import LinkStatistics
from server.streaming.hub import Hub

TRIES_KEPT = 12
_MODEL = re.compile(r"[A-Za-z]+(?:-[A-Z])?-\d+[A-Z]?")


class DeviceState:
    """A device as the page knows it.

    Args:
        info: how it begins.
        title: a protocol's name for a person.
    """

    def __init__(self, hub: Hub, info: wire.DeviceInfo, title: Callable[[str], str]) -> None:
        self.info = info = replace(info, absent=_absent(info))
        self._hub = hub
        self._title = title
        hub.set_device(info)

    def set(self, **changes: object) -> None:
        """Change fields of `info`; told only when that makes a difference."""
        new = replace(self.info, **changes)  # type: ignore[arg-type]
        if (new.protocol, new.product) != (self.info.protocol, self.info.product):
            new = replace(new, absent=_absent(new))
        if new != self.info:
            self.info = new
            self._hub.set_device(new)

    def tried(self, attempt: wire.Try) -> None:
        """Keep the last tries; one that repeats takes the place of its predecessor."""
        tries = self.info.tries
        if tries and (tries[-1].what, tries[-1].outcome) == (attempt.what, attempt.outcome):
            tries = tries[:-1]
        self.set(tries=[*tries, attempt][-TRIES_KEPT:])

    def identified(self, identity: DeviceIdentity) -> None:
        """The device said who it is."""
        self.set(
            product=identity.product or self.info.product,
            serial_number=identity.serial_number or self.info.serial_number,
            firmware=identity.firmware or self.info.firmware,
            protection=identity.protection or self.info.protection,
            name=identity.name or self.name(identity.product, self.info.protocol, identity.speaks),
        )

    def name(self, product: str, protocol: str, heard: str = "") -> str:
        """What people call it: the model in its product code (MTi-630 of MTi-630-8A1G6), else what is heard of it,
        protocol or link."""
        product = product or self.info.product
        model = _MODEL.match(product)
        if product:
            return model.group() if model else product
        return heard or (self._title(protocol) if protocol else short_source(self.info.source))


def health(
    device: str,
    figures: LinkStatistics,
    clock: ClockSync | None,
    capacity: float | None,
    now: float,
    cause: wire.TimeCause | None = None,
) -> wire.DeviceHealth:
    """The figures for the page.

    Args:
        clock: of the device, mapped to the host's; None while there is none.
        capacity: bytes/s that its link can carry, None where that is not known.
        now: unix s.
        cause: why its times are uneven.
    """
    messages = figures.report(now)
    known = clock is not None and clock.uncertainty_ns < float("inf")
    return wire.DeviceHealth(
        device=device,
        time=now,
        rate=max((message.rate for message in messages), default=0.0),
        messages=messages,
        gaps=figures.gaps,
        lost=figures.lost,
        rejects=figures.rejects,
        rejects_by=dict(figures.rejects_by),
        verified=figures.verified,
        unverified=figures.unverified,
        bytes=figures.bytes.total,
        bytes_per_s=figures.bytes.rate(now),
        capacity=capacity,
        jitter_ms=clock.jitter_ns() / 1e6 if clock is not None and known else None,
        last_arrival=figures.last_sample or figures.last_arrival,
        drift_ppm=clock.drift_ppm if clock is not None and known else None,
        uncertainty_ms=clock.uncertainty_ns / 1e6 if clock is not None and known else None,
        time_cause=cause,
    )


def short_source(source: str) -> str:
    """/dev/ttyUSB0 → ttyUSB0; /dev/pts/4 → pts/4; tcp://host:1 → host:1; a file by its name."""
    bare = source.partition("?")[0].rstrip("/")
    device = re.search("(?:^|//)/dev/(.+)", bare)
    return (device[1] if device else bare.rsplit("/", 1)[-1]) or source


def _absent(info: wire.DeviceInfo) -> list[str]:
    """Flags of its status words that this product does not have."""
    if not info.protocol or not info.product:
        return []
    from protocols.registry import PROTOCOLS  # when it is first of use: it loads what is compiled

    row = PROTOCOLS.get(info.protocol)
    return list(row.absent(info.product)) if row is not None else []
