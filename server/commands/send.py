"""`imuscope send`: send one command to one device, for scripts: `imuscope send SOURCE MESSAGE [FIELD=VALUE …]`.

    imuscope send /dev/ttyUSB0 ReqDID                        {"message": "DeviceID", "fields": {"device_id": …}}
    imuscope send sim:isb SET_DID_FLASH_CONFIG startupNavDtMs=20
    imuscope send sim:isb DID_FLASH_CONFIG                  the setting, read

The command opens the link, identifies the device, runs the transaction of the command as the page would (an MTi goes to
the config state and back), and prints the reply as a line of JSON; a written setting is read back and printed as a
second line. The name of a setting instead of a message reads the setting, or writes the given fields.

Commands that lose settings, stop output or cut the line need --yes. If the device refuses, does not answer or is
missing, one line is printed and the exit status is 1. A command that is killed leaves the frames that put the device
back; the next one, or a server, sends them first (server/configuration/put_back.py).
"""

import asyncio
import contextlib
import signal
import time
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TextIO

from imuscope.protocols.commands.composer import ProtocolComposer
from imuscope.protocols.commands.transactions import (
    DeviceContext,
    DeviceDriver,
    DeviceRejectedError,
    NoReplyError,
    RequiresState,
    T,
    Transaction,
    Values,
)
from imuscope.protocols.events import Decoder, Event, Shared, sender_of
from imuscope.protocols.registry.families import PROTOCOLS, detect
from imuscope.protocols.schema.fields import Command, Field, Setting
from imuscope.protocols.schema.layouts import EncodeError
from imuscope.protocols.schema.shown_values import to_shown
from imuscope.server.commands.compose import ComposeError, composers, find_composer, frame_of, names_elements, parse
from imuscope.server.concurrency.tasks import end_tasks
from imuscope.server.configuration.put_back import PUT_BACK, WAITING, PutBackStore
from imuscope.server.configuration.risks import dangers_of_write
from imuscope.server.configuration.transaction_runner import Runner
from imuscope.server.configuration.value_checks import problems_of, without_current_values
from imuscope.server.configuration.value_format import value_at
from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.errors import UsageError
from imuscope.server.links.base import Link, LinkError, LinkSettings, OwedFrames, steady_clock
from imuscope.server.links.source_url import open_link
from imuscope.server.settings.config import default_data
from imuscope.server.system.end_signals import end_signals
from imuscope.server.text.printable import json_text

LISTEN_S = 1.5  # for the first bytes, from which the protocol is detected
BOOT_S = 0.6  # a simulator, or a device that is reset when its port is opened, cannot receive before
DETECTION_BYTES = 400
ADDRESS_S = 0.5  # for a few frames of each device
ALONE = 0xFF  # bus identifier of a device that does not share its line


class NullTrafficListener:
    """A watcher that discards everything; only the page has a traffic log."""

    def sent(self, frame: bytes, what: str, written_ns: int | None) -> None: ...

    def matched(self, event: Event, *, may_refuse: bool = False) -> None: ...

    def add_note(self, text: str, *, error: bool = False) -> None: ...


class LinkChannel:
    """A link and a decoder without a server: the interface that a Runner needs."""

    def __init__(self, link: Link, make: Callable[[], Decoder], device: str = "") -> None:
        self.link = self._link = link
        self._device = device
        self._make = make
        self._decoder = self._fresh()
        self._listeners: list[Callable[[Event], None]] = []
        self._task: asyncio.Task[None] | None = None

    def _fresh(self) -> Decoder:
        decoder = self._make()
        if self._device and isinstance(decoder, Shared):
            decoder.addresses = {"": int(self._device)}  # decode only this device
        return decoder

    @property
    def addresses(self) -> list[int]:
        """Addresses of the devices received so far; the default address for protocols without addresses."""
        return sorted(self._decoder.addresses.values()) if isinstance(self._decoder, Shared) else [ALONE]

    def start(self, first: bytes = b"") -> None:
        """Start reading; `first` are bytes received before."""
        self._decoder.feed(first, 0)
        self._task = asyncio.get_running_loop().create_task(self._read())

    async def close(self) -> None:
        if self._task is not None:
            self._task.cancel()
            with contextlib.suppress(asyncio.CancelledError, LinkError):
                await self._task
            self._task = None
        await self._link.close()

    async def _read(self) -> None:
        while True:
            for chunk in await self._link.read():
                self._decoder.feed(chunk.data, chunk.arrival_ns)
            self.decode()

    async def send(self, data: bytes) -> None:
        await self._link.write(data)

    async def reopen(self, baud: int | None) -> None:
        await end_tasks(self._task)
        await self._link.reopen(baud)
        self._decoder = self._fresh()
        self.start()

    def listen(self, callback: Callable[[Event], None]) -> Callable[[], None]:
        self._listeners.append(callback)
        return lambda: self._listeners.remove(callback)

    def decode(self) -> None:
        for event in self._decoder.drain():
            if self._device and sender_of(event):
                continue
            for callback in self._listeners:
                callback(event)


@dataclass(frozen=True, slots=True)
class SendRequest:
    """Request for `imuscope send`.

    Args:
        message: a command, another message, or a setting.
        pairs: FIELD=VALUE.
        is_confirmed: the user accepts the consequences (--yes).
        device: bus identifier of an Xbus device that shares its line; "" for a device alone on its line.
    """

    source: str
    message: str
    pairs: list[str] = field(default_factory=list)
    is_confirmed: bool = False
    device: str = ""


async def send(request: SendRequest, reading: DecodeOptions, out: TextIO, notes: TextIO) -> None:
    """Send the command and print the result.

    Raises:
        UsageError, LinkError: with the reason.
    """
    all_composers = composers(reading)
    try:
        # Reports an invalid message before a port is opened.
        guess = _find_composer(all_composers, request.message, reading.protocol)
        link = open_link(
            request.source,
            LinkSettings(steady_clock(), protocol=reading.protocol or guess.name, decode_options=reading.values),
        )
        store = PutBackStore(default_data() / PUT_BACK)
        owed = next((one for one in await asyncio.to_thread(store.all) if one.source == request.source), None)
        link.owed = OwedFrames(owed.baud, WAITING) if owed is not None else None
        await link.open()
        try:
            name, first = await _detect_protocol(link, reading.protocol, guess.name)
            composer = (
                all_composers[name]
                if _has_message(all_composers[name], request.message)
                else _find_composer(all_composers, request.message, name)
            )
            row = PROTOCOLS[name]
            channel = LinkChannel(link, lambda: row.decoding.decoder(**reading.settings(name)), request.device)
            channel.start(first)
            try:
                for frame in owed.frames if owed is not None else ():  # an earlier command was killed
                    await channel.send(bytes.fromhex(frame))
                device = await _choose_device(channel, request.device)
                known = DeviceContext(baud=link.baud, settings=reading.settings(name), device=device)
                await _transact(_SendContext(composer, request, known, store), channel, out, notes)
            finally:
                await channel.close()
        finally:
            await link.close()
    except DeviceRejectedError as error:
        raise UsageError(f"refused: {error}") from None
    except NoReplyError as error:
        raise UsageError(str(error)) from None
    except EncodeError as error:
        raise UsageError(f"{request.message}: {error}") from None


async def until_signal(work: Awaitable[None]) -> None:
    """Work that a signal cancels, as asyncio does at Ctrl-C: the device then measures again.

    Raises:
        SystemExit: a signal ended it.
    """
    task = asyncio.current_task()
    assert task is not None
    received: list[int] = []

    def end(number: int) -> None:
        received.append(number)
        task.cancel()

    loop = asyncio.get_running_loop()
    for number in end_signals():
        if number != signal.SIGINT:
            loop.add_signal_handler(number, end, number)
    try:
        await work
    except asyncio.CancelledError:
        if received:
            raise SystemExit(128 + received[0]) from None
        raise


async def _choose_device(channel: LinkChannel, device: str) -> str:
    """Bus identifier of the device to send to. Devices that share a line answer only to their own bus identifier, which
    is known after a few of their frames.

    Raises:
        UsageError: none was named, and there are several.
    """
    end = time.monotonic() + ADDRESS_S
    while not device and channel.addresses != [ALONE] and time.monotonic() < end:
        await asyncio.sleep(0.02)
        channel.decode()
    received = channel.addresses
    if len(received) > 1 and not device:
        named = ", ".join(map(str, received))
        raise UsageError(f"the line is shared by the bus identifiers {named}; choose one with --device")
    return device or (str(received[0]) if received and received[0] != ALONE else "")


def _has_message(composer: ProtocolComposer, message: str) -> bool:
    return message in composer.names() or _setting(composer.driver, message, DeviceContext()) is not None


def _find_composer(all_composers: dict[str, ProtocolComposer], message: str, protocol: str) -> ProtocolComposer:
    candidates = [all_composers[protocol]] if protocol in all_composers else list(all_composers.values())
    for composer in candidates:
        if _setting(composer.driver, message, DeviceContext()) is not None:
            return composer
    return find_composer(all_composers, message, protocol)


async def _detect_protocol(link: Link, protocol: str, guess: str) -> tuple[str, bytes]:
    """The protocol of the source, and the bytes received for detection; for a silent source, that of the message."""
    begin, received = time.monotonic(), bytearray()
    with contextlib.suppress(TimeoutError):
        while len(received) < DETECTION_BYTES:
            left = (BOOT_S if protocol else LISTEN_S) - (time.monotonic() - begin)
            async with asyncio.timeout(max(left, 0.001)):
                chunks = await link.read()
            for chunk in chunks:
                received += chunk.data
    best = detect(bytes(received))[0] if received and not protocol else None
    return protocol or (best.protocol if best and best.score > 0.2 else guess), bytes(received)


@dataclass(frozen=True, slots=True)
class _SendContext:
    composer: ProtocolComposer
    request: SendRequest
    known: DeviceContext
    store: PutBackStore


async def _transact(context: _SendContext, channel: LinkChannel, out: TextIO, notes: TextIO) -> None:
    driver, request = context.composer.driver, context.request

    async def keep(frames: Sequence[bytes]) -> None:
        """Store how to put the device back, for the next command or server; a simulator does not outlast this one."""
        if channel.link.kind not in ("simulator", "file"):
            await asyncio.to_thread(context.store.keep, request.source, "", frames, channel.link.baud)

    runner = Runner(channel, NullTrafficListener(), put_back=keep, confirms=driver.confirms)

    async def play(body: Transaction[T]) -> T:
        return await runner.run(driver.within(body, known))

    known = context.known
    command = context.composer.command(request.message)
    if command is None or not _continues(context.composer, command, request, known):
        with contextlib.suppress(NoReplyError, DeviceRejectedError):
            known = replace(await play(driver.identify(known)), baud=known.baud, settings=known.settings)
    setting = _setting(driver, request.message, known)
    if setting is not None and command is None:
        await _run_setting(context.composer, setting, request, known, play, out, notes)
        return
    present = await _present(driver, command, request, known, play)
    frame, values = frame_of(context.composer, request.message, request.pairs, known, present)
    if command is None:
        if request.message in context.composer.of_devices:
            raise UsageError(f"{request.message} is sent by devices only, and a device does not take it")
        await channel.send(frame)
        _print(out, {"sent": frame.hex()})
        return
    if command.is_risky(values):
        _allow(command, request)
    if (target := _target(driver, command, values, known)) is not None:
        await _allow_write(driver, *target, request, known, play)
    answer = await play(driver.run(command.name, values, known))
    described = context.composer.messages.get(command.reply, ())
    _print(out, {"message": command.reply or command.name, "fields": _readable(described, answer)})
    setting_row = next((row for row in driver.settings(known) if row.write == command.name), None)
    if setting_row is not None and command.kind == "set":
        got = await play(driver.read(setting_row.name, known))
        _print(out, {"setting": setting_row.name, "fields": _readable(setting_row.fields, got)})
        _report_altered(driver, setting_row, values, got, notes)


async def _present(
    driver: DeviceDriver,
    command: Command | None,
    request: SendRequest,
    known: DeviceContext,
    play: Callable[[Transaction[Any]], Any],
) -> Values:
    """Current value of the setting that a command writes, if a single element of a vector is named."""
    try:
        if command is None or not names_elements(request.pairs, command.arguments):
            return {}
    except ComposeError:  # fields of another form of the command: reported when it is composed
        return {}
    row = next((row for row in driver.settings(known) if row.write == command.name), None)
    return {} if row is None else await play(driver.read(row.name, known))


def _continues(composer: ProtocolComposer, command: Command, request: SendRequest, known: DeviceContext) -> bool:
    """Whether the command continues an earlier one whose state a device query would discard."""
    try:
        _, values = frame_of(composer, request.message, request.pairs, known)
    except ComposeError:  # perhaps the form of another product: reported when the product is known
        return False
    body = composer.driver.run(command.name, values, known)
    return isinstance(body, RequiresState) and body.continues


async def _run_setting(
    composer: ProtocolComposer,
    setting: Setting,
    request: SendRequest,
    known: DeviceContext,
    play: Callable[[Transaction[Any]], Any],
    out: TextIO,
    notes: TextIO,
) -> None:
    """Read a setting, or write the given fields."""
    driver = composer.driver
    if not request.pairs:
        got = await play(driver.read(setting.name, known))
        _print(out, {"setting": setting.name, "fields": _readable(setting.fields, got)})
        return
    if not setting.write:
        raise UsageError(f"{setting.name} is read-only")
    present: Values = {}
    try:
        if names_elements(request.pairs, setting.fields):
            present = await play(driver.read(setting.name, known))
        values = parse(request.pairs, setting.fields, present)
    except ComposeError as error:
        command = composer.command(setting.write)
        fields = {one.name for one in command.arguments} if command is not None else set()
        if fields and all(pair.partition("=")[0].split(".")[0] in fields for pair in request.pairs):
            raise ComposeError(f"{error}; the command {setting.write} has it") from None
        raise
    held = False
    try:
        driver.setting_frames(setting.name, values, known)
    except EncodeError:  # what the device reports may be outside the tables
        present = present or await play(driver.read(setting.name, known))
        problems = problems_of(setting.fields, values, partial=True)
        if without_current_values(problems, values, present):
            raise
        driver.setting_frames(setting.name, values, known, held=bool(problems), old=present)
        held = True
    await _allow_write(driver, setting, values, request, known, play)
    written = await play(driver.write(setting.name, values, known, held=held))
    if written.refused:
        raise UsageError(f"{setting.name} was refused: {written.refused}")
    _print(out, {"setting": setting.name, "fields": _readable(setting.fields, written.actual)})
    if written.actual is not None:
        _report_altered(driver, setting, values, written.actual, notes)


def _setting(driver: DeviceDriver, name: str, known: DeviceContext) -> Setting | None:
    return next((row for row in driver.settings(known) if row.name == name), None)


def _allow(row: Command, request: SendRequest) -> None:
    """Raise UsageError for a dangerous command that is not confirmed."""
    if row.caution and not request.is_confirmed:
        raise UsageError(f"{row.name}: {row.consequence or 'this can do harm.'} Add --yes to send it")


def _target(
    driver: DeviceDriver, command: Command, values: Values, known: DeviceContext
) -> tuple[Setting, Values] | None:
    """The setting that a command writes, and its values."""
    other = driver.instead(command.name, values, {}, known)
    if other is not None and other[1]:
        setting = _setting(driver, other[0], known)
        return None if setting is None else (setting, other[1])
    for row in driver.settings(known):
        if row.write == command.name and command.kind == "set" and set(values) <= {one.name for one in row.fields}:
            return row, values
    return None


async def _allow_write(
    driver: DeviceDriver,
    setting: Setting,
    values: Values,
    request: SendRequest,
    known: DeviceContext,
    play: Callable[[Transaction[Any]], Any],
) -> None:
    """Raise UsageError for an unconfirmed write that could cut the link or do other harm, like the page."""
    if request.is_confirmed:
        return
    old: Values | None = None
    with contextlib.suppress(DeviceRejectedError):
        old = await play(driver.read(setting.name, known))
    risks = dangers_of_write(driver, setting, old, values, known, restarts=False)
    if risks:
        words = " ".join(dict.fromkeys(one.consequence or "This can do harm." for one in risks))
        raise UsageError(f"{setting.name}: {words} Add --yes to send it")


def _report_altered(driver: DeviceDriver, setting: Setting, requested: Values, got: Values, notes: TextIO) -> None:
    """Report values that the device altered (it rounds rates)."""
    shown, intended = to_shown(setting.fields, got), to_shown(setting.fields, requested)
    for path in driver.same(setting.name, {name: requested[name] for name in requested if name in got}, got):
        actual, target = value_at(shown, path), value_at(intended, path)
        notes.write(f"imuscope: {setting.name} {path} was changed by the device: {actual!r} instead of {target!r}.\n")


def _readable(fields: Sequence[Field], values: Values | None) -> Values | None:
    """Values in the units in which they are entered."""
    return None if values is None else to_shown(fields, values)


def _print(out: TextIO, line: Values) -> None:
    out.write(json_text(line, default=str) + "\n")
    out.flush()
