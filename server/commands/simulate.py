"""Simulated device for other programs: `imuscope simulate xbus?product=MTi-680G (--pty PATH | --tcp :PORT)`.

    $ imuscope simulate xbus?product=MTi-680G --pty /tmp/imu
    MTi-680G at /tmp/imu (/dev/pts/5), 115200 Bd. Ctrl-C ends it.

The device is the same as of `imuscope sim:xbus`, with the same options (server/links/simulator.py), behind a real
pseudo-terminal: PATH is a symbolic link to it, and a program that opens it at the wrong baud rate receives noise. TCP
has no baud rate; several clients, in turn or at once, can send to the device, and all of them receive its bytes. The
device is switched on from the start and keeps its settings until the command ends.
"""

import asyncio
import contextlib
import os
import termios
from pathlib import Path
from typing import TextIO

from imuscope.protocols.registry.families import PROTOCOLS
from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.errors import UsageError
from imuscope.server.links.base import LinkError
from imuscope.server.links.simulated_device import SimulatorOptions, make_device
from imuscope.server.links.simulator import SimulatorThread
from imuscope.server.links.source_url import SourceUrl
from imuscope.server.system.end_signals import end_signals

PREFIX = "sim:"
RATE_POLL_S = 0.05  # delay until the TCP side follows a new baud rate of the device
MAX_WAITING = 1 << 20  # bytes queued for a TCP client; a client further behind is disconnected


def options_of(text: str) -> SimulatorOptions:
    """Options of the device that the user named, such as "xbus?product=MTi-680G".

    Raises:
        UsageError: unknown device, or an invalid option.
    """
    try:
        return SimulatorOptions.of(SourceUrl.parse(text if text.startswith(PREFIX) else PREFIX + text))
    except LinkError as error:
        raise UsageError(str(error).replace(PREFIX, "")) from None


def options_of_family(protocol: str) -> set[str]:
    """Names of the decode options of a protocol."""
    return {option.name for option in PROTOCOLS[protocol].decoding.options}


def simulate(
    options: SimulatorOptions, reading: DecodeOptions, pty: Path | None, tcp: tuple[str, int] | None, out: TextIO
) -> None:
    """Run the device until a signal ends it.

    Args:
        reading: decode options, for a key.
        pty: path of the symbolic link to the port.
        tcp: (host, port) to listen on, if there is no `pty`.
        out: stream on which the address of the device is printed.

    Raises:
        UsageError: the link cannot be created, or the address cannot be used.
    """
    simulator_thread = SimulatorThread(lambda start_ns: make_device(options, start_ns, reading.values), options)
    try:
        asyncio.run(_run(simulator_thread, options, pty, tcp, out))
    finally:
        simulator_thread.stop()
        if pty is not None and _points_to(pty, simulator_thread.slave):
            pty.unlink()


async def _run(
    simulator_thread: SimulatorThread,
    options: SimulatorOptions,
    pty: Path | None,
    tcp: tuple[str, int] | None,
    out: TextIO,
) -> None:
    ended = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in end_signals():
        loop.add_signal_handler(number, ended.set)
    baud = options.faults.baud or 115_200
    set_rate(simulator_thread.slave, baud)
    bridge = Bridge(simulator_thread) if tcp is not None else None
    simulator_thread.release()  # so that it notices which program opens the port
    where = f"{pty} ({simulator_thread.slave})"
    if bridge is not None and tcp is not None:
        where = f"tcp://{await bridge.listen(*tcp)}"
    simulator_thread.start()
    if pty is not None:
        _link(pty, simulator_thread.slave)  # last, so that a program waiting for it finds a running device
    name = options.product or options.protocol.upper()
    print(f"{name} at {where}, {baud} Bd. Ctrl-C ends it.", file=out, flush=True)
    await ended.wait()
    if bridge is not None:
        await bridge.close()


class Bridge:
    """Carries bytes between the port of a simulator and TCP clients; the port follows the device's baud rate."""

    def __init__(self, simulator_thread: SimulatorThread) -> None:
        self._simulator = simulator_thread
        self._port = os.open(simulator_thread.slave, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        self._clients: set[asyncio.StreamWriter] = set()
        self._server: asyncio.Server | None = None
        self._follower: asyncio.Task[None] | None = None

    async def listen(self, host: str, port: int) -> str:
        """Start listening; returns the HOST:PORT to which clients connect.

        Raises:
            UsageError: the address is in use, or is not an address of this machine.
        """
        try:
            self._server = await asyncio.start_server(self._serve, host or "127.0.0.1", port)
        except OSError as error:
            raise UsageError(f"Cannot listen on {host or '127.0.0.1'}:{port}: {error.strerror}.") from None
        loop = asyncio.get_running_loop()
        loop.add_reader(self._port, self._from_device)
        self._follower = loop.create_task(self._follow(), name="rate of the port")
        name, number = self._server.sockets[0].getsockname()[:2]
        return f"{name}:{number}"

    async def close(self) -> None:
        """Disconnect all clients."""
        asyncio.get_running_loop().remove_reader(self._port)
        if self._follower is not None:
            self._follower.cancel()
        for client in list(self._clients):
            client.close()
        if self._server is not None:
            self._server.close()
        os.close(self._port)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._clients.add(writer)
        with contextlib.suppress(OSError):
            while data := await reader.read(4096):
                await self._to_device(data)
        self._clients.discard(writer)
        writer.close()

    async def _to_device(self, data: bytes) -> None:
        while data:
            try:
                data = data[os.write(self._port, data) :]
            except BlockingIOError:
                await asyncio.sleep(0.001)

    def _from_device(self) -> None:
        try:
            data = os.read(self._port, 4096)
        except OSError:
            return
        for client in list(self._clients):
            if client.transport.get_write_buffer_size() > MAX_WAITING:
                self._clients.discard(client)
                client.transport.abort()
            else:
                client.write(data)

    async def _follow(self) -> None:
        known = 0
        while True:
            device = self._simulator.device
            if device is not None and device.baud != known:
                known = device.baud
                set_rate(self._simulator.slave, known)
            await asyncio.sleep(RATE_POLL_S)


def set_rate(port: str, baud: int) -> None:
    """Set the baud rate of a terminal, if it supports that rate."""
    speed = getattr(termios, f"B{baud}", None)
    if speed is None:
        return
    handle = os.open(port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    try:
        settings = termios.tcgetattr(handle)
        settings[4] = settings[5] = speed
        termios.tcsetattr(handle, termios.TCSANOW, settings)
    finally:
        os.close(handle)


def _link(path: Path, port: str) -> None:
    """Create a symbolic link to the port, replacing a link of an earlier run."""
    try:
        if path.is_symlink() and os.readlink(path).startswith("/dev/pts/"):
            path.unlink()
        path.symlink_to(port)
    except FileExistsError:
        raise UsageError(f"{path} exists and is not a link to a port. Choose another path.") from None
    except OSError as error:
        raise UsageError(f"{path} cannot be created: {error.strerror}.") from None


def _points_to(path: Path, port: str) -> bool:
    try:
        return os.readlink(path) == port
    except OSError:
        return False
