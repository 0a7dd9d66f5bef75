"""The other end of the wire: an MTi that is not there, but answers.

    power, Reset ──> wake-up ──500 ms, no WakeUpAck──> measurement ──GoToConfig──> config
                        └───────── WakeUpAck ────────────────────────────────────────^ │
                     Configuration before measurement        <────GoToMeasurement──────┘

`XbusDevice` is pure: it has no clock, no link and no thread. Whoever holds it says how late it is and takes what the
device has sent by then; what it is told, it answers as section 5 of the document says, from a configuration that it
keeps. Settings are stored at once; a new baud rate acts after Reset. What is wrong is answered with Error: 4 for a
message that is unknown, of a wrong size, or not valid in this state, 33 for a parameter, 32 for a baud rate, 3 for a
period.

What it measures is quantities.py, from the shared drive. What it does not do: alignment matrices, filter profiles and
orientation resets are kept and answered but do not turn the output; it sends no eMTS (0x91), whose content is
encrypted; of the string outputs (SetStringOutputType) it keeps the setting and goes on with MTData2.

Rules for editing: a setting that is only kept and returned is a row in settings.py; one that does something is a
function in answers.py.

Source: MT0101P 2020.A, sections 4 and 5.
"""

from __future__ import annotations

import struct
from dataclasses import replace
from typing import Literal

import numpy as np

from protocols.xbus import frames
from protocols.xbus.answers import ACTIONS
from protocols.xbus.measurement import BLOCK_NS, Measurement, granted, source_of
from protocols.xbus.quantities import Run
from protocols.xbus.settings import (
    BAUD_RATES,
    BAUDRATE,
    ERROR_MESSAGE,
    ERROR_PARAMETER,
    PORT_CONFIG,
    PRODUCTS,
    SETTINGS,
    Product,
    RefusedError,
    factory_settings,
)

WAKE_UP_WINDOW_NS = 500_000_000
BOOT_NS = 300_000_000  # from Reset to WakeUp
STALL_NS = 200_000_000  # an incomplete request older than this is forgotten

Phase = Literal["boot", "wake-up", "config", "measurement"]


class XbusDevice:
    """A simulated MTi.

    Args:
        product: "MTi-630", "MTi-680G", "MTi-3", "MTi-30", "MTi-G-710"…: a key of `settings.PRODUCTS`.
        serial: device identifier; None for one of the product's own range, made of the seed.
        seed: repeats noise and faults exactly.
        start_ns: the time, on the clock that `advance` speaks, at which power comes.
        rate: samples/s of the default output configuration; above 400 the device is faster than any real one.
        drop, corrupt: share of MTData2 frames that never leave, or leave with one bit turned.
        clock_drift_ppm: how much faster the device's oscillator runs than the clock of `advance`.
        clock_jump: (device time s, by s): SampleTimeFine jumps once.
        road: how much of the vehicle's shaking reaches the sensor: 0 none, 1 a rigid mount.
        measuring: True to be powered long ago and already in the measurement state at `start_ns`.
    Raises:
        ValueError: the product is not known.
    """

    def __init__(
        self,
        product: str = "MTi-630",
        serial: int | None = None,
        seed: int = 0,
        start_ns: int = 0,
        *,
        rate: float = 100,
        drop: float = 0.0,
        corrupt: float = 0.0,
        clock_drift_ppm: float = 0.0,
        clock_jump: tuple[float, float] | None = None,
        road: float = 0.0,
        measuring: bool = False,
    ) -> None:
        if product not in PRODUCTS:
            raise ValueError(f"there is no twin of {product!r}; there are {', '.join(PRODUCTS)}")
        self.product: Product = PRODUCTS[product]
        self.serial = self.product.first_serial + seed % 0xFFFF + 1 if serial is None else serial
        self.phase: Phase = "boot"
        self._seed = seed
        self._start_ns = start_ns
        self._speed = 1 + clock_drift_ppm * 1e-6
        self._fastest = 400 if rate <= 400 else 2000
        self._rate = max(int(rate), 1)
        self._drop, self._corrupt = drop, corrupt
        jump = clock_jump and (round(clock_jump[0] * 1e9), round(clock_jump[1] * 1e4))
        self.run = Run(self.product.abilities, seed, self.product.wrap, jump, road)
        self.settings: dict[int, bytes] = {}
        self.output: tuple[tuple[int, int], ...] = ()
        self.restore()
        self.baud = BAUD_RATES[self.settings[BAUDRATE][0]]
        self._heard = bytearray()
        self._heard_ns = 0
        self._measurement: Measurement | None = None
        self._block = 0
        self._waiting: list[tuple[int, bytes]] = []  # messages of this block not sent yet, last first
        self._counter = self._block_counter = 0
        if measuring:
            self.measure(0)

    # -- the two directions of the wire

    def advance(self, now_ns: int) -> bytes:
        """Everything that the device sends up to `now_ns`, since it was last asked."""
        now = self._local(now_ns)
        out: list[bytes] = []
        if self.phase == "boot" and now >= 0:
            self.phase = "wake-up"
            out.append(frames.build(0x3E))
        if self.phase == "wake-up" and now >= WAKE_UP_WINDOW_NS:
            out.append(frames.build(0x0D, self.configuration()))
            self.measure(WAKE_UP_WINDOW_NS)
        if self.phase == "measurement":
            self._due(now, out)
        return b"".join(out)

    def receive(self, data: bytes, now_ns: int) -> bytes:
        """Bytes from the host. What the device had to send by then, followed by its answers."""
        out = [self.advance(now_ns)]
        now = self._local(now_ns)
        if self.phase == "boot":
            return b""  # nobody listens yet
        if now - self._heard_ns > STALL_NS:
            self._heard.clear()
        self._heard += data
        self._heard_ns = now
        while (request := self._next_request()) is not None:
            bid, mid, payload = request
            try:
                answer = self._answer(mid, payload, now)
            except RefusedError as refused:
                out.append(frames.build(0x42, bytes([refused.code]), bid))
            else:
                if answer is not None:
                    out.append(frames.build(mid + 1, answer, bid))
        return b"".join(out)

    def _local(self, now_ns: int) -> int:
        """Device time: ns of the device's own oscillator since it was switched on."""
        return int((now_ns - self._start_ns) * self._speed)

    def _next_request(self) -> tuple[int, int, bytes] | None:
        """The next whole frame that is meant for this device, as (bus identifier, message, payload)."""
        heard = self._heard
        while (at := heard.find(frames.PREAMBLE)) >= 0:
            del heard[:at]
            if len(heard) < 4:
                return None
            head = 4 if heard[3] != frames.EXTENDED else 6
            if len(heard) < head:
                return None
            size = heard[3] if head == 4 else heard[4] << 8 | heard[5]
            if size <= frames.MAX_SENT:
                if len(heard) < head + size + 1:
                    return None
                if sum(heard[1 : head + size + 1]) & 0xFF == 0:
                    frame = bytes(heard[: head + size + 1])
                    del heard[: len(frame)]
                    if frame[1] in (0xFF, 0x01):
                        return frame[1], frame[2], frame[head:-1]
                    continue
            del heard[0]
        heard.clear()
        return None

    # -- measuring

    def measure(self, begin_ns: int) -> None:
        """Begin to measure at a device time."""
        self.phase = "measurement"
        self._measurement = Measurement(self.output, begin_ns, self.run)
        self._block, self._waiting = 0, []

    def _due(self, now: int, out: list[bytes]) -> None:
        """Messages whose time has come."""
        run = self._measurement
        assert run is not None
        while True:
            while self._waiting and self._waiting[-1][0] <= now:
                self._send(self._waiting.pop()[1], out)
            if self._waiting or run.begin_ns + self._block * BLOCK_NS > now:
                return
            self._block_counter = self._counter
            self._waiting = run.block(self._block, self._counter)[::-1]
            self._block += 1

    def _send(self, frame: bytes, out: list[bytes]) -> None:
        number = self._counter
        self._counter += 1
        if self._drop or self._corrupt:
            random = np.random.default_rng([self._seed, number])
            chance = random.random()
            if chance < self._drop:
                return
            if chance < self._drop + self._corrupt:
                at, bit = random.integers(len(frame)), random.integers(8)
                frame = frame[:at] + bytes([frame[at] ^ 1 << bit]) + frame[at + 1 :]
        out.append(frame)

    def change(self, **state: object) -> None:
        """A command changed the status word or UTC: what is made already but not sent is made again."""
        self.run = replace(self.run, state=replace(self.run.state, **state))  # type: ignore[arg-type]
        if self._measurement is not None:
            self._measurement = replace(self._measurement, run=self.run)
            if left := len(self._waiting):
                self._waiting = self._measurement.block(self._block - 1, self._block_counter)[::-1][:left]

    def stop(self) -> None:
        """To the config state; what is made but not sent never is."""
        self.phase, self._measurement, self._waiting = "config", None, []

    def reset(self, now: int) -> None:
        """As if power had failed for a moment: device time begins anew, a stored baud rate acts."""
        self.stop()
        self.baud = BAUD_RATES[self.settings[BAUDRATE][0]]
        off = now + BOOT_NS
        self.change(utc_ns=self.run.state.utc_ns + off, no_rotation=None, representative_motion=False)
        self._start_ns += round(off / self._speed)
        self.phase, self._counter, self._heard_ns = "boot", 0, -BOOT_NS
        self._heard.clear()

    # -- answering

    def _answer(self, mid: int, payload: bytes, now: int) -> bytes | None:
        """The payload of the acknowledgement; None where there is none."""
        action = ACTIONS.get(mid)
        setting = SETTINGS.get(mid)
        if action is None and (setting is None or (setting.needs and setting.needs not in self.product.abilities)):
            raise RefusedError(ERROR_MESSAGE)
        phases, method = action or (("config",), None)
        if self.phase not in phases:
            raise RefusedError(ERROR_MESSAGE)
        if method is not None:
            return method(self, payload, now)
        assert setting is not None
        if not payload:
            return self.settings[mid]
        if len(payload) not in setting.sizes:
            raise RefusedError(ERROR_MESSAGE)
        if not setting.valid(payload, self.product):
            raise RefusedError(setting.error)
        self.settings[mid] = setting.kept(payload, self.settings[mid])
        self._couple(mid)
        return b""

    def _couple(self, mid: int) -> None:
        """In the 600-series the baud rate is one with the low byte of the first port's word."""
        ports = self.settings[PORT_CONFIG]
        if mid == PORT_CONFIG:
            self.settings[BAUDRATE] = ports[3:4]
        elif mid == BAUDRATE:
            self.settings[PORT_CONFIG] = ports[:3] + self.settings[BAUDRATE] + ports[4:]

    # -- what it is set to

    def restore(self) -> None:
        """Factory settings."""
        self.settings = factory_settings(self.product)
        self.output = tuple(
            (identifier, self.grant(identifier, self._rate if wish < 0 else wish))
            for identifier, wish in self.product.output
        )

    def grant(self, identifier: int, wish: int) -> int:
        """The rate that `wish` Hz of an item becomes.

        Raises:
            RefusedError: the product has no such item.
        """
        source = source_of(identifier, self.product.abilities)
        if source is None:
            raise RefusedError(ERROR_PARAMETER)
        return granted(source, wish, self._fastest if self.product.fastest == 400 else self.product.fastest)

    def identifier(self) -> bytes:
        """Its number as the wire has it: 8 bytes in the 600-series, else 4."""
        return self.serial.to_bytes(8 if self.product.series == 600 else 4, "big")

    def configuration(self) -> bytes:
        """The Configuration message of tables 13 and 14, 118 bytes."""
        identifier = self.identifier()
        head = identifier if self.product.series == 600 else identifier + struct.pack(">HH", 1152, 0)
        date = b"".join(part.encode() for part in ("20260101", "00000000"))
        host = self.product.code.encode("ascii").ljust(20) if self.product.series == 600 else b""  # as the real ones do
        body = head + bytes(8) + date + host.ljust(64, b"\0") + struct.pack(">H", 1) + identifier
        return body.ljust(118, b"\0")
