"""The other end of viewer_process.py: what a viewer's process knows of devices and channels, and its samples.

Standard output carries our words only: whatever a library prints there goes to standard error, before it can.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import IO, Any

from server.integrations.viewer_process import HEAD, SAMPLES, TEXT
from server.wire_codec import SampleFrame, WireError, decode_samples


class ViewerClient:
    """What has been told so far, and what is told next.

    Attributes:
        devices: as `devices` of server/wire.py has them, in order.
        channels: all channels, by id.
        changed: devices or channels are others than when this was last set to False.
        heard_events: called with what happened, as `events` of server/wire.py has it.
    """

    def __init__(self, source: IO[bytes] | None = None, out: IO[str] | None = None) -> None:
        self._in = source or open(0, "rb", buffering=0, closefd=False)  # noqa: SIM115 - unbuffered, see `messages`
        self._out = out or _own_output()
        self._lock = threading.Lock()
        self.devices: list[Mapping[str, Any]] = []
        self.channels: dict[int, Mapping[str, Any]] = {}
        self._dtypes: dict[int, Sequence[str]] = {}
        self.changed = False
        self.heard_events: Callable[[list[Mapping[str, Any]]], None] = lambda events: None
        with contextlib.suppress(OSError):
            os.nice(5)  # live devices come first

    def say(self, **words: Any) -> None:
        """To our side of the view. From any thread."""
        with self._lock, contextlib.suppress(BrokenPipeError):
            print(json.dumps(words), file=self._out, flush=True)

    def subscribe(self, channels: Sequence[int], past: Sequence[int] = (), history: float = 0.0) -> None:
        """Have the samples of these channels from now on; replaces the last one."""
        self.say(op="subscribe", channels=list(channels), past=list(past), history=history)

    def messages(self) -> Iterator[list[SampleFrame] | Mapping[str, Any]]:
        """Samples as they come, and what our side of the view says; ends with the server."""
        for message in self.messages_until(lambda: None):
            assert message is not None
            yield message

    def messages_until(self, due: Callable[[], float | None]) -> Iterator[list[SampleFrame] | Mapping[str, Any] | None]:
        """The same, and None when it is time for something else.

        Args:
            due: when that is, monotonic, s; None: whenever a message has come. Asked before each wait.
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
                with contextlib.suppress(WireError):  # of a channel whose device has just gone
                    yield decode_samples(body, self._dtypes)
            elif sort == TEXT:
                self._hear(json.loads(body))
                if self.changed:
                    yield []
            else:
                yield json.loads(body)

    def _exactly(self, size: int) -> bytes:
        """So many bytes; fewer where the input ends. (A file that buffers would hide from `select` what it has.)"""
        out = self._in.read(size)
        while len(out) < size and (more := self._in.read(size - len(out))):
            out += more
        return out

    def _hear(self, message: Mapping[str, Any]) -> None:
        if message["op"] == "devices":
            if [_known(one) for one in message["devices"]] != [_known(one) for one in self.devices]:
                self.changed = True
            self.devices = message["devices"]
            there = {one["id"] for one in self.devices}
            for number in [id for id, info in self.channels.items() if info["device"] not in there]:
                del self.channels[number]
        elif message["op"] == "channels":
            for info in message["channels"]:
                self.channels[info["id"]] = info
                self._dtypes[info["id"]] = [column["dtype"] for column in info["columns"]]
                self.changed = True
        elif message["op"] == "events":
            self.heard_events(message["events"])


def _known(device: Mapping[str, Any]) -> tuple[str, str]:
    return device["id"], device["name"]


def _own_output() -> IO[str]:
    out = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    return out
