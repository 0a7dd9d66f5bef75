"""A simulated 3DM-GX5-45: its readings of the shared trajectory, and its answers.

Settings are written, read, saved, loaded and reset to their defaults; what was saved outlives its power.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from imuscope.plugin import rotations, trajectory
from imuscope_mip.messages import (
    ACK,
    BASE,
    COMMAND_FILTER,
    DEFAULT,
    FILTER_DATA,
    IMU_DATA,
    LOAD,
    READ,
    ROTATION_COMMAND,
    ROTATION_REPLY,
    SAVE,
    WRITE,
    G,
)
from imuscope_mip.packets import HEADER, SUM, SYNC, build, checksum, parts_of

PRODUCT = "3DM-GX5-45"
FIRMWARE = 1_121
WEEK, TOW_S = 2_400, 100_000.0  # GPS time at power-up
NED_FROM_ENU = np.array((0.0, math.sqrt(0.5), math.sqrt(0.5), 0.0))
BODY_FROM_FRD = np.array((0.0, 1.0, 0.0, 0.0))  # forward, right, down as the device has it; the drive: left, up
FRD = np.array((1.0, -1.0, -1.0))
EARTH_GAUSS = 0.48
VALID = 1
UNKNOWN, BAD_PARAMETER = 1, 3
NONE = (0.0, 0.0, 0.0)
BLOCK_NS = 100_000_000


@dataclass
class Stored:
    """Non-volatile state of a device."""

    rotation: tuple[float, ...] = NONE


class MipSimulator:
    """See imuscope.protocols.simulator.family.SimulatedDevice.

    Args:
        rate: packets of each kind a second.
        stored: what it kept; None for a new one.
    """

    def __init__(
        self,
        *,
        rate: float = 100.0,
        seed: int = 0,
        start_ns: int = 0,
        baud: int = 115_200,
        clock_drift_ppm: float = 0.0,
        clock_jump: tuple[float, float] | None = None,
        stored: Stored | None = None,
    ) -> None:
        self.baud = baud
        self._rate, self._seed, self._start_ns = max(int(rate), 1), seed, start_ns
        self._speed = 1 + clock_drift_ppm * 1e-6
        self._jump = clock_jump
        self._stored = stored or Stored()
        self._rotation = self._stored.rotation
        self._streaming = True
        self._block = 0
        self._waiting: list[tuple[int, bytes]] = []
        self._input = b""
        self._again: Callable[[int, Stored], MipSimulator] = lambda at, copy: MipSimulator(
            rate=rate,
            seed=seed,
            start_ns=at,
            baud=baud,
            clock_drift_ppm=clock_drift_ppm,
            clock_jump=clock_jump,
            stored=copy,
        )

    def repowered(self, start_ns: int) -> MipSimulator:
        """Itself after its power was off."""
        return self._again(start_ns, self._stored)

    def advance(self, now_ns: int) -> bytes:
        """Everything that it sends up to that time."""
        now = int((now_ns - self._start_ns) * self._speed)
        out = []
        while True:
            while self._waiting and self._waiting[0][0] <= now:
                _, packet = self._waiting.pop(0)
                if self._streaming:
                    out.append(packet)
            if self._waiting or self._block * BLOCK_NS > now:
                return b"".join(out)
            self._waiting = self._measure(self._block)
            self._block += 1

    @property
    def next_ns(self) -> int:
        """Time of its next packet; 0 where that is not known."""
        return self._start_ns + math.ceil(self._waiting[0][0] / self._speed) if self._waiting else 0

    # -- measured ------------------------------------------------------------------------------------------------------

    def _measure(self, block: int) -> list[tuple[int, bytes]]:
        """The packets of a block, with their times."""
        per_s = 1_000_000_000 // BLOCK_NS
        steps = np.arange(math.ceil(block * self._rate / per_s), math.ceil((block + 1) * self._rate / per_s))
        if not len(steps):
            return []
        times = steps * 1_000_000_000 // self._rate
        truth = trajectory.vehicle_motion(times / 1e9)
        chance = np.random.default_rng((self._seed, block))
        force = FRD * truth.force / G + 1e-4 * chance.standard_normal(truth.force.shape)
        turn = FRD * truth.rate + 1e-4 * chance.standard_normal(truth.rate.shape)
        field = EARTH_GAUSS * FRD * truth.field
        q_ned_from_body = rotations.product(NED_FROM_ENU, truth.q_enu_from_body_wxyz)
        q = rotations.product(q_ned_from_body, BODY_FROM_FRD)
        angles = rotations.euler_of(q)
        place = trajectory.geodetic(truth.position)
        packets = []
        for i, time in enumerate(times.tolist()):
            stamp = self._stamp(time / 1e9)
            imu = build(
                IMU_DATA,
                [(0x04, _floats(force[i])), (0x05, _floats(turn[i])), (0x06, _floats(field[i])), (0x12, stamp)],
            )
            solved = build(
                FILTER_DATA,
                [
                    (0x01, struct.pack(">3dH", *place[i], VALID)),
                    (0x03, _floats(q[i]) + struct.pack(">H", VALID)),
                    (0x05, _floats(angles[i]) + struct.pack(">H", VALID)),
                    (0x11, stamp),
                ],
            )
            packets.append((time, imu + solved))
        return packets

    def _stamp(self, t: float) -> bytes:
        if self._jump is not None and t >= self._jump[0]:
            t += self._jump[1]
        return struct.pack(">dHH", TOW_S + t, WEEK, 0)

    # -- asked ---------------------------------------------------------------------------------------------------------

    def receive(self, data: bytes, now_ns: int) -> bytes:
        """Bytes from the host; what it answers, and what it had to send by then."""
        out = [self.advance(now_ns)]
        self._input += data
        while (at := self._input.find(SYNC)) >= 0:
            self._input = self._input[at:]
            if len(self._input) < HEADER or len(self._input) < (size := HEADER + self._input[3] + SUM):
                return b"".join(out)
            packet = self._input[:size]
            if packet[-SUM:] != checksum(packet[:-SUM]):
                self._input = self._input[len(SYNC) :]
                continue
            self._input = self._input[size:]
            out += [self._answer(packet[2], number, part) for number, part in parts_of(packet)]
        self._input = self._input[-1:] if self._input.endswith(SYNC[:1]) else b""
        return b"".join(out)

    def _answer(self, number: int, descriptor: int, data: bytes) -> bytes:
        error, parts = UNKNOWN, []
        if number == BASE and descriptor in (0x01, 0x02, 0x03, 0x06):
            error = 0
            if descriptor in (0x02, 0x06):
                self._streaming = descriptor == 0x06
            if descriptor == 0x03:
                texts = (PRODUCT, "6251-4220", f"6251.{70_000 + self._seed}", "", "8g, 300d/s")
                parts = [(0x81, struct.pack(">H", FIRMWARE) + b"".join(text.encode().ljust(16) for text in texts))]
        elif number == COMMAND_FILTER and descriptor == ROTATION_COMMAND:
            error, parts = self._rotate(data)
        return build(number, [(ACK, bytes((descriptor, error))), *parts])

    def _rotate(self, data: bytes) -> tuple[int, list[tuple[int, bytes]]]:
        function, values = data[0] if data else 0, data[1:]
        if function == WRITE and len(values) == 12:
            self._rotation = struct.unpack(">3f", values)
        elif function == READ:
            return 0, [(ROTATION_REPLY, _floats(self._rotation))]
        elif function == SAVE:
            self._stored.rotation = self._rotation
        elif function == LOAD:
            self._rotation = self._stored.rotation
        elif function == DEFAULT:
            self._rotation = NONE
        else:
            return BAD_PARAMETER, []
        return 0, []


def _floats(values: Any) -> bytes:
    return struct.pack(f">{len(values)}f", *values)
