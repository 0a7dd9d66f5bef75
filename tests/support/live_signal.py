"""A bus with one device that sends an acceleration, without a session: for what follows live signals."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from imuscope.server import wire
from imuscope.server.streaming.channel_rows import ChannelRows
from imuscope.server.streaming.telemetry import Telemetry

BEGIN = 1_760_000_000.0


class LiveSignal:
    """The bus, and a clock that its samples move.

    Args:
        info: of the acceleration.
        late: s from the time of a sample to its arrival.
    """

    def __init__(self, device: wire.DeviceInfo, info: wire.ChannelInfo, late: float = 0.0) -> None:
        self.now = BEGIN
        self.telemetry = Telemetry.create(lambda: self.now)
        self.telemetry.bus.set_device(device)
        self.channel = self.telemetry.bus.advertise(info)
        self._late = late

    def publish(self, n: int, rate: float, columns: Sequence[NDArray[np.float64]]) -> None:
        time = self.now + np.arange(n) / rate
        self.now += n / rate
        self.telemetry.bus.publish([ChannelRows(self.channel, [time + self._late, time, *columns])])
