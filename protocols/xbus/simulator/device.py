"""A simulated MTi.

    power, Reset ──> wake-up ──500 ms, no WakeUpAck──> measurement ──GoToConfig──> config
                        └───────── WakeUpAck ────────────────────────────────────────^ │
                     Configuration before measurement        <────GoToMeasurement──────┘

`XbusSimulator` is pure: it has no clock, link or thread. The caller passes the current time and gets the bytes sent by
then; requests are answered according to section 5 of the document, from a stored configuration. Settings are stored at
once, in a memory that outlives Reset and power (`repowered`), unless the option flag DisableAutoStore prevents it; a
new baud rate takes effect after Reset. Invalid requests are answered with Error: 4 for a message that is unknown, of a
wrong size, or not valid in this state, 33 for a parameter, 32 for a baud rate, 3 for a period. A device that receives
0xDE at 115 200 Bd while it boots wakes up with the factory's communication settings (7.2).

simulator/signals.py computes its measurements, from the shared drive, simulator/strings.py its strings instead of data.
Not simulated: alignment matrices (set by an orientation reset) and filter profiles are stored and answered but do not
affect the output; its eMTS (0x91), encrypted in a real device, is empty.

Rules for editing: a setting that is only stored and returned is a row in simulator/settings.py; one with an effect is a
function in simulator/handlers.py.

Source: MT0101P 2020.A, sections 4 and 5.
"""

import math
import struct
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Literal

from imuscope.protocols.simulator.setups import AS_BUILT, SensorSetup
from imuscope.protocols.xbus import frames
from imuscope.protocols.xbus.config_effects import BAUD_RATES
from imuscope.protocols.xbus.enums import INTERVAL, SEND_LATEST, TRIGGER
from imuscope.protocols.xbus.output_configuration import accepted_rates, max_rate, output_of
from imuscope.protocols.xbus.product_options import LONGEST_PERIOD
from imuscope.protocols.xbus.simulator.faults import NONE, FaultInjection
from imuscope.protocols.xbus.simulator.handlers import ACTIONS
from imuscope.protocols.xbus.simulator.io import PowerCutError, ReplyQueue, RequestParser
from imuscope.protocols.xbus.simulator.measurement import BLOCK_NS, Measurement, renumbered
from imuscope.protocols.xbus.simulator.settings import (
    BAUDRATE,
    ERROR_MESSAGE,
    ERROR_PARAMETER,
    LOCATION,
    OPTIONS,
    PERIOD,
    PORT_CONFIG,
    PRODUCTS,
    SETTINGS,
    SKIP,
    STRINGS,
    SYNC,
    RequestRefusedError,
    SimulatedProduct,
    factory_settings,
    strings_of,
)
from imuscope.protocols.xbus.simulator.signals import XbusSignalSource
from imuscope.protocols.xbus.simulator.strings import Sentences

WAKE_UP_WINDOW_NS = 500_000_000
BOOT_NS = 300_000_000  # from Reset to WakeUp
BOOT_BAUD = 115_200  # of the line on which it accepts 0xDE while it boots
GO_TO_CONFIG, ERROR, RESTORE = 0x30, 0x42, 0xDE
DISABLE_AUTO_STORE, DISABLE_AUTO_MEASUREMENT = 1, 2

Phase = Literal["boot", "wake-up", "config", "measurement"]


class XbusSimulator:
    """A simulated MTi.

    Args:
        product: "MTi-630", "MTi-680G", "MTi-3", "MTi-30", "MTi-G-710"…: a key of `settings.PRODUCTS`.
        serial: device identifier; None for one of the product's own range, derived from the seed.
        seed: repeats noise and faults of its answers exactly.
        start_ns: power-on time, on the clock of `advance`.
        rate: samples/s of the default output configuration; above 400 the device is faster than any real one.
        clock_drift_ppm: how much faster the device's oscillator runs than the clock of `advance`.
        clock_jump: (device time s, by s): SampleTimeFine jumps once.
        vibration: share of the vehicle's shaking that reaches the sensor: 0 none, 1 a rigid mount.
        measuring: True: powered long ago and already in the measurement state at `start_ns`.
        baud: initially stored rate, one of table 7; None for the factory's.
        port: host port of a 600-series that the line is connected to: 0 RS-232, 1 UART.
        moods: faults of its answers.
        bid: its bus identifier on a shared line: it sends under it and answers to nothing else. None for a device alone
            on its line: it answers to 1 and to 255, and sends under 255.
        setup: motion, and errors that a calibration finds.

    Raises:
        ValueError: unknown product.
    """

    def __init__(
        self,
        product: str = "MTi-630",
        serial: int | None = None,
        seed: int = 0,
        start_ns: int = 0,
        *,
        rate: float = 100,
        clock_drift_ppm: float = 0.0,
        clock_jump: tuple[float, float] | None = None,
        vibration: float = 0.0,
        measuring: bool = False,
        baud: int | None = None,
        port: int = 0,
        moods: FaultInjection = NONE,
        bid: int | None = None,
        setup: SensorSetup = AS_BUILT,
    ) -> None:
        if product not in PRODUCTS:
            raise ValueError(f"there is no simulator of {product!r}; there are {', '.join(PRODUCTS)}")
        self.product: SimulatedProduct = PRODUCTS[product]
        self.serial = self.product.first_serial + seed % 0xFFFF + 1 if serial is None else serial
        self.phase: Phase = "boot"
        self._start_ns = start_ns
        self._speed = 1 + clock_drift_ppm * 1e-6
        self._fastest = 400 if rate <= 400 else 2000
        self._rate = max(int(rate), 1)
        jump = clock_jump and (round(clock_jump[0] * 1e9), round(clock_jump[1] * 1e4))
        abilities = self.product.capabilities
        self.run = XbusSignalSource(abilities, seed, self.product.wrap, jump, vibration, self.serial, setup)
        self.settings: dict[int, bytes] = {}
        self.reset_pending = b""  # both alignments after a ResetOrientation, until it is stored
        self.output: tuple[tuple[int, int], ...] = ()
        self._faults, self._ignores_goto_config = moods, moods.ignores_goto_config
        self._replies, self._stores = ReplyQueue(moods, seed), 0
        self._restarting: Callable[[int], XbusSimulator] = partial(
            XbusSimulator,
            product,
            self.serial,
            seed,
            rate=rate,
            clock_drift_ppm=clock_drift_ppm,
            clock_jump=clock_jump,
            vibration=vibration,
            baud=baud,
            port=port,
            moods=moods,
            bid=bid,
            setup=setup,
        )
        self._port, self._bid = port, bid
        self._restored = False  # 0xDE was received during boot
        self._newest = b""  # sample, while SendLatest waits for a trigger
        self._requested: list[bytes] = []
        self.restore()
        if baud in BAUD_RATES.values():
            self._begin_at(next(code for code, one in BAUD_RATES.items() if one == baud))
        self._memory = self._present()
        self.baud, self._ignores_input = self._line()
        self._parser = self._new_parser()
        self._measurement: Measurement | Sentences | None = None
        self._block = 0
        self._waiting: list[tuple[int, bytes]] = []  # messages of this block not sent yet, last first
        self._counter = self._block_counter = 0  # of MTData2 messages that were sent; no others are counted (5.3.6)
        if measuring:
            self.measure(0)

    # -- the two directions of the link

    def advance(self, now_ns: int) -> bytes:
        now = self._local(now_ns)
        out: list[bytes] = []
        if self.phase == "boot" and now >= 0:
            self._wake_up()
            out.append(frames.build(0x3E))
        if self.phase == "wake-up" and now >= WAKE_UP_WINDOW_NS:
            if self.flagged(DISABLE_AUTO_MEASUREMENT):
                self.stop()
            else:
                out.append(frames.build(0x0D, self.configuration()))
                self.measure(WAKE_UP_WINDOW_NS)
        if self.phase == "measurement":
            self._due(now, out)
        out += self._replies.due(now)
        return b"" if self._ignores_input else self._under_own_name(out)

    def receive(self, data: bytes, now_ns: int) -> bytes:
        before, out = self.advance(now_ns), list[bytes]()
        now = self._local(now_ns)
        if self.phase == "boot":
            self._restored |= RESTORE in data  # the only input accepted while booting
            return b""
        if self._ignores_input:
            return b""
        self._parser.receive(data, now)
        for bid, mid, payload in self._parser.requests():
            if mid == GO_TO_CONFIG and self._ignores_goto_config:
                continue
            try:
                answer = self._answer(mid, payload, now)
            except RequestRefusedError as refused:
                out += self._replies.send(frames.build(ERROR, bytes([refused.code]), bid), now)
            except PowerCutError:
                self.reset(now)
                break
            else:
                if answer is not None:
                    out += self._replies.send(frames.build(mid + 1, answer, bid), now)
            out += self._requested
            self._requested.clear()
        return before + self._under_own_name(out)

    @property
    def next_ns(self) -> int:
        if self.phase != "measurement" or not self._waiting or self._replies.is_busy:
            return 0
        return self._start_ns + math.ceil(self._waiting[-1][0] / self._speed)

    def _under_own_name(self, out: list[bytes]) -> bytes:
        """Output frames, each with its own bus identifier if it has one."""
        return b"".join(out if self._bid is None else (frames.to_bus(one, self._bid) for one in out))

    def _new_parser(self) -> RequestParser:
        return RequestParser() if self._bid is None else RequestParser((self._bid,))

    def _local(self, now_ns: int) -> int:
        return int((now_ns - self._start_ns) * self._speed)

    # -- measuring

    def measure(self, begin_ns: int) -> None:
        """Begin to measure at a device time. An orientation reset that was not stored is discarded (5.3.7)."""
        self.phase, self.reset_pending = "measurement", b""
        types, hertz = strings_of(self.settings, self.product)
        if types:
            self._measurement = Sentences(types, hertz, begin_ns, self.run)
        else:
            self._measurement = Measurement(self.output, begin_ns, self.run)
        self._block, self._waiting = 0, []

    def _due(self, now: int, out: list[bytes]) -> None:
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
        if isinstance(self._measurement, Sentences):
            out.append(frame)
        elif self.send_latest:
            self._newest = frame
        else:
            self._counter += 1
            out.append(frame)

    @property
    def send_latest(self) -> frozenset[int]:
        """The lines that SendLatest waits for; if there are any, nothing is sent without a trigger."""
        entries = self.settings[SYNC]
        return frozenset(entries[at + 1] for at in range(0, len(entries), 12) if entries[at] == SEND_LATEST)

    def send_newest(self) -> None:
        """Handle a trigger of SendLatest; without a measurement since the last one nothing is sent."""
        if self._newest:
            self._requested.append(renumbered(self._newest, self._counter))
            self._counter += 1
            self._newest = b""

    def change(self, **state: object) -> None:
        """Apply a command's change of the status word or UTC: messages made but not sent are made again."""
        self.run = replace(self.run, state=replace(self.run.state, **state))  # type: ignore[arg-type]
        if self._measurement is not None:
            self._measurement = replace(self._measurement, run=self.run)
            if left := len(self._waiting):
                self._waiting = self._measurement.block(self._block - 1, self._block_counter)[::-1][:left]

    def stop(self) -> None:
        """Enter the config state; messages made but not sent are dropped."""
        self.phase, self._measurement, self._waiting = "config", None, []

    def reset(self, now: int) -> None:
        """Restart as after a power failure: device time starts over, stored values take effect, the rest is lost."""
        self.stop()
        self.settings, self.output = dict(self._memory[0]), self._memory[1]
        self._ignores_goto_config, self.reset_pending = False, b""
        off = now + BOOT_NS
        self.change(
            utc_ns=self.run.state.utc_ns + off, no_rotation=None, representative_motion=False, **self._consequences()
        )
        self._start_ns += round(off / self._speed)
        self.phase, self._counter, self.baud, self._ignores_input = "boot", 0, BOOT_BAUD, False
        self._parser = self._new_parser()

    def repowered(self, start_ns: int) -> "XbusSimulator":
        """The same device after a power cycle: with its stored values, and a receiver that starts cold."""
        device = self._restarting(start_ns + BOOT_NS)
        device._memory, device.baud = self._memory, BOOT_BAUD
        device.settings, device.output = dict(self._memory[0]), self._memory[1]
        device.change(**device._consequences())
        return device

    def _wake_up(self) -> None:
        """Finish booting; output starts here."""
        self.phase = "wake-up"
        if self._restored:
            self._restored = False
            self.restore_communication()
        self.baud, self._ignores_input = self._line()

    def _begin_at(self, code: int) -> None:
        """Set a stored rate: of the port that the line is connected to."""
        if self.product.series != 600:
            self.settings[BAUDRATE] = bytes([code])
            return
        words, at = bytearray(self.settings[PORT_CONFIG]), 4 * self._port + 3
        words[at] = code
        self.settings[PORT_CONFIG] = bytes(words)
        self._couple(PORT_CONFIG)

    def _line(self) -> tuple[int, bool]:
        """Rate of the port that the line is connected to, and whether it is off or uses another protocol than Xbus."""
        if self.product.series != 600:
            return BAUD_RATES[self.settings[BAUDRATE][0]], False
        word = int.from_bytes(self.settings[PORT_CONFIG][4 * self._port : 4 * self._port + 4], "big")
        return BAUD_RATES[word & 0xFF], word >> 16 & 0xF != 1

    # -- memory

    def _present(self) -> tuple[dict[int, bytes], tuple[tuple[int, int], ...]]:
        return dict(self.settings), self.output

    def store(self) -> None:
        """Store the current settings, unless an option flag forbids it."""
        if not self.flagged(DISABLE_AUTO_STORE):
            self._memory = self._present()
        else:  # the flags themselves are always stored
            self._memory = ({**self._memory[0], OPTIONS: self.settings[OPTIONS]}, self._memory[1])

    def flagged(self, flag: int) -> bool:
        """Whether this option flag is set."""
        return bool(int.from_bytes(self.settings[OPTIONS], "big") & flag)

    def _consequences(self) -> dict[str, object]:
        """Effects of settings on the status word and accompanying items."""
        entries = self.settings[SYNC]
        kinds = {entries[at]: int.from_bytes(entries[at + 6 : at + 8], "big") for at in range(0, len(entries), 12)}
        return {
            "location": int.from_bytes(self.settings[LOCATION], "big"),
            "sync_out_every": kinds[INTERVAL] + 1 if INTERVAL in kinds else 0,
            # Nothing is connected to the trigger line here: once a second stands for a camera.
            "sync_in_s": 1.0 if TRIGGER in kinds else 0.0,
        }

    # -- answers

    def _answer(self, mid: int, payload: bytes, now: int) -> bytes | None:
        """The payload of the acknowledgement; None for none."""
        action, setting = ACTIONS.get(mid), SETTINGS.get(mid)
        on = action.products if action else setting.products if setting else frozenset()
        if self.product.model.number not in on:
            raise RequestRefusedError(ERROR_MESSAGE)
        if self.phase not in (action.phases if action else ("config",)):
            raise RequestRefusedError(ERROR_MESSAGE)
        before = self._present()
        answer = action.action(self, payload, now) if action else self._keep(mid, payload)
        if self._present() != before and self.phase == "config":
            self._stores += 1
            if self._stores == self._faults.power_cut_at:
                raise PowerCutError
            self.change(**self._consequences())
            self.store()
        return answer

    def _keep(self, mid: int, payload: bytes) -> bytes:
        """Return a setting, or store one without further effect."""
        setting = SETTINGS[mid]
        if not payload and setting.readable:
            return self.settings[mid]
        if not setting.accepts(len(payload), self.product):
            raise RequestRefusedError(ERROR_MESSAGE)
        if not setting.valid(payload, self.product):
            raise RequestRefusedError(setting.error)
        self.settings[mid] = setting.store(payload, self.settings[mid])
        self._couple(mid)
        return b""

    def _couple(self, mid: int) -> None:
        """In the 600-series the baud rate equals the low byte of the first port's word; a long period is made from the
        longest and a skip factor.
        """
        ports = self.settings[PORT_CONFIG]
        period = int.from_bytes(self.settings[PERIOD], "big")
        if mid == PERIOD and period > LONGEST_PERIOD:
            self.settings[PERIOD] = LONGEST_PERIOD.to_bytes(2, "big")
            self.settings[SKIP] = (period // LONGEST_PERIOD - 1).to_bytes(2, "big")
        elif mid == PORT_CONFIG:
            self.settings[BAUDRATE] = ports[3:4]
        elif mid == BAUDRATE:
            self.settings[PORT_CONFIG] = ports[:3] + self.settings[BAUDRATE] + ports[4:]

    # -- settings

    def restore_communication(self) -> None:
        """Table 41: restore the settings that 0xDE during wake-up resets; everything else stays."""
        settings = self.settings
        self.restore()
        mids = (BAUDRATE, PORT_CONFIG, SKIP, SYNC, STRINGS)
        self.settings = {mid: self.settings[mid] if mid in mids else value for mid, value in settings.items()}
        self.change(**self._consequences())
        self.store()

    def restore(self) -> None:
        """Factory settings."""
        self.settings = factory_settings(self.product)
        self.output = tuple(
            (identifier, self.grant(identifier, self._rate if requested < 0 else requested))
            for identifier, requested in self.product.output
        )

    def grant(self, identifier: int, requested: int) -> int:
        """The granted rate for `requested` Hz of an item.

        Raises:
            RequestRefusedError: the product has no such item.
        """
        output = output_of(identifier, self.product.model)
        if output is None:
            raise RequestRefusedError(ERROR_PARAMETER)
        most = max_rate(output, self.product.model)
        return accepted_rates(requested, self._fastest if most == 400 else most)

    def identifier(self) -> bytes:
        """Its number on the wire: 8 bytes in the 600-series, else 4."""
        return self.serial.to_bytes(8 if self.product.series == 600 else 4, "big")

    def configuration(self) -> bytes:
        """The Configuration message of tables 13 and 14, 118 bytes; an identifier of 64 bits has its low word first."""
        identifier = self.identifier()
        identifier = identifier[-4:] + identifier[:-4]
        head = identifier if self.product.series == 600 else identifier + struct.pack(">HH", 1152, 0)
        date = b"".join(part.encode() for part in ("20260101", "00000000"))
        host = self.product.code.encode("ascii").ljust(20) if self.product.series == 600 else b""  # as in real devices
        body = head + bytes(8) + date + host.ljust(64, b"\0") + struct.pack(">H", 1) + identifier
        return body.ljust(118, b"\0")
