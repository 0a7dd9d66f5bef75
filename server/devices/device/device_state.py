"""Published state of a device: status, name, identity and figures.

One `DeviceInfo` that is replaced as a whole, only if something changed, so that every page receives it once; and the
health figures, computed on demand.
"""

import re
from collections.abc import Callable
from dataclasses import replace

from imuscope.protocols.clocks.clock_sync import ClockSync
from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.server import wire
from imuscope.server.concurrency.listeners import CallbackList
from imuscope.server.devices.device.device_names import DeviceNames
from imuscope.server.devices.device.ingest import DeviceIdentity
from imuscope.server.devices.device.link_stats import LinkStatistics
from imuscope.server.streaming.sink import TelemetrySink

MAX_ATTEMPTS = 12
LINE_FULL = "the line is nearly full, so frames may wait in the device for an unknown time"
ARRIVES_S = 2.0  # delays are known from arriving bytes
MIN_DELAYS = 100  # delays, for one that 99 of 100 stay below
_TOPICS = re.compile(r"(?!serial:|file:)[a-z][\w+.-]*://(?P<host>[^/]+)(?P<path>/.+)")
_MODEL = re.compile(r"[A-Za-z]+(?:-[A-Z])?-\d+[A-Z]?")


class DeviceState:
    """State of a device as shown on the page.

    Args:
        info: initial state.
        title: displayed name of a protocol.
        names: names that users gave to devices.
    """

    def __init__(
        self,
        sink: TelemetrySink,
        info: wire.DeviceInfo,
        title: Callable[[str], str],
        names: DeviceNames | None = None,
    ) -> None:
        if info.parent and info.topic:
            address = info.id.removeprefix(f"{info.parent}.").lower()
            info = replace(info, topic=f"{info.topic}_{re.sub('[^a-z0-9]+', '_', address)}")
        elif names is not None:  # live
            info = replace(info, topic=names.topic_of(info.id, info.source))
        info = replace(info, former_name=names.former(info.id)[2] if names is not None else "")
        self.names = names or DeviceNames(None)
        self.info = info = self._named(replace(info, absent=_absent(info)))
        self.replaced: CallbackList[[str]] = CallbackList()  # called with the serial number of a sensor that is gone
        self._sink = sink
        self._title = title
        sink.set_device(info)

    def set(self, **changes: object) -> None:
        """Change fields of `info`; published only if they differ."""
        new = self._named(replace(self.info, **changes))  # type: ignore[arg-type]
        if (new.protocol, new.product) != (self.info.protocol, self.info.product):
            new = replace(new, absent=_absent(new))
        if new != self.info:
            self.info = new
            self._sink.set_device(new)

    def tried(self, attempt: wire.Attempt) -> None:
        """Store an attempt; one that repeats the previous attempt replaces it."""
        attempts = self.info.attempts
        if attempts and (attempts[-1].what, attempts[-1].outcome) == (attempt.what, attempt.outcome):
            attempts = attempts[:-1]
        self.set(attempts=[*attempts, attempt][-MAX_ATTEMPTS:])

    def identified(self, identity: DeviceIdentity) -> None:
        """Store the reported identity of the device. With another serial number it is another sensor, of which nothing
        else is known.
        """
        before, new = self.info.serial_number, identity.serial_number
        if new and not before:
            self.names.move(self.info.key, wire.key_of(replace(self.info, serial_number=new)))
        known = replace(self.info, product="", firmware="") if before and new and before != new else self.info
        self.set(
            product=identity.product or known.product,
            serial_number=new or before,
            firmware=identity.firmware or known.firmware,
            protection=identity.protection or known.protection,
            name=identity.name or self.name(identity.product, known.protocol, identity.fallback_name),
            unconfirmed_since=None if new else known.unconfirmed_since,
        )
        if self.info.product:
            self.names.identified(self.info.id, self.info.protocol, self.info.product, self.info.name)
        if before and new and before != new:
            self.replaced.call(before)

    def renamed(self) -> None:
        """Take over a name that was changed."""
        self.set()

    def _named(self, info: wire.DeviceInfo) -> wire.DeviceInfo:
        key = wire.key_of(info)
        return replace(info, key=key, own_name=self.names.name_of(key))

    def name(self, product: str, protocol: str, fallback: str = "") -> str:
        """Display name of a device: the model in its product code (MTi-630 of MTi-630-8A1G6), else the detected
        messages, the protocol or the link.
        """
        product = product or self.info.product
        model = _MODEL.match(product)
        if product:
            return model.group() if model else product
        return fallback or (self._title(protocol) if protocol else "") or short_source(self.info.source)


def health(
    device: str,
    figures: LinkStatistics,
    clock: ClockSync | None,
    capacity: float | None,
    now: float,
    cause: wire.JitterCause | None = None,
    *,
    is_full: bool = False,
) -> wire.DeviceHealth:
    """The figures for the page.

    Args:
        clock: mapping of the device clock to the host's; None if there is none yet.
        capacity: bytes/s that its link can carry, None if unknown.
        now: unix s.
        cause: why its arrival times are uneven.
        is_full: whether the link carries as much as it can: frames wait in the device for an unknown time then.
    """
    messages = figures.report(now)
    known = clock is not None and clock.uncertainty_ns < float("inf")
    mapped = clock if clock is not None and known and not is_full else None
    drifting = mapped if mapped is not None and mapped.knows_drift else None
    return wire.DeviceHealth(
        device=device,
        time=now,
        rate=max((message.rate for message in messages), default=0.0),
        messages=messages,
        gaps=figures.gaps,
        lost=figures.lost,
        numbered=figures.numbered,
        rejects=figures.rejects,
        rejects_by=dict(figures.rejects_by),
        unclaimed=figures.unclaimed,
        verified=figures.verified,
        unverified=figures.unverified,
        bytes=figures.bytes.total,
        bytes_per_s=figures.bytes.rate(now),
        capacity=capacity,
        jitter_ms=clock.jitter_ns() / 1e6 if clock is not None and known and clock.rows >= MIN_DELAYS else None,
        last_arrival=figures.last_sample or figures.last_arrival,
        drift_ppm=None if drifting is None else drifting.drift_ppm,
        drift_bound_ppm=None if drifting is None else drifting.drift_bound_ppm,
        uncertainty_ms=None if mapped is None else mapped.uncertainty_ns / 1e6,
        time_presumes=LINE_FULL if is_full and known else "" if mapped is None else mapped.presumes,
        jitter_cause=cause,
        behind=wire.Behind(link=_late(figures, clock, now)),
    )


def _late(figures: LinkStatistics, clock: ClockSync | None, now: float) -> float:
    """Delay of the newest bytes until they arrived, s, while there are any."""
    if clock is None or figures.last_arrival is None or now - figures.last_arrival > ARRIVES_S:
        return 0.0
    return clock.late_ns / 1e9


def short_source(source: str) -> str:
    """Short name of a source: /dev/ttyUSB0 → ttyUSB0; /dev/pts/4 → pts/4; tcp://host:1 → host:1; the topic of a host,
    if it is one; a file's name.
    """
    bare = source.partition("?")[0].rstrip("/")
    topics = _TOPICS.fullmatch(bare)
    if topics is not None:
        return topics["host"] if "," in topics["path"] else topics["path"]
    device = re.search("(?:^|//)/dev/(.+)", bare)
    return (device[1] if device else bare.rsplit("/", 1)[-1]) or source


def _absent(info: wire.DeviceInfo) -> list[str]:
    """Flags of its status words that this product does not have."""
    if not info.protocol or not info.product:
        return []
    row = PROTOCOLS.get(info.protocol)
    return list(row.device.absent(info.product)) if row is not None else []
