"""A simulated device at the end of a line that loses frames, or turns one bit in them."""

from imuscope.protocols.simulator.family import SimulatedDevice
from imuscope.server.links.simulated_line import LineFaults, SimulatedLine


class FaultyLine:
    """As the device, to a host at the other end.

    Args:
        drop, corrupt: shares of the frames.
    """

    next_ns = 0

    def __init__(
        self, protocol: str, device: SimulatedDevice, *, drop: float = 0.0, corrupt: float = 0.0, seed: int = 1
    ) -> None:
        self._device = device
        self._line = SimulatedLine(LineFaults(drop, corrupt), seed, protocol)

    def advance(self, now_ns: int) -> bytes:
        self._line.send(self._device.advance(now_ns), now_ns)
        return self._line.arrived(now_ns)

    def receive(self, data: bytes, now_ns: int) -> bytes:
        self._line.send(self._device.receive(data, now_ns), now_ns)
        return self._line.arrived(now_ns)
