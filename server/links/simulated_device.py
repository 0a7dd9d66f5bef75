"""A simulated device as a source names it: which families, products and options there are, and a device made of them.

The grammar of the options is in server/links/simulator.py, which puts a device behind a port.
"""

from __future__ import annotations

import secrets
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from protocols.xbus.simulator.faults import NONE, FaultInjection
from server.links.base import LinkError
from server.links.ftdi_packets import PACKET
from server.links.simulated_line import LineFaults
from server.links.source_url import SourceUrl, bad

JUMP_S = 10.0
LINE_RATES = (115_200, 230_400, 460_800, 921_600, 2_000_000, 4_000_000)
MOODS = ("stubborn", "mute", "wrong", "late_ms", "cut")
OPTIONS = (
    *("product", "mode", "clock", "rate", "baud", "dead_baud", *MOODS, "drop", "corrupt", "burst_ms", "packet"),
    *("drift_ppm", "jump_s", "reset_s", "unplug_s", "away_s", "seed", "imu_source", "port", "bus_ids"),
)
HOST_PORTS = ("rs232", "uart")  # of a 600-series, in the order of the words of its PortConfig
MOST_ON_A_LINE = 4
MODES = ("lite", "safety", "secure")
CLOCKS: Mapping[str, int] = {"us": 1_000, "ns": 1, "ms": 1_000_000, "s": 1_000_000_000}


@dataclass(frozen=True, slots=True)
class SimulatorFamily:
    """What twins of a protocol are like.

    Args:
        products: the first is the usual one; () where there is no choice.
        sample_bytes: sent for each sample in the default configuration.
        more_bytes: sent each second beside that.
        least_baud: rate of its line when it leaves the factory.
        options: which only this family has.
    """

    products: Callable[[], tuple[str, ...]]
    sample_bytes: int
    more_bytes: int = 0
    least_baud: int = 115_200
    options: tuple[str, ...] = ()


def _mti() -> tuple[str, ...]:
    from protocols.xbus.simulator.settings import PRODUCTS  # when first used: its tables load what is compiled

    return "MTi-630", *(name for name in PRODUCTS if name != "MTi-630")


FAMILIES: Mapping[str, SimulatorFamily] = {
    "xbus": SimulatorFamily(_mti, 88, options=("product", "port", "bus_ids", *MOODS)),
    "isb": SimulatorFamily(lambda: ("IMX-5", "GPX-1"), 132, 8_000, 921_600, ("product", "imu_source")),
    "idtp": SimulatorFamily(lambda: (), 104, options=("mode", "clock")),  # of Safety; Secure has 56 more
}
SECURE_BYTES = 56


class Device(Protocol):
    """The other end of the wire (`protocols.xbus.simulator.device.XbusSimulator`): no clock of its own.

    Several on one line are a SharedLine.
    """

    baud: int  # the rate it speaks at; a new one acts after Reset

    def advance(self, now_ns: int) -> bytes:
        """Everything the device sends up to that device time."""

    def receive(self, data: bytes, now_ns: int) -> bytes:
        """Bytes from the host; what the device answers."""

    @property
    def next_ns(self) -> int:
        """Time of its next message, so that nobody need ask before; 0 where that is not known."""


@dataclass(frozen=True, slots=True)
class SimulatorOptions:
    """What the query of a twin source may say; see the module docstring."""

    protocol: str = "xbus"
    product: str = "MTi-630"
    mode: str = "safety"
    clock: str = "us"
    rate: float = 100.0
    faults: LineFaults = field(default_factory=lambda: LineFaults(baud=115_200))
    drift_ppm: float = 0.0
    jump_s: float = 0.0
    reset_s: float = 0.0
    unplug_s: float = 0.0
    away_s: float = 5.0
    seed: int = 0
    imu_source: str = "nav"
    moods: FaultInjection = NONE
    port: str = "rs232"
    bus_ids: tuple[int, ...] = ()

    @classmethod
    def of(cls, source: SourceUrl) -> SimulatorOptions:
        """Read a twin source.

        Raises:
            LinkError: kind "bad-source".
        """
        family = FAMILIES.get(source.place)
        if family is None:
            allowed = ", ".join(FAMILIES)
            raise LinkError("bad-source", f"There is no twin of {source.place!r}.", f"Twins exist of: {allowed}.")
        others = {name for other in FAMILIES.values() for name in other.options} - set(family.options)
        source.allow([name for name in OPTIONS if name not in others])
        products = family.products()
        rate = source.number("rate", 100, 1, 2000, "Hz")
        mode = source.choice("mode", "safety", MODES)
        product = source.choice("product", products[0], products) if products else ""
        port = source.choice("port", HOST_PORTS[0], HOST_PORTS)
        if "port" in source.options and not product.startswith("MTi-6"):
            raise bad(
                source.text, f"an {product} has one port", "Leave port out, or choose a product of the 600-series."
            )
        bus_ids = _bus_ids(source)
        return cls(
            protocol=source.place,
            product=product,
            mode=mode,
            clock=source.choice("clock", "us", tuple(CLOCKS)),
            rate=rate,
            faults=LineFaults(
                drop=source.number("drop", 0, 0, 1),
                corrupt=source.number("corrupt", 0, 0, 1),
                burst_ms=source.number("burst_ms", 0, 0, 1000, "ms"),
                packet=source.whole("packet", PACKET, 0, 65_536, "bytes"),
                baud=source.whole("baud", _fitting(family, rate * (len(bus_ids) or 1), mode), 4800, 4_000_000, "Bd"),
                dead_baud=source.whole("dead_baud", 0, 0, 4_000_000, "Bd") or None,
            ),
            moods=FaultInjection(
                mute=source.number("mute", 0, 0, 1),
                wrong=source.number("wrong", 0, 0, 1),
                late_ns=round(source.number("late_ms", 0, 0, 60_000, "ms") * 1e6),
                cut=source.whole("cut", 0, 0, 1_000_000),
                stubborn=bool(source.whole("stubborn", 0, 0, 1)),
            ),
            drift_ppm=source.number("drift_ppm", 0, -10_000, 10_000, "ppm"),
            jump_s=source.number("jump_s", 0, 0, 86_400, "s"),
            reset_s=source.number("reset_s", 0, 0, 86_400, "s"),
            unplug_s=source.number("unplug_s", 0, 0, 86_400, "s"),
            away_s=source.number("away_s", 5, 0, 3600, "s"),
            seed=source.whole("seed", 0, 0, 2**31),
            imu_source=source.choice("imu_source", "nav", ("nav", "imu")),
            port=port,
            bus_ids=bus_ids,
        )


def _bus_ids(source: SourceUrl) -> tuple[int, ...]:
    """The devices of a shared line, such as "1,2"."""
    text = source.options.get("bus_ids")
    if text is None:
        return ()
    allowed = f"1 to {MOST_ON_A_LINE} different numbers from 1 to 254"
    ids = [int(part) if part.strip().isdecimal() else 0 for part in text.split(",")]
    if not all(0 < bid < 255 for bid in ids) or len(set(ids)) < len(ids) or len(ids) > MOST_ON_A_LINE:
        raise bad(source.text, f"bus_ids is {text!r:.40}, not {allowed}", f"Give bus_ids as {allowed}, such as 1,2.")
    return tuple(ids)


def _fitting(family: SimulatorFamily, rate: float, mode: str) -> int:
    """The slowest usual rate that carries so many samples/s with a fifth to spare; the fastest where none does."""
    sample = family.sample_bytes + SECURE_BYTES * (mode == "secure")
    needed = sample * rate + family.more_bytes
    fitting = (baud for baud in LINE_RATES if baud >= family.least_baud and 0.8 * baud / 10 >= needed)
    return next(fitting, LINE_RATES[-1])


def make_device(options: SimulatorOptions, start_ns: int, key: bytes | None = None) -> Device:
    """A freshly powered device.

    Args:
        key: for Secure frames; None for one that nobody knows.
    """
    from protocols.idtp.simulator import IdtpSimulator
    from protocols.isb.simulator.device import IsbSimulator
    from protocols.isb.simulator.gpx import GpxSimulator
    from protocols.xbus.simulator.device import XbusSimulator

    jump = (options.jump_s, JUMP_S) if options.jump_s else None
    seed, drift = options.seed, options.drift_ppm
    if options.protocol == "idtp":
        return IdtpSimulator(
            device_id=102 + seed % 1000,
            seed=seed,
            start_ns=start_ns,
            rate=options.rate,
            mode=MODES.index(options.mode),
            key=(key or secrets.token_bytes(32)) if options.mode == "secure" else None,
            clock_drift_ppm=drift,
            clock_jump=jump,
            tick_ns=CLOCKS[options.clock],
        )
    if options.protocol == "isb":
        made = GpxSimulator if options.product.startswith("GPX") else IsbSimulator
        return made(
            product=options.product,
            rate=options.rate,
            seed=seed,
            start_ns=start_ns,
            clock_drift_ppm=drift,
            clock_jump=jump,
            imu_source=options.imu_source,
            road=1.0,
            baud=options.faults.baud,
        )
    members = [
        XbusSimulator(
            options.product,
            None,
            seed + place,
            start_ns,
            rate=options.rate,
            clock_drift_ppm=drift,
            clock_jump=jump,
            road=1.0,
            baud=options.faults.baud,
            port=HOST_PORTS.index(options.port),
            moods=options.moods,
            bid=bid,
        )
        for place, bid in enumerate(options.bus_ids or (None,))
    ]
    return SharedLine(members) if options.bus_ids else members[0]


class SharedLine:
    """Several devices on one line: all hear the host, each sends at the rate that it speaks at."""

    def __init__(self, members: Sequence[Device]) -> None:
        self.members = tuple(members)

    @property
    def baud(self) -> int:
        """The rate of the line: that of its first device."""
        return self.members[0].baud

    @baud.setter
    def baud(self, rate: int) -> None:
        for one in self.members:
            one.baud = rate

    def advance(self, now_ns: int) -> bytes:
        """Everything that the devices send up to that time, one after the other."""
        return b"".join(one.advance(now_ns) for one in self.members)

    def receive(self, data: bytes, now_ns: int) -> bytes:
        """Bytes from the host, for all of them; what they answer."""
        return b"".join(one.receive(data, now_ns) for one in self.members)

    @property
    def next_ns(self) -> int:
        """Time of the next message of any of them; 0 where that is not known."""
        return min(one.next_ns for one in self.members)

    def repowered(self, start_ns: int) -> SharedLine:
        """The same devices after the power of all was off."""
        return SharedLine([power_cycled(one, start_ns, _never) for one in self.members])


def _never(start_ns: int) -> Device:
    raise AssertionError("a device that shares a line has a memory of its own")


def members_of(device: Device) -> Sequence[Device]:
    """The devices at the other end of a line."""
    return device.members if isinstance(device, SharedLine) else (device,)


def power_cycled(device: Device | None, now_ns: int, make: Callable[[int], Device]) -> Device:
    """The device after its power was off: with what it stored, where it has such a memory; otherwise a new one."""
    repowered = getattr(device, "repowered", None)
    if repowered is None:
        return make(now_ns)
    same: Device = repowered(now_ns)
    return same
