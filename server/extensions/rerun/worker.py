"""`python -m imuscope.server.extensions.rerun.worker`: live samples as batches for Rerun viewers, in a subprocess.

It receives the messages of a browser (server/integrations/viewer_client.py). Samples of 50 ms become one chunk of each
quantity: a chunk has some 3 kB of overhead, and a viewer handles few large ones far better than many small ones, so
there are 20 batches a second, regardless of the rates of the devices. Messages on standard output:

    {"op": "batch", "still": bool, "restart": bool, "past": bool, "newest": unix s, "data": base64 of an .rrd}

`still`: static data and the layout; `restart`: earlier static data is void, because devices were added or removed.
`past`: earlier samples, from the server's history; `newest`: arrival of the newest sample. With the address of a remote
viewer, all data is sent there instead, at the rate it accepts; the messages are then those of service.py.
"""

import base64
import os
import time
import traceback
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import rerun as rr

from imuscope.protocols.arrays import Array
from imuscope.recordings.exporters.entities import DeviceEntity, devices_of
from imuscope.recordings.exporters.enu import Origin, is_place
from imuscope.server.extensions.rerun.rrd import chunks, static
from imuscope.server.extensions.rerun.rrd.blueprint import blueprint
from imuscope.server.extensions.rerun.rrd.chunks import Times, moments
from imuscope.server.integrations.viewer_client import ViewerClient
from imuscope.server.wire.codec import SampleFrame

PERIOD_S = 0.05
PAUSE_S = 0.5  # minimum time between two layouts
HISTORY_S = 30.0
SHOWN_S = 30.0  # of plots
TRACK_S, TRACK_POINTS = 1.0, 3600  # an hour
FLUSH_TIMEOUT_S = 0.5  # longest wait for a remote viewer to accept the sent data
STEADY_S = 5.0  # a remote viewer that has accepted everything for so long counts as reached
MAX_BATCH_BYTES = 700_000  # maximum of one batch: lines of standard output are limited


class RerunBatcher:
    """A stream and its state."""

    def __init__(self, client: ViewerClient, request: Mapping[str, Any]) -> None:
        self._client = client
        self._device = str(request["device"])
        self._remote = str(request["connect"])
        self._stuck_s = float(request.get("stuck_s", 0))
        self._stream = rr.RecordingStream("imuscope live")
        self._bytes = None if self._remote else rr.binary_stream(self._stream)
        self._devices: dict[str, DeviceEntity] = {}
        self._infos: dict[int, Mapping[str, Any]] = {}
        self._styled: set[int] = set()
        self._words: dict[tuple[int, int], int] = {}
        self._origin: Origin | None = None
        self._heights: dict[int, float] = {}
        self._paths: dict[str, deque[tuple[Array, Array]]] = {}
        self._drawn: dict[str, float] = {}
        self._live: dict[int, list[SampleFrame]] = {}
        self._past: list[SampleFrame] = []
        self._next = 0.0
        self._laid_out = 0.0
        self._accepted_since = self._refused_since = 0.0  # since when a remote viewer accepts everything, or nothing
        self._is_reached = False

    def lay_out(self) -> None:
        """Send static data and layout again after a change of devices or channels. Waits for the first channel, and
        combines the many channels that a device advertises within its first second.
        """
        if not self._client.channels:
            return
        time.sleep(max(0.0, self._laid_out + PAUSE_S - time.monotonic()))
        self._laid_out = time.monotonic()
        self._client.changed = False
        newest = {}
        for info in self._client.channels.values():
            if not self._device or info["device"] == self._device:
                newest[info["device"], info["message"], info["name"]] = info  # replaces an earlier one of that name
        self._infos = {int(info["id"]): info for info in newest.values()}
        named = [one for one in self._client.announced if not self._device or one["id"] == self._device]
        self._devices = {device.id: device for device in devices_of(named, list(self._infos.values()))}
        self._paths = {device_id: path for device_id, path in self._paths.items() if device_id in self._devices}
        self._words = {place: word for place, word in self._words.items() if place[0] in self._infos}
        devices = list(self._devices.values())
        logs = [
            f"{chunks.name_of((*curve.path, 'changes'))}"
            for device in devices
            for number, curves in device.curves.items()
            if self._infos[number]["kind"] == "status"
            for curve in curves
        ]
        layout = blueprint(devices, list(self._infos.values()), logs, live_s=SHOWN_S)
        if self._remote and not self._styled:
            self._stream.connect_grpc(self._remote, default_blueprint=layout)
        self._stream.send_blueprint(layout)
        static.send_scene(self._stream, devices)
        for device in devices:
            for number, curves in device.curves.items():
                for curve in curves:
                    static.send_style(
                        self._stream, curve, self._infos[number]["columns"], str(self._infos[number].get("frame") or "")
                    )
        first = self._styled == set()
        self._styled = set(self._infos)
        self._report(is_still=True, restart=not first)
        self._client.subscribe(list(self._infos), past=list(self._infos), history=HISTORY_S if first else 0.0)

    def add(self, samples: Sequence[SampleFrame]) -> None:
        """Add samples: live ones are collected until a batch is due, history is sent at once, newest first."""
        for one in samples:
            if one.channel in self._infos and one.n:
                if one.history:
                    self._past.append(one)
                else:
                    self._live.setdefault(one.channel, []).append(one)
        now = time.monotonic()
        if self._past:
            past, self._past = self._past, []
            if not self._is_accepted():
                return
            for one in past:
                self._send(one.channel, [one], live=False)
            self._report(newest=max(float(one.columns[0][-1]) for one in past), past=True)
        if now >= self._next and self._live:
            self._next = now + PERIOD_S
            live, self._live = self._live, {}
            if not self._is_accepted():
                return
            newest = max(float(one.columns[0][-1]) for parts in live.values() for one in parts)
            for number, parts in live.items():
                self._send(number, parts)
            self._report(newest=newest)

    def _is_accepted(self) -> bool:
        """Whether a remote viewer has accepted the sent data. More would only fill memory, since the SDK stores it all.

        Ends the process if nothing was accepted for a while: the SDK does not reconnect; a new process does.
        """
        if not self._remote:
            return True
        is_accepted = True
        try:
            self._stream.flush(timeout_sec=FLUSH_TIMEOUT_S)
        except RuntimeError:
            is_accepted = False
        now = time.monotonic()
        if not is_accepted:
            self._accepted_since, self._refused_since = 0.0, self._refused_since or now
            if now - self._refused_since > self._stuck_s:
                self._client.send(op="stuck")
                os._exit(1)
            return False
        self._refused_since, self._accepted_since = 0.0, self._accepted_since or now
        if not self._is_reached and now - self._accepted_since >= STEADY_S:
            self._is_reached = True
            self._client.send(op="reached")
        return True

    def _send(self, number: int, parts: Sequence[SampleFrame], *, live: bool = True) -> None:
        info = self._infos[number]
        device = self._devices[info["device"]]
        columns = [np.concatenate(column) for column in zip(*(one.columns for one in parts), strict=True)]
        arrival, time_, own = columns[0], columns[1], columns[2:]
        sample = np.concatenate([np.arange(one.sequence, one.sequence + one.n) for one in parts])
        times = Times(moments(np.where(np.isnan(time_), arrival, time_)), moments(arrival), sample)
        put = chunks.send_table if info["kind"] == "table" else chunks.send_curve
        for curve in device.curves[number]:
            put(self._stream, curve, times, own)
            if live and info["kind"] == "status":
                self._send_changes(number, curve.path, curve.columns, times, own)
        if device.attitude is not None and device.attitude.channel == number:
            chunks.send_attitude(self._stream, device.attitude, times, own)
        if device.position is not None:
            if device.position.height == number:
                self._heights[number] = float(own[0][-1])
            if device.position.channel == number:
                self._place(device, times, own, live)

    def _send_changes(
        self, number: int, path: tuple[str, ...], which: Sequence[int], times: Times, own: Sequence[Array]
    ) -> None:
        for i in which:
            column = self._infos[number]["columns"][i]
            if column["bits"]:
                at, texts, levels = chunks.changes(column, self._words.get((number, i)), own[i])
                self._words[number, i] = int(own[i][-1])
                chunks.send_texts(self._stream, (*path, "changes"), times.only(at), texts, levels)

    def _place(self, device: DeviceEntity, times: Times, own: Sequence[Array], live: bool) -> None:
        position = device.position
        assert position is not None
        lat, lon, high = position.columns
        height = self._heights.get(position.height, 0.0)
        if position.kind == "place" and self._origin is None:
            good = np.flatnonzero(is_place(own[lat], own[lon]))
            if not len(good):
                return
            i = int(good[0])
            up = float(own[high][i]) if high >= 0 else height
            self._origin = Origin(float(own[lat][i]), float(own[lon][i]), up if np.isfinite(up) else 0.0)
        enu = chunks.metres(position, own, np.full(len(times), height), self._origin)
        latlon = chunks.degrees(position, own)
        chunks.send_positions(self._stream, position.path, times, enu)
        chunks.send_places(self._stream, position.on_map, times, latlon)
        if live:
            self._draw(device, enu[-1], latlon[-1])

    def _draw(self, device: DeviceEntity, enu: Array, latlon: Array) -> None:
        """Extend the track since the start of this stream, and send it every second."""
        path = self._paths.setdefault(device.id, deque(maxlen=TRACK_POINTS))
        now = time.monotonic()
        if now >= self._drawn.get(device.id, 0.0):
            self._drawn[device.id] = now + TRACK_S
            path.append((enu, latlon))
            static.send_track(self._stream, device, *(np.array(part) for part in zip(*path, strict=True)))

    def _report(
        self, *, is_still: bool = False, restart: bool = False, past: bool = False, newest: float = 0.0
    ) -> None:
        if self._bytes is None:
            return
        data = self._bytes.read()
        if data:
            if len(data) > MAX_BATCH_BYTES:
                self._client.send(op="left-out", bytes=len(data))
                return
            text = base64.b64encode(data).decode()
            self._client.send(op="batch", still=is_still, restart=restart, past=past, newest=newest, data=text)


def main() -> None:
    """Feed until the server ends."""
    client = ViewerClient()
    feed: RerunBatcher | None = None
    try:
        for message in client.messages():
            if isinstance(message, Mapping):
                if message["op"] == "open":
                    feed = RerunBatcher(client, message)
            elif feed is not None:
                if client.changed:
                    feed.lay_out()
                feed.add(message)
    except BaseException:
        traceback.print_exc()
        os._exit(1)
    os._exit(0)  # closing the stream would wait for ever for a stalled viewer


if __name__ == "__main__":
    main()
