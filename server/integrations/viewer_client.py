"""The subprocess side of viewer_process.py: devices, channels and samples in a viewer's process.

Standard output is reserved for our messages: output of libraries is redirected to standard error.
"""

import contextlib
import json
import os
import select
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import IO, Any

from imuscope.recordings.system.priority import lower_priority
from imuscope.server.integrations.viewer_process import HEAD, SAMPLES, TEXT
from imuscope.server.wire import lasting_name
from imuscope.server.wire.codec import SampleFrame, WireError, decode_samples

NAME_S = 3.0  # for a device to be identified


class ViewerClient:
    """Devices and channels in a viewer's process, and its subscriptions.

    Attributes:
        devices: as `devices` of server/wire/ has them, in order.
        announced: the same, each under the name that its topics and frames have for as long as it is there: the one by
            which it was known NAME_S after it came, or sooner. One that is learnt later renames nothing for others.
        channels: all channels, by id.
        health: latest figures of each device, as in `health` of server/wire/.
        changed: devices or channels have changed since this was last set to False.
        on_events: called with events, as in `events` of server/wire/.
    """

    def __init__(self, source: IO[bytes] | None = None, out: IO[str] | None = None, *, nice: int = 5) -> None:
        self._in = source or open(0, "rb", buffering=0, closefd=False)  # noqa: SIM115 - unbuffered, see `messages`
        self._out = out or _own_output()
        self._lock = threading.Lock()
        self.devices: list[Mapping[str, Any]] = []
        self.announced: list[Mapping[str, Any]] = []
        self._names: dict[str, tuple[str, float]] = {}  # by id, with the time until which it may change, monotonic, s
        self.channels: dict[int, Mapping[str, Any]] = {}
        self.health: dict[str, Mapping[str, Any]] = {}
        self._dtypes: dict[int, Sequence[str]] = {}
        self.changed = False
        self.on_events: Callable[[list[Mapping[str, Any]]], None] = lambda events: None
        lower_priority(nice)  # live devices come first

    def send(self, **words: Any) -> None:
        """Send a message to the server's side. Thread-safe."""
        with self._lock, contextlib.suppress(BrokenPipeError):
            print(json.dumps(words), file=self._out, flush=True)

    def subscribe(self, channels: Sequence[int], past: Sequence[int] = (), history: float = 0.0) -> None:
        """Subscribe to the samples of these channels from now on; replaces the last subscription."""
        self.send(op="subscribe", channels=list(channels), past=list(past), history=history)

    def messages(self) -> Iterator[list[SampleFrame] | Mapping[str, Any]]:
        """Received samples, and messages of the server's side of the view; ends with the server."""
        for message in self.messages_until(lambda: None):
            assert message is not None
            yield message

    def messages_until(self, due: Callable[[], float | None]) -> Iterator[list[SampleFrame] | Mapping[str, Any] | None]:
        """Like `messages`, and None whenever a given time is reached.

        Args:
            due: returns that time, monotonic, s; None: no such time. Called before each wait.
        """
        while True:
            at = due()
            if at is not None and not select.select([self._in], [], [], max(0.0, at - time.monotonic()))[0]:
                yield None
                continue
            head = self._exactly(HEAD.size)
            if len(head) < HEAD.size:
                return
            size, sort = HEAD.unpack(head)
            body = self._exactly(size)
            if len(body) < size:
                return
            if sort == SAMPLES:
                with contextlib.suppress(WireError):  # samples of a channel whose device was just removed
                    yield decode_samples(body, self._dtypes)
            elif sort == TEXT:
                self._on_message(json.loads(body))
                if self.changed:
                    yield []
            else:
                yield json.loads(body)

    def _exactly(self, size: int) -> bytes:
        """Read exactly so many bytes, or fewer at the end of the input. The file is unbuffered, because `select` does
        not see buffered bytes.
        """
        out = self._in.read(size)
        while len(out) < size and (more := self._in.read(size - len(out))):
            out += more
        return out

    def _on_message(self, message: Mapping[str, Any]) -> None:
        if message["op"] == "devices":
            if [_known(one) for one in message["devices"]] != [_known(one) for one in self.devices]:
                self.changed = True
            self.devices = message["devices"]
            self._names = {one["id"]: self._name_of(one, time.monotonic()) for one in self.devices}
            self.announced = [{**one, "name": self._names[one["id"]][0]} for one in self.devices]
            there = {one["id"] for one in self.devices}
            for number in [number for number, info in self.channels.items() if info["device"] not in there]:
                del self.channels[number]
        elif message["op"] == "channels":
            for info in message["channels"]:
                self.channels[info["id"]] = info
                self._dtypes[info["id"]] = [column["dtype"] for column in info["columns"]]
                self.changed = True
            # not when a device goes: its last samples are on their way, with those of others
            self._dtypes = {number: self._dtypes[number] for number in self.channels}
        elif message["op"] == "health":
            self.health = {one["device"]: one for one in message["devices"]}
        elif message["op"] == "events":
            self.on_events(message["events"])

    def _name_of(self, device: Mapping[str, Any], now: float) -> tuple[str, float]:
        before, until = self._names.get(device["id"], ("", now + NAME_S))
        if before and now >= until:
            return before, until
        product, former = str(device.get("product", "")), str(device.get("former_name", ""))
        return lasting_name(str(device["name"]), product, former), now if product or former else until


def _known(device: Mapping[str, Any]) -> tuple[str, str]:
    return device["id"], device["name"]


def _own_output() -> IO[str]:
    out = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    return out
