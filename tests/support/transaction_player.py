"""Play a transaction against a simulator on a virtual clock: no link, no thread, no sleeping.

    play(driver.read("LocationID", known), PlayedWire(XbusDevice(), "xbus"))

The device is any simulator (`advance`, `receive`, `baud`); `PlayedWire` decodes what it sends and hears it only at its
own rate.
"""

from __future__ import annotations

from collections import deque
from typing import Any, Protocol

from imuscope.protocols.commands.transactions import (
    Act,
    Note,
    PutBack,
    ReopenLink,
    Send,
    Sleep,
    T,
    Transaction,
    WaitFor,
)
from imuscope.protocols.events import Decoder, Event
from imuscope.protocols.registry.families import PROTOCOLS

STEP_NS = 1_000_000  # how finely time passes while something is awaited


class Simulator(Protocol):
    @property
    def baud(self) -> int: ...

    def advance(self, now_ns: int) -> bytes: ...

    def receive(self, data: bytes, now_ns: int) -> bytes: ...


class PlayedWire:
    """A simulator at the other end of a faultless line.

    Args:
        baud: of the host's end; None follows the device.
        step_ns: time step.

    Attributes:
        sent: every Send that was written, in order.
        notes: every Note, in order.
        now_ns: the time.
    """

    def __init__(
        self, device: Simulator, protocol: str, baud: int | None = None, start_ns: int = 0, step_ns: int = STEP_NS
    ) -> None:
        self.device = device
        self.protocol = protocol
        self.baud = baud
        self.now_ns = start_ns
        self.sent: list[Send] = []
        self.notes: list[str] = []
        self.put_back: list[tuple[bytes, ...]] = []
        self._step_ns = step_ns
        self._decoder = self._fresh()
        self._events: deque[Event] = deque()
        self._requesting = False

    def _fresh(self) -> Decoder:
        return PROTOCOLS[self.protocol].decoding.decoder()

    @property
    def received(self) -> bool:
        """Do host and device speak at one rate?"""
        return self.baud is None or self.baud == self.device.baud

    def take(self, data: bytes) -> None:
        """Bytes from the device."""
        if data and self.received:
            self._decoder.feed(data, self.now_ns)
            self._events.extend(self._decoder.drain())

    def write(self, send: Send) -> None:
        self.sent.append(send)
        received = self.received  # before: a device that resets answers at its old rate
        data = self.device.receive(send.frame if received else b"", self.now_ns)
        if data and received:
            self._decoder.feed(data, self.now_ns)
            self._events.extend(self._decoder.drain())

    def pass_time(self, seconds: float) -> None:
        self.now_ns += round(seconds * 1e9)
        self.take(self.device.advance(self.now_ns))

    def expect(self, act: WaitFor) -> Any | None:
        end_ns = self.now_ns + round(act.timeout_s * 1e9)
        while True:
            while self._events:
                hit = act.match(self._events.popleft())
                if hit is not None:
                    return hit
            if self.now_ns >= end_ns:
                return None
            self.pass_time(min(self._step_ns, end_ns - self.now_ns) / 1e9)

    def relink(self, baud: int | None) -> None:
        self.baud = baud if baud is not None else self.baud
        self._decoder = self._fresh()
        self._events.clear()

    def do(self, act: Act) -> Any:
        """Perform one act; returns the value to send into the transaction. A Send after a wait discards unawaited
        events.
        """
        request, self._requesting = self._requesting, isinstance(act, Send)
        if isinstance(act, Send):
            if not request:
                self._events.clear()
            return self.write(act)
        if isinstance(act, WaitFor):
            return self.expect(act)
        if isinstance(act, Sleep):
            return self.pass_time(act.seconds)
        if isinstance(act, Note):
            return self.notes.append(act.words)
        if isinstance(act, PutBack):
            return self.put_back.append(act.frames)
        assert isinstance(act, ReopenLink)
        self.relink(act.baud)
        return True


def play(dialogue: Transaction[T], wire: PlayedWire) -> T:
    """Run a dialogue to its end; what it returns, or raises."""
    try:
        act = next(dialogue)
        while True:
            act = dialogue.send(wire.do(act))
    except StopIteration as end:
        result: T = end.value
        return result
