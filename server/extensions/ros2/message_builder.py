"""Builders of messages of ROS 2 from the samples of a device, and what they have in common. Pure."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.arrays import Floats
from imuscope.protocols.family.sensor_properties import SensorProperties
from imuscope.protocols.rotations import quaternions
from imuscope.server.extensions.ros2.axes import body_vectors, enu_from_flu
from imuscope.server.extensions.ros2.cdr_rows import RowEncoder, stamp_columns
from imuscope.server.extensions.ros2.joined_rows import RowBlock, RowJoin
from imuscope.server.extensions.ros2.quantities import DeviceQuantities, Place
from imuscope.server.wire.codec import SampleFrame

Samples = Mapping[int, Sequence[SampleFrame]]
Columns = dict[str, object]
Mask = NDArray[np.bool_]

ABSENT = np.array([-1.0, *(0.0,) * 8])


@dataclass(frozen=True, slots=True)
class FrameNames:
    """Names of frames, and whether vectors are turned to the axes of REP 103.

    Args:
        device: of the device: "imu0".
        map: of the world: "map".
    """

    device: str
    map: str = "map"
    rep103: bool = True


class MessageBuilder:
    """The messages of one topic.

    Args:
        type: of its messages.
        join: the channels that it needs.
        columns: values of the messages from complete rows; rows without a message are left out beforehand.
        encoder: with the texts of the messages.
        stamp: path of the time.

    Attributes:
        left_out: rows without a message so far.
    """

    def __init__(
        self,
        type_name: str,
        join: RowJoin,
        channels: set[int],
        columns: Callable[[RowBlock, float], Columns],
        texts: Mapping[str, str],
        *,
        lengths: Mapping[str, int] | None = None,
        stamp: str = "header.stamp",
        keep: Callable[[RowBlock], Mask] | None = None,
    ) -> None:
        self.type, self.channels = type_name, channels
        self.left_out = 0
        self._join, self._columns, self._stamp, self._keep = join, columns, stamp, keep
        self._texts, self._lengths = texts, lengths
        self._encoder: RowEncoder | None = None
        self._rate = RateEstimate()

    @property
    def frame(self) -> str:
        """The frame_id of its messages."""
        return self._texts.get("header.frame_id", "") or self._texts.get("transforms.0.child_frame_id", "")

    def build(self, samples: Samples) -> list[bytes]:
        """The messages that newly received samples make complete."""
        return self.build_with_arrivals(samples)[1]

    def build_with_arrivals(self, samples: Samples, *, waits: bool = True) -> tuple[Sequence[int], list[bytes]]:
        """The arrival of each message, ns since 1970, and the messages.

        Args:
            waits: whether other samples of the same time may still arrive.
        """
        block = self._join.take(samples, waits=waits)
        if block is None:
            return (), []
        rate = self._rate.update(block)
        if self._keep is not None:
            whole = np.flatnonzero(self._keep(block))
            self.left_out += len(block.times) - len(whole)
            block = kept_rows(block, whole)
        n = len(block.times)
        if n == 0:
            return (), []
        if self._encoder is None:
            self._encoder = RowEncoder(self.type, self._texts, self._lengths)
        columns = {**dict(stamp_columns(block.times, self._stamp)), **self._columns(block, rate)}
        return block.arrivals.tolist(), self._encoder.encode(n, columns)


@dataclass(slots=True)
class RateEstimate:
    """Rate of rows, from their times."""

    rate: float = 0.0
    _last: int = 0
    _intervals: list[int] = field(default_factory=list)

    def update(self, block: RowBlock) -> float:
        """Rows/s, the median of the last intervals; 0 at first."""
        steps = np.diff(block.times, prepend=self._last or block.times[0])
        self._last = int(block.times[-1])
        self._intervals += [int(step) for step in steps if 0 < step < 2_000_000_000]
        if len(self._intervals) >= 32 or (self._intervals and not self.rate):
            self.rate = 1e9 / float(np.median(self._intervals))
            self._intervals = []
        return self.rate


def alone(
    type_name: str, place: Place, columns: Callable[[RowBlock, float], Columns], texts: Mapping[str, str]
) -> MessageBuilder:
    """The builder of a quantity of one channel; rows with a value that is not a number are left out."""
    return MessageBuilder(type_name, RowJoin(place, {}), {place.channel}, columns, texts, keep=finite)


def finite(block: RowBlock) -> Mask:
    return np.asarray(np.isfinite(block.values).all(axis=1))


def attitudes(of: DeviceQuantities, frames: FrameNames, noise: SensorProperties, values: Floats) -> Floats:
    assert of.attitude is not None
    turns = quaternions(of.attitude.kind, list(values.T))
    return enu_from_flu(turns, of.attitude.frame, noise.axes) if frames.rep103 else turns


def in_body_axes(vectors: Floats, frames: FrameNames, noise: SensorProperties) -> Floats:
    return body_vectors(vectors, noise.axes) if frames.rep103 else vectors


def xyz(path: str, vectors: Floats) -> Columns:
    return {f"{path}.{axis}": vectors[:, at] for at, axis in enumerate("xyz")}


def diagonal(x: float, y: float, z: float) -> Floats:
    """Covariance matrix, row by row, of independent standard deviations."""
    return np.array([x * x, 0, 0, 0, y * y, 0, 0, 0, z * z])


def kept_rows(block: RowBlock, rows: NDArray[np.intp]) -> RowBlock:
    if len(rows) == len(block.times):
        return block
    others = {name: values[rows] for name, values in block.others.items()}
    return RowBlock(block.times[rows], block.arrivals[rows], block.values[rows], others)
