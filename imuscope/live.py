"""A running server, live: `imuscope.connect`.

One connection, one thread: the caller's. Samples come from the WebSocket that the page uses (docs/websocket.md), so
several programs and pages can watch at once, and a slow one loses samples (counted: `Batch.dropped`) instead of slowing
the others down.
"""

import json
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit, urlunsplit

import numpy as np
from numpy.typing import NDArray

from imuscope.protocols.schema.units import Unit
from imuscope.recordings.columns.units import UNITS, Units, described_in, scaled
from imuscope.signals import Device, ImuscopeError, checked, choice, column_names, frame_of

if TYPE_CHECKING:
    from websockets.sync.client import ClientConnection

SUBPROTOCOL = "imuscope.v1"
PORT = 8080
CONNECT_S = 10.0


@dataclass(frozen=True, slots=True)
class LiveSignal:
    """A quantity that a device sends; the fields are those of `imuscope.Signal`."""

    device: Device
    name: str
    title: str
    message: str
    columns: tuple[str, ...]
    units: tuple[str, ...]
    frame: str
    kind: str
    doc: str
    channel: int
    dtypes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Batch:
    """Samples that arrived together.

    Args:
        time, arrival: (n,) unix s, as of `imuscope.Signal`.
        values: (n,) or (n, columns).
        dropped: samples that were lost just before these, because this program was too slow.
    """

    signal: LiveSignal
    time: NDArray[np.float64]
    arrival: NDArray[np.float64]
    values: NDArray[Any]
    dropped: int

    def __len__(self) -> int:
        return len(self.time)


class Server:
    """A connection to a server; use it in `with`.

    Attributes:
        version: of the server.
    """

    def __init__(self, connection: "ClientConnection", units: Units) -> None:
        self._connection = connection
        self._units = units
        self._shapes: dict[int, tuple[list[str], Sequence[float]]] = {}  # of each channel dtypes as sent, and factors
        self._devices: dict[str, Device] = {}
        self._signals: dict[int, LiveSignal] = {}
        self._waiting: list[bytes] = []
        self._taken: dict[int, tuple[int, int]] = {}  # of each channel the numbers of the samples that were given
        self.version = ""
        while not (self.version and self._devices_known):
            self._receive(CONNECT_S)

    _devices_known = False

    def __enter__(self) -> "Server":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def devices(self) -> tuple[Device, ...]:
        """The devices, as they are known now."""
        return tuple(self._devices.values())

    @property
    def signals(self) -> tuple[LiveSignal, ...]:
        """What they send, as far as it has been described."""
        return tuple(self._signals.values())

    @checked
    def stream(self, *names: str, history_s: float = 0.0, timeout_s: float | None = None) -> Iterator[Batch]:
        """Samples as they arrive, until the connection ends or the caller stops.

        Args:
            names: names or titles of signals, "DEVICE/NAME" for those of one device; none for all. Signals that are
                described later are included.
            history_s: begin with what the server has kept of the last seconds; the newest of it comes first.
            timeout_s: longest time without a sample of these.

        Raises:
            ImuscopeError: nothing arrived for `timeout_s`, or the connection was lost.
        """
        if wrong := [one for one in names if not isinstance(one, str)]:
            raise ImuscopeError(f"{wrong[0]!r} is no name of a signal; give names one after the other.")
        return self._stream(names, float(history_s), None if timeout_s is None else float(timeout_s))

    def _stream(self, names: tuple[str, ...], history_s: float, timeout_s: float | None) -> Iterator[Batch]:
        self._waiting.clear()  # samples of an earlier stream
        self._taken = {}
        sent = "shown" if self._units == "shown" else "device"
        self._send({"op": "subscribe", "channels": None, "history": history_s, "units": sent})
        newest = time.monotonic()
        while True:
            while not self._waiting:
                self._receive(timeout_s, names)
            for batch in self._batches(self._waiting.pop(0), names):
                yield batch
                newest = time.monotonic()
            if timeout_s is not None and time.monotonic() - newest > timeout_s:
                raise self._silence(timeout_s, names)

    def close(self) -> None:
        """End the connection."""
        self._connection.close()

    def _send(self, message: Mapping[str, Any]) -> None:
        from websockets.exceptions import ConnectionClosed

        try:
            self._connection.send(json.dumps(message))
        except ConnectionClosed:
            raise ImuscopeError("The connection is closed: connect again.") from None

    def _silence(self, timeout_s: float | None, names: Sequence[str]) -> ImuscopeError:
        """The error for samples that do not come, which lists those that would."""
        listed = ", ".join(dict.fromkeys(one.title for one in self.signals)) if names else ""
        chosen = f" of {', '.join(map(repr, names))}" if names else ""
        sends = f"; the server sends: {listed}" if listed else ""
        return ImuscopeError(f"Nothing{chosen} arrived for {timeout_s:g} s{sends}.")

    def _receive(self, timeout_s: float | None, names: Sequence[str] = ()) -> None:
        from websockets.exceptions import ConnectionClosed

        try:
            message = self._connection.recv(timeout_s)
        except TimeoutError:
            raise self._silence(timeout_s, names) from None
        except ConnectionClosed as error:
            raise ImuscopeError(f"The connection has ended: {error}.") from None
        if isinstance(message, bytes):
            self._waiting.append(message)
            return
        body = json.loads(message)
        if body["op"] == "hello":
            self.version = body["version"]
        elif body["op"] == "devices":
            fields = ("id", "name", "protocol", "product", "serial_number", "firmware")
            self._devices = {one["id"]: Device(**{name: one[name] for name in fields}) for one in body["devices"]}
            self._devices_known = True
        elif body["op"] == "channels":
            for info in body["channels"]:
                self._signals[info["id"]] = self._signal(info)
        elif body["op"] == "error":
            raise ImuscopeError(f"{body['message']} {body.get('hint', '')}".strip())

    def _signal(self, info: Mapping[str, Any]) -> LiveSignal:
        device = self._devices.get(info["device"]) or Device(info["device"], info["device"], "", "", "", "")
        dtypes: list[str] = [one["dtype"] for one in info["columns"]]
        factors: Sequence[float] = ()
        if self._units != "shown":
            if not all("sent_unit" in one for one in info["columns"]):
                raise ImuscopeError(f"That server, imuscope {self.version}, sends the units of its page only.")
            pairs = [(Unit.parse(one["sent_unit"] or one["unit"]), Unit.parse(one["unit"])) for one in info["columns"]]
            info, factors = described_in(info, [sent.to(shown) for sent, shown in pairs], self._units)
        self._shapes[info["id"]] = dtypes, factors
        columns = info["columns"]
        return LiveSignal(
            device=device,
            name=info["name"],
            title=info["title"],
            message=info["message"],
            columns=column_names(info),
            units=tuple(one["unit"] for one in columns),
            frame=frame_of(info),
            kind=info["kind"],
            doc=info["doc"],
            channel=info["id"],
            dtypes=tuple(one["dtype"] for one in columns),
        )

    def _batches(self, data: bytes, names: tuple[str, ...]) -> Iterator[Batch]:
        from imuscope.server.wire.codec import decode_samples

        for frame in decode_samples(data, {number: dtypes for number, (dtypes, _) in self._shapes.items()}):
            signal = self._signals[frame.channel]
            own = (signal.name, signal.title)
            device = self._devices.get(signal.device.id, signal.device)
            full = {f"{at}/{name}" for at in (device.name, device.id) for name in own}
            if names and not full.union(own).intersection(names):
                continue
            first, end = self._taken.get(frame.channel, (frame.sequence, frame.sequence))
            numbers = frame.sequence + np.arange(frame.n)
            fresh = (numbers < first) | (numbers >= end)  # history and what has arrived since may overlap
            self._taken[frame.channel] = min(first, frame.sequence), max(end, frame.sequence + frame.n)
            if not fresh.any():
                continue
            arrival, time, *columns = frame.columns if fresh.all() else [column[fresh] for column in frame.columns]
            if factors := self._shapes[frame.channel][1]:
                both = zip(columns, factors, strict=True)
                columns = [one if by == 1 else scaled(one.astype(np.float64), by) for one, by in both]
            values = columns[0] if len(columns) == 1 else np.column_stack(columns)
            yield Batch(signal, np.where(np.isnan(time), arrival, time), arrival, values, frame.dropped)


@checked
def connect(address: str, *, token: str = "", units: Units = "shown") -> Server:
    """Connect to a running server.

    Args:
        address: that of its page, "http://robot.local:8080"; "tcp://robot.local:8080" and "robot.local" are the same.
        token: as in the address that a server beyond this machine prints; may be in `address` (…/?token=…).
        units: of the samples, as of `Signal.in_units`: "shown", "SI", or "device" bit by bit.

    Raises:
        ImuscopeError: nothing answers, or the token is refused.
    """
    choice("units", units, UNITS)
    from websockets.exceptions import InvalidHandshake, InvalidURI
    from websockets.sync.client import connect as connect_websocket

    url = _websocket_address(address, token)
    try:
        connection = connect_websocket(url, subprotocols=[_subprotocol()], open_timeout=CONNECT_S, max_size=None)
        return Server(connection, units)
    except (OSError, TimeoutError) as error:
        raise ImuscopeError(f"No server answers at {address}: {error}.") from None
    except (InvalidHandshake, InvalidURI) as error:
        hint = " Give its token: connect(…, token=…)." if "401" in str(error) or "403" in str(error) else ""
        raise ImuscopeError(f"{address} is not a server of imuscope, or refuses: {error}.{hint}") from None


def _subprotocol() -> Any:
    from websockets.typing import Subprotocol

    return Subprotocol(SUBPROTOCOL)


def _websocket_address(address: str, token: str) -> str:
    if not isinstance(address, str):
        raise ImuscopeError(f"{address!r} is not the address of a server; it looks like http://robot.local:8080.")
    parts = urlsplit(address if "://" in address else f"http://{address}")
    if parts.scheme not in ("http", "https", "tcp") or not parts.hostname:
        raise ImuscopeError(f"{address!r} is not the address of a server; it looks like http://robot.local:8080.")
    place = parts.netloc if parts.port else f"{parts.netloc}:{443 if parts.scheme == 'https' else PORT}"
    query = parts.query if not token else f"token={token}"
    return urlunsplit(("wss" if parts.scheme == "https" else "ws", place, f"{parts.path.rstrip('/')}/ws", query, ""))
