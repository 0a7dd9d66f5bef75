"""Simulated devices of simulator sources: family, options, and creation of the device.

The grammar of the options is in server/links/simulator.py, which puts a device behind a port. Options of a single
family are in its SimulatorInfo.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.protocols.simulator.family import SimulatedDevice, SimulatorInfo, SimulatorOption, SimulatorRequest
from imuscope.server.links.base import LinkError
from imuscope.server.links.simulated_line import PACKET_BYTES, LineFaults
from imuscope.server.links.source_url import SourceUrl, bad

JUMP_S = 10.0
LINE_RATES = (115_200, 230_400, 460_800, 921_600, 2_000_000, 4_000_000)
OPTIONS = (
    *("rate", "baud", "dead_baud", "drop", "corrupt", "burst_ms", "packet"),
    *("drift_ppm", "jump_s", "reset_s", "unplug_s", "away_s", "seed"),
)
"""Options common to the simulated devices of all families."""


def simulators() -> Mapping[str, SimulatorInfo]:
    """Available simulated devices, by protocol."""
    return {name: family.simulator for name, family in PROTOCOLS.items() if family.simulator is not None}


def default_sources() -> list[str]:
    """Sources used if none is given."""
    return [f"sim:{name}" for name, simulator in simulators().items() if simulator.usual]


@dataclass(frozen=True, slots=True)
class SimulatorOptions:
    """Options in the query of a simulator source; see server/links/simulator.py.

    Args:
        own: options of this family only, with their defaults.
    """

    protocol: str
    product: str = ""
    rate: float = 100.0
    faults: LineFaults = field(default_factory=lambda: LineFaults(baud=115_200))
    drift_ppm: float = 0.0
    jump_s: float = 0.0
    reset_s: float = 0.0
    unplug_s: float = 0.0
    away_s: float = 5.0
    seed: int = 0
    own: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, source: SourceUrl) -> "SimulatorOptions":
        """Read a simulator source.

        Raises:
            LinkError: kind "bad-source".
        """
        known = simulators()
        family = known.get(source.place)
        if family is None:
            allowed = ", ".join(known)
            raise LinkError("bad-source", f"Unknown simulator {source.place!r}.", f"Available: {allowed}.")
        products = family.products()
        source.allow([*(("product",) if products else ()), *(option.name for option in family.options), *OPTIONS])
        rate = source.number("rate", 100, 1, 2000, "Hz")
        product = source.choice("product", products[0], products) if products else ""
        if misfit := family.check(product, source.options):
            raise bad(source.text, *misfit)
        own = {option.name: _value(source, option) for option in family.options}
        return cls(
            protocol=source.place,
            product=product,
            rate=rate,
            faults=LineFaults(
                drop=source.number("drop", 0, 0, 1),
                corrupt=source.number("corrupt", 0, 0, 1),
                burst_ms=source.number("burst_ms", 0, 0, 1000, "ms"),
                packet=source.whole("packet", PACKET_BYTES, 0, 65_536, "bytes"),
                baud=source.whole("baud", _fitting(family, family.bytes_per_s(rate, own)), 4800, 4_000_000, "Bd"),
                dead_baud=source.whole("dead_baud", 0, 0, 4_000_000, "Bd") or None,
            ),
            drift_ppm=source.number("drift_ppm", 0, -10_000, 10_000, "ppm"),
            jump_s=source.number("jump_s", 0, 0, 86_400, "s"),
            reset_s=source.number("reset_s", 0, 0, 86_400, "s"),
            unplug_s=source.number("unplug_s", 0, 0, 86_400, "s"),
            away_s=source.number("away_s", 5, 0, 3600, "s"),
            seed=source.whole("seed", 0, 0, 2**31),
            own=own,
        )


def _value(source: SourceUrl, option: SimulatorOption) -> Any:
    """Value of an option of the family.

    Raises:
        LinkError: kind "bad-source".
    """
    match option.kind:
        case "choice":
            return source.choice(option.name, option.default, option.choices)
        case "number":
            return source.number(option.name, option.default, option.low, option.high, option.unit)
        case "whole":
            return source.whole(option.name, option.default, option.low, option.high, option.unit)
        case "list":
            return _numbers(source, option)


def _numbers(source: SourceUrl, option: SimulatorOption) -> tuple[int, ...]:
    """Distinct whole numbers, such as "1,2"."""
    text = source.options.get(option.name)
    if text is None:
        return tuple(option.default)
    allowed = f"1 to {option.most} different numbers from {option.low} to {option.high}"
    numbers = [int(part) if part.strip().isdecimal() else -1 for part in text.split(",")]
    is_inside = all(option.low <= number <= option.high for number in numbers)
    if not is_inside or len(set(numbers)) < len(numbers) or len(numbers) > option.most:
        raise bad(
            source.text,
            f"{option.name} is {text!r:.40}, not {allowed}",
            f"Give {option.name} as {allowed}, such as 1,2.",
        )
    return tuple(numbers)


def _fitting(family: SimulatorInfo, bytes_per_s: float) -> int:
    """The slowest usual rate with a fifth of its capacity to spare; the fastest if none has."""
    fitting = (baud for baud in LINE_RATES if baud >= family.least_baud and 0.8 * baud / 10 >= bytes_per_s)
    return next(fitting, LINE_RATES[-1])


def make_device(
    options: SimulatorOptions, start_ns: int, decode_options: Mapping[str, str] | None = None
) -> SimulatedDevice:
    """Create a freshly powered device.

    Args:
        decode_options: of the source, as text: a device that encrypts has its key from them, else a random one.
    """
    family = simulators()[options.protocol]
    products = family.products()
    own = {option.name: option.default for option in family.options}
    members = family.make(
        SimulatorRequest(
            product=options.product or (products[0] if products else ""),
            rate=options.rate,
            baud=options.faults.baud or LINE_RATES[0],
            seed=options.seed,
            start_ns=start_ns,
            clock_drift_ppm=options.drift_ppm,
            clock_jump=(options.jump_s, JUMP_S) if options.jump_s else None,
            settings=PROTOCOLS[options.protocol].settings(decode_options or {}),
            options={**own, **options.own},
        )
    )
    return SharedLine(members) if len(members) > 1 else members[0]


class SharedLine:
    """Several devices on one line: all receive from the host, each sends at its own rate."""

    def __init__(self, members: Sequence[SimulatedDevice]) -> None:
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
        """Bytes that the devices send up to that time, one after the other."""
        return b"".join(one.advance(now_ns) for one in self.members)

    def receive(self, data: bytes, now_ns: int) -> bytes:
        """Pass bytes from the host to all devices; return their answers."""
        return b"".join(one.receive(data, now_ns) for one in self.members)

    @property
    def next_ns(self) -> int:
        """Time of the next message of any of them; 0 if unknown."""
        return min(one.next_ns for one in self.members)

    def repowered(self, start_ns: int) -> "SharedLine":
        """The same devices after a power cycle of all of them."""
        return SharedLine([power_cycled(one, start_ns, _never) for one in self.members])


def _never(start_ns: int) -> SimulatedDevice:
    raise AssertionError("a device on a shared line has its own memory")


def members_of(device: SimulatedDevice) -> Sequence[SimulatedDevice]:
    """The devices at the other end of a line."""
    return device.members if isinstance(device, SharedLine) else (device,)


def power_cycled(
    device: SimulatedDevice | None, now_ns: int, make: Callable[[int], SimulatedDevice]
) -> SimulatedDevice:
    """The device after a power cycle: with its stored settings if it has a memory, otherwise a new one."""
    repowered = getattr(device, "repowered", None)
    if repowered is None:
        return make(now_ns)
    same: SimulatedDevice = repowered(now_ns)
    return same
