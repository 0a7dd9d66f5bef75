"""Discovery of a device's streams and their rates: DID_RMC names the streams, listening gives their periods.

    DID_RMC.bits        1 0 1 …            data sets that have been requested
    DID_SYS_PARAMS      10 ms, 10 ms       the periods of navigation and inertial data now; GNSS from the configuration
    listening           ·  ·  ·  ·         the median interval of packets / the source's period = the requested period
                        ·        ·

The measurement decides: period × source_ms of a row is the interval of its packets. If document and header disagree on
the source (DID_IMU: the period of inertial data, or that of navigation), the first one of which the interval is a
multiple is used; if there is none, the interval itself.

A streaming data set without a bit (DID_SYS_PARAMS) is found by listening alone. One with its bit that was not received
within `listen_s` (no RTK, no second receiver) has a size of 0, and the period of a bit alone: 1. Rare events (a strobe)
have no period and get 1.

The wire values of an event are also computed here. A decoder's columns are in displayed units; a snapshot holds wire
values.

Source: ISB document, "Realtime Message Controller", "Data source update rates".
"""

import math
import struct
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from imuscope.protocols.commands.transactions import DeviceRejectedError, Transaction, WaitFor
from imuscope.protocols.events import Batch, Event, Reply
from imuscope.protocols.isb.commands import FLASH, RMC, SYS_PARAMS
from imuscope.protocols.isb.messages import ROWS
from imuscope.protocols.isb.stored_settings import PERSISTENT
from imuscope.protocols.isb.streams import DEFAULT_MS, EVENT, GNSS, IMU, NAV, STREAMS, dids_of
from imuscope.protocols.schema.fields import Field

Values = Mapping[str, Any]
Requester = Callable[[int], Transaction[Values]]

LONGEST_NS = 3e9  # a longer step of the device's clock between two packets is a jump
MULTIPLE_TOLERANCE = 0.04  # share within which a multiple counts as one
NOTHING: Mapping[int, int] = {}
MIN_SAMPLES = 3  # samples needed for a reliable period
GPX_FLASH, GPX_RMC = 121, 126


@dataclass(frozen=True, slots=True)
class ListeningTimes:
    """Time limits of listening to the streams of a device, s. Tests pass shorter ones.

    Args:
        least_s: always listened for, so that data sets without a bit are found, too.
        listen_s: the longest, if a data set that has its bit was not received yet.
    """

    least_s: float = 1.0
    listen_s: float = 3.0


# -- an event as wire values -------------------------------------------------------------------------------------------


def to_wire(event: Event, did: int) -> Values | None:
    """The wire values of a data set, of the last sample if there are several; None for any other event."""
    if isinstance(event, Reply):
        if event.message is not ROWS[did]:
            return None
        return {field.name: _spelled(field, event.values[field.name]) for field in _named(event)}
    if isinstance(event, Batch) and event.message.id == did and len(event):
        return {field.name: _unshown(field, event.columns[field.name][-1]) for field in event.message.fields}
    return None


def _named(reply: Reply) -> list[Field]:
    """The fields of an answer; one with another shape in the table is taken as received."""
    rows = {field.name: field for field in reply.message.fields}
    return [rows.get(name, Field(name)) for name in reply.values]


def _spelled(field: Field, value: Any) -> Any:
    """A JSON-compatible value: a float that is not finite as its bits, as `imuscope inspect` prints it."""
    if isinstance(value, list):
        return [_spelled(field, one) for one in value]
    if isinstance(value, Mapping):
        parts = {part.name: part for part in field.fields}
        return {name: _spelled(parts.get(name, Field(name)), one) for name, one in value.items()}
    if isinstance(value, float) and not math.isfinite(value):
        wide = field.dtype.endswith("f8")
        return {"f64" if wide else "f32": struct.pack(">d" if wide else ">f", value).hex()}
    return value


def _unshown(field: Field, shown: Any) -> Any:
    """A column's element as on the wire."""
    if field.fields:
        rows = [{part.name: _unshown(part, one[part.name]) for part in field.fields} for one in np.atleast_1d(shown)]
        return rows if field.shape else rows[0]
    if field.dtype == "ascii" and len(field.shape) == 2:
        return [_unshown(replace(field, shape=field.shape[1:]), one) for one in np.asarray(shown)]
    if field.dtype == "ascii":
        return np.asarray(shown).tobytes().rstrip(b"\0").decode("latin-1")
    if field.dtype == "bytes":
        return np.asarray(shown).tobytes().hex()
    scale = 1.0 if field.sent_unit else field.scale
    wire = (np.asarray(shown) - field.bias) / scale if scale != 1 or field.bias else np.asarray(shown)
    kind = np.dtype(field.dtype)
    numbers = (wire if kind.kind == "f" else np.rint(wire) if wire.dtype.kind == "f" else wire).astype(kind)
    return _spelled(field, numbers.reshape(-1).tolist() if field.shape else numbers.item())


# -- streams -----------------------------------------------------------------------------------------------------------


class ObservedStreams:
    """Streams observed while listening: interval and size for each data set.

    Args:
        dids: data sets whose period is required; listening ends when it is known.
    """

    def __init__(self, dids: set[int]) -> None:
        self._left = dids
        self._times: dict[int, list[tuple[int, int]]] = {}
        self.sizes: dict[int, int] = {}

    @property
    def enough(self) -> bool:
        """Whether every required period is known."""
        return not self._left

    def observe(self, event: Event) -> bool | None:
        """Add an event; True when all required periods are known."""
        self.only(event)
        return True if self.enough else None

    def only(self, event: Event) -> None:
        """Add an event, without an end condition."""
        if isinstance(event, Batch) and event.message.id in STREAMS:
            device = event.arrival_ns if event.time_ns is None else event.time_ns
            times = list(zip(device.tolist(), event.arrival_ns.tolist(), strict=True))
            self._record(event.message.id, times, getattr(event.columns, "row_size", 0))
        elif isinstance(event, Reply) and event.message.id in STREAMS and event.message is ROWS[event.message.id]:
            self._record(event.message.id, [(event.arrival_ns, event.arrival_ns)], 0)

    def _record(self, did: int, times: list[tuple[int, int]], size: int) -> None:
        known = self._times.setdefault(did, [])
        known += times
        self.sizes[did] = max(size, self.sizes.get(did, 0))
        if len(known) >= MIN_SAMPLES:
            self._left.discard(did)

    def interval_ms(self, did: int) -> float | None:
        """The usual time between two packets; None for fewer than two. By the device's clock, which is not delayed,
        except where it jumped: the first fix changes its epoch.
        """
        times = self._times.get(did, [])
        if len(times) < 2:
            return None
        device, arrival = np.diff(np.asarray(times, np.int64), axis=0).T
        steady = (device > 0) & (device < LONGEST_NS)
        return float(np.median(device[steady] if steady.any() else arrival)) / 1e6

    def count(self, did: int) -> int:
        """Number of packets of a data set."""
        return len(self._times.get(did, ()))

    def forget(self, did: int) -> None:
        """Discard the observations of a data set."""
        self._times.pop(did, None)

    def streaming(self) -> list[int]:
        """Data sets that arrived more than once."""
        return [did for did, times in self._times.items() if len(times) > 1]


def sources_of(params: Values, flash: Values) -> dict[str, float]:
    """Period of each source, ms: as reported by the device, else as documented."""
    device_periods = {
        NAV: params.get("navOutputPeriodMs"),
        IMU: params.get("imuSamplePeriodMs"),
        GNSS: flash.get("startupGPSDtMs"),
    }
    return {pace: float(device_periods.get(pace) or usual) for pace, usual in DEFAULT_MS.items()}


def streams(
    request: Requester,
    times: ListeningTimes,
    *,
    also: Iterable[int] = (),
    periods: Mapping[int, int] = NOTHING,
    gpx: bool = False,
) -> Transaction[Values]:
    """The value of the setting `streams`.

    Args:
        request: reads a data set.
        times: how long to listen.
        also: data sets without a bit to listen for, too.
        periods: multiples just requested from the device: the source's period is then measured.
        gpx: it is a GPX, whose streams are in DID_GPX_RMC.
    """
    rmc = yield from request(GPX_RMC if gpx else RMC)
    listed = dids_of(rmc.get("bits", 0), gpx=gpx)
    if gpx:
        sources = sources_of({}, (yield from _maybe(request, GPX_FLASH)))
    else:
        params = yield from _maybe(request, SYS_PARAMS)
        flash = yield from _maybe(request, FLASH)
        sources = sources_of(params, flash or (yield from _maybe(request, GPX_FLASH)))
    observed = ObservedStreams({did for did in {*listed, *also} if STREAMS[did].pace != EVENT})
    yield WaitFor(observed.only, times.least_s, "streams")  # also finds sets without a bit
    if not observed.enough:
        yield WaitFor(observed.observe, times.listen_s - times.least_s, "streams")
    rows = [
        _stream(did, observed, sources, periods.get(did)) for did in dict.fromkeys((*listed, *observed.streaming()))
    ]
    order = {did: place for place, did in enumerate(STREAMS)}
    return {"streams": sorted(rows, key=lambda row: order[row["did"]]), "options": rmc.get("options", 0) & ~PERSISTENT}


def _maybe(request: Requester, did: int) -> Transaction[Values]:
    """Read a data set; nothing if the device lacks it."""
    try:
        return (yield from request(did))
    except DeviceRejectedError:
        return {}


def _stream(did: int, observed: ObservedStreams, sources: Mapping[str, float], known: int | None) -> dict[str, Any]:
    row = STREAMS[did]
    interval, size = observed.interval_ms(did), observed.sizes.get(did, 0)
    bases = [sources[pace] for pace in row.paces]
    if interval is None or row.pace == EVENT:
        period, base = 1, bases[0]
    elif known:
        period = known
        base = next(
            (base for base in bases if abs(base * known - interval) <= MULTIPLE_TOLERANCE * interval),
            interval / known,
        )
    else:
        period, base = multiple(interval, bases)
    return {"did": did, "period": period, "size": size, "source_ms": base}


def multiple(interval_ms: float, bases: Sequence[float]) -> tuple[int, float]:
    """Source whose period divides an interval, and the factor; otherwise the interval itself once, or nearly a multiple
    of the last.
    """
    for base in bases:
        period = max(1, round(interval_ms / base))
        if abs(interval_ms - period * base) <= MULTIPLE_TOLERANCE * interval_ms:
            return period, base
    period = max(1, round(interval_ms / bases[-1]))
    return period, interval_ms / period
