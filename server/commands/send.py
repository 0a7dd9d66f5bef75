"""One command to one device, from a script: `imuscope send SOURCE MESSAGE [FIELD=VALUE …]`.

    imuscope send /dev/ttyUSB0 ReqDID                        {"message": "DeviceID", "fields": {"device_id": …}}
    imuscope send twin:isb SET_DID_FLASH_CONFIG startupNavDtMs=20
    imuscope send twin:isb DID_FLASH_CONFIG                  the setting, read

The link is opened, the device asked who it is, the dialogue of the command played as the page would play it (an MTi
goes to the config state and back), and what answered printed as a line of JSON; a setting that was written is read back
and printed as a second line. The name of a setting instead of a message reads it, or writes the given fields.

What loses settings, stops output or cuts the line needs --yes. Exit status 1, with one line, for a device that refuses,
does not answer, or is not there.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, TextIO

from protocols.events import Decoder, Event, Shared, sender_of
from protocols.layouts import EncodeError
from protocols.registry import PROTOCOLS, detect
from protocols.schema import Command, Setting
from protocols.transactions import (
    DeviceContext,
    DeviceDriver,
    DeviceRejectedError,
    NoReplyError,
    RequiresState,
    T,
    Transaction,
    Values,
)
from server.commands.compose import ComposeError, ProtocolComposer, chosen, composers, frame_of, names_elements, parse
from server.configuration.dangers import dangers_of_write
from server.configuration.transaction_runner import Runner
from server.configuration.value_format import value_at
from server.devices.decode_options import DecodeOptions
from server.links import open_link
from server.links.base import Link, LinkError, LinkSettings, steady_clock
from server.printable import json_text

LISTEN_S = 1.5  # for the first bytes, from which the protocol is recognised
BOOT_S = 0.6  # a twin, and a device that a port's opening resets, needs a moment before it hears
ENOUGH = 400  # bytes
ADDRESS_S = 0.5  # for a few frames of each device
ALONE = 0xFF  # bus identifier of a device that has its line to itself


class SendError(Exception):
    """Why it came to nothing, in one sentence."""


class NullWatcher:
    """A watcher that says nothing: the log of the exchange is the page's."""

    def sent(self, frame: bytes, what: str) -> None: ...

    def matched(self, event: Event) -> None: ...

    def note(self, text: str, *, fault: bool = False) -> None: ...


class LinkChannel:
    """A link and a decoder, without anything of a server: what a Runner needs."""

    def __init__(self, link: Link, make: Callable[[], Decoder], device: str = "") -> None:
        self._link = link
        self._device = device
        self._make = make
        self._decoder = self._fresh()
        self._listeners: list[Callable[[Event], None]] = []
        self._task: asyncio.Task[None] | None = None

    def _fresh(self) -> Decoder:
        decoder = self._make()
        if self._device and isinstance(decoder, Shared):
            decoder.addresses = {"": int(self._device)}  # it alone is listened to
        return decoder

    @property
    def addresses(self) -> list[int]:
        """Of the devices that were heard; that of one by itself where devices of the protocol have none."""
        return sorted(self._decoder.addresses.values()) if isinstance(self._decoder, Shared) else [ALONE]

    def start(self, first: bytes = b"") -> None:
        """Begin to read; `first` are bytes that came before."""
        self._decoder.feed(first, 0)
        self._task = asyncio.get_running_loop().create_task(self._read())

    async def close(self) -> None:
        """Stop, and close the link."""
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

    async def relink(self, baud: int | None) -> None:
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)
        await self._link.relink(baud)
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
    """What is to be sent.

    Args:
        message: a command, another message, or a setting.
        pairs: FIELD=VALUE.
        yes: the person knows what it costs.
        device: bus identifier of an Xbus device that shares its line; "" for one that has it to itself.
    """

    source: str
    message: str
    pairs: list[str] = field(default_factory=list)
    yes: bool = False
    device: str = ""


async def send(wish: SendRequest, reading: DecodeOptions, out: TextIO, notes: TextIO) -> None:
    """Do it and print what came of it.

    Raises:
        SendError, compose.ComposeError: why not.
    """
    spoken = composers(reading.key, reading.schema)
    try:
        # What is written wrongly is told before a port is touched.
        hint = _tongue(spoken, wish.message, reading.protocol)
        link = open_link(
            wish.source, LinkSettings(steady_clock(), protocol=reading.protocol or hint.name, key=reading.key)
        )
        await link.open()
        try:
            name, first = await _recognised(link, reading.protocol, hint.name)
            tongue = spoken[name] if _speaks(spoken[name], wish.message) else _tongue(spoken, wish.message, name)
            row = PROTOCOLS[name]
            channel = LinkChannel(link, lambda: row.decoder(**reading.settings(row.settings)), wish.device)
            channel.start(first)
            try:
                device = await _addressed(channel, wish.device)
                known = DeviceContext(baud=link.baud, key=reading.key, device=device)
                await _exchange(_Asked(tongue, wish, known), channel, out, notes)
            finally:
                await channel.close()
        finally:
            await link.close()
    except LinkError as error:
        raise SendError(str(error)) from None
    except DeviceRejectedError as error:
        raise SendError(f"refused: {error}") from None
    except NoReplyError as error:
        raise SendError(str(error)) from None
    except EncodeError as error:
        raise SendError(f"{wish.message}: {error}") from None


async def _addressed(channel: LinkChannel, device: str) -> str:
    """The device that is meant: devices that share a line answer to their own bus identifier only, which is sure when a
    few of their frames have come.

    Raises:
        SendError: it was not named, and there are several.
    """
    end = time.monotonic() + ADDRESS_S
    while not device and channel.addresses != [ALONE] and time.monotonic() < end:
        await asyncio.sleep(0.02)
        channel.decode()
    heard = channel.addresses
    if len(heard) > 1 and not device:
        named = ", ".join(map(str, heard))
        raise SendError(f"its line is shared by the bus identifiers {named}; choose one with --device")
    return device or (str(heard[0]) if heard and heard[0] != ALONE else "")


def _speaks(tongue: ProtocolComposer, message: str) -> bool:
    return message in tongue.names() or _setting(tongue.driver, message, DeviceContext()) is not None


def _tongue(spoken: dict[str, ProtocolComposer], message: str, protocol: str) -> ProtocolComposer:
    """Whose message or setting it is."""
    among = [spoken[protocol]] if protocol in spoken else list(spoken.values())
    for tongue in among:
        if _setting(tongue.driver, message, DeviceContext()) is not None:
            return tongue
    return chosen(spoken, message, protocol)


async def _recognised(link: Link, protocol: str, hint: str) -> tuple[str, bytes]:
    """The protocol of the source and the bytes that told it; of a silent one, that of the message."""
    begin, heard = time.monotonic(), bytearray()
    with contextlib.suppress(TimeoutError):
        while len(heard) < ENOUGH:
            left = (BOOT_S if protocol else LISTEN_S) - (time.monotonic() - begin)
            for chunk in await asyncio.wait_for(link.read(), max(left, 0.001)):
                heard += chunk.data
    best = detect(bytes(heard))[0] if heard and not protocol else None
    return protocol or (best.protocol if best and best.score > 0.2 else hint), bytes(heard)


@dataclass(frozen=True, slots=True)
class _Asked:
    tongue: ProtocolComposer
    wish: SendRequest
    known: DeviceContext


async def _exchange(asked: _Asked, channel: LinkChannel, out: TextIO, notes: TextIO) -> None:
    """The dialogues of one wish."""
    driver, wish = asked.tongue.driver, asked.wish
    runner = Runner(channel, NullWatcher())

    async def play(body: Transaction[T]) -> T:
        return await runner.run(driver.within(body, known))

    known = asked.known
    command = asked.tongue.command(wish.message)
    if command is None or not _continues(asked.tongue, command, wish, known):
        with contextlib.suppress(NoReplyError, DeviceRejectedError):
            known = replace(await play(driver.identify(known)), baud=known.baud, key=known.key)
    setting = _setting(driver, wish.message, known)
    if setting is not None and command is None:
        await _setting_wish(asked.tongue, setting, wish, known, play, out, notes)
        return
    present = await _present(driver, command, wish, known, play)
    frame, values = frame_of(asked.tongue, wish.message, wish.pairs, known, present)
    if command is None:
        await channel.send(frame)
        _print(out, {"sent": frame.hex()})
        return
    if command.harms(values):
        _allow(command, wish)
    if (target := _target(driver, command, values, known)) is not None:
        await _allow_write(driver, *target, wish, known, play)
    answer = await play(driver.run(command.name, values, known))
    _print(out, {"message": command.reply or command.name, "fields": answer})
    kept = next((row for row in driver.settings(known) if row.write == command.name), None)
    if kept is not None and command.kind == "set":
        got = await play(driver.read(kept.name, known))
        _print(out, {"setting": kept.name, "fields": got})
        _tell_altered(driver, kept, values, got, notes)


async def _present(
    driver: DeviceDriver,
    command: Command | None,
    wish: SendRequest,
    known: DeviceContext,
    play: Callable[[Transaction[Any]], Any],
) -> Values:
    """What the device has of the setting that a command writes, where one element of a vector is named."""
    try:
        if command is None or not names_elements(wish.pairs, command.arguments):
            return {}
    except ComposeError:  # fields of another form of it: told when it is composed
        return {}
    row = next((row for row in driver.settings(known) if row.write == command.name), None)
    return {} if row is None else await play(driver.read(row.name, known))


def _continues(tongue: ProtocolComposer, command: Command, wish: SendRequest, known: DeviceContext) -> bool:
    """Does it take up what an earlier command began, which asking the device who it is would discard?"""
    try:
        _, values = frame_of(tongue, wish.message, wish.pairs, known)
    except ComposeError:  # in the form of another product, perhaps: said when the product is known
        return False
    body = tongue.driver.run(command.name, values, known)
    return isinstance(body, RequiresState) and body.continues


async def _setting_wish(
    tongue: ProtocolComposer,
    setting: Setting,
    wish: SendRequest,
    known: DeviceContext,
    play: Callable[[Transaction[Any]], Any],
    out: TextIO,
    notes: TextIO,
) -> None:
    """Read a setting, or write the fields that are given."""
    driver = tongue.driver
    if not wish.pairs:
        _print(out, {"setting": setting.name, "fields": await play(driver.read(setting.name, known))})
        return
    if not setting.write:
        raise SendError(f"{setting.name} can be read, not written")
    present: Values = {}
    if names_elements(wish.pairs, setting.fields):
        present = await play(driver.read(setting.name, known))
    values = parse(wish.pairs, setting.fields, present)
    driver.setting_frames(setting.name, values, known)
    await _allow_write(driver, setting, values, wish, known, play)
    written = await play(driver.write(setting.name, values, known))
    if written.refused:
        raise SendError(f"{setting.name} was refused: {written.refused}")
    _print(out, {"setting": setting.name, "fields": written.got})
    if written.got is not None:
        _tell_altered(driver, setting, values, written.got, notes)


def _setting(driver: DeviceDriver, name: str, known: DeviceContext) -> Setting | None:
    return next((row for row in driver.settings(known) if row.name == name), None)


def _allow(row: Command, wish: SendRequest) -> None:
    """A dangerous one is sent only to who has said yes."""
    if row.caution and not wish.yes:
        raise SendError(f"{row.name}: {row.consequence or 'this can do harm.'} Add --yes to send it")


def _target(
    driver: DeviceDriver, command: Command, values: Values, known: DeviceContext
) -> tuple[Setting, Values] | None:
    """The setting that a command writes, and its values."""
    other = driver.instead(command.name, values, {}, known)
    if other is not None and other[1]:
        found = _setting(driver, other[0], known)
        return None if found is None else (found, other[1])
    for row in driver.settings(known):
        if row.write == command.name and command.kind == "set" and set(values) <= {one.name for one in row.fields}:
            return row, values
    return None


async def _allow_write(
    driver: DeviceDriver,
    setting: Setting,
    values: Values,
    wish: SendRequest,
    known: DeviceContext,
    play: Callable[[Transaction[Any]], Any],
) -> None:
    """What could cut the line, or do other harm, is written only for who has said yes: as on the page."""
    if wish.yes:
        return
    old: Values | None = None
    with contextlib.suppress(DeviceRejectedError):
        old = await play(driver.read(setting.name, known))
    found = dangers_of_write(driver, setting, old, values, known, restarts=False)
    if found:
        words = " ".join(dict.fromkeys(one.consequence or "This can do harm." for one in found))
        raise SendError(f"{setting.name}: {words} Add --yes to send it")


def _tell_altered(driver: DeviceDriver, setting: Setting, asked: Values, got: Values, notes: TextIO) -> None:
    """What a device made of the values (it rounds rates)."""
    for path in driver.same(setting.name, {name: asked[name] for name in asked if name in got}, got):
        have, wish = value_at(got, path), value_at(asked, path)
        notes.write(f"imuscope: {setting.name} {path} is not as asked: {have!r} instead of {wish!r}.\n")


def _print(out: TextIO, line: Values) -> None:
    out.write(json_text(line, default=str) + "\n")
    out.flush()
