"""Description of the simulated devices of a family; `sim:NAME?rate=400` creates one.

The options common to all simulated devices (rate, drop, drift_ppm …) are those of the line and the clock, and belong to
the server; a family adds its own as rows.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol


class SimulatedDevice(Protocol):
    """A simulated device, without a clock of its own.

    One with stored settings also has `repowered(start_ns)`: the device after a power cycle.
    """

    baud: int  # its present rate; a new one takes effect after Reset

    def advance(self, now_ns: int) -> bytes:
        """Everything the device sends up to that device time."""

    def receive(self, data: bytes, now_ns: int) -> bytes:
        """Handle bytes from the host; returns the device's answers."""

    @property
    def next_ns(self) -> int:
        """Time of its next message, so that polling before is unnecessary; 0 if unknown."""


@dataclass(frozen=True, slots=True)
class SimulatorOption:
    """An option of one family's devices only.

    Args:
        kind: "choice" (of `choices`), "number", "whole" (both from `low` to `high`), "list" (different whole numbers
            from `low` to `high`, as "1,2", at most `most`).
        default: its value if not given; () of a list.
    """

    name: str
    kind: Literal["choice", "number", "whole", "list"]
    default: Any
    choices: tuple[str, ...] = ()
    low: int = 0
    high: int = 0
    unit: str = ""
    most: int = 0


@dataclass(frozen=True, slots=True)
class SimulatorRequest:
    """Request for a simulated device.

    Args:
        product: one of the family's; "" if there is no choice.
        rate: samples/s.
        baud: rate of the line.
        start_ns: power-on time.
        clock_jump: after how many s the clock jumps ahead, and by how many; None for never.
        settings: of the family's decoder, as far as given (ProtocolInfo.settings): the key of encrypted frames.
        options: the family's own, by name.
    """

    product: str = ""
    rate: float = 100.0
    baud: int = 115_200
    seed: int = 0
    start_ns: int = 0
    clock_drift_ppm: float = 0.0
    clock_jump: tuple[float, float] | None = None
    settings: Mapping[str, Any] = field(default_factory=dict, repr=False)
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class SimulatorInfo:
    """The simulated devices of a family.

    Args:
        make: makes the devices on one line, freshly powered; usually one.
        bytes_per_s: their output at a rate in samples/s, by rate and options.
        preamble: start of a frame, and
        frame_size: its size from its first bytes, at most 20 (0: too few), for faults that lose and corrupt
            whole frames.
        words: short description for the help: "an MTi-630 at 100 Hz".
        device: the same for narrow places: "an MTi".
        products: the first is the default; () if there is no choice.
        least_baud: factory rate of its line.
        options: those of this family only.
        check: why product and options do not fit together, and what to do; None if they do. It gets the given options
            as text.
        usual: whether one streams if no source is given.
    """

    make: Callable[[SimulatorRequest], Sequence[SimulatedDevice]]
    bytes_per_s: Callable[[float, Mapping[str, Any]], float]
    preamble: bytes
    frame_size: Callable[[bytes], int]
    words: str = ""
    products: Callable[[], tuple[str, ...]] = tuple
    least_baud: int = 115_200
    options: tuple[SimulatorOption, ...] = ()
    check: Callable[[str, Mapping[str, str]], tuple[str, str] | None] = lambda product, chosen: None
    usual: bool = False
    device: str = ""
