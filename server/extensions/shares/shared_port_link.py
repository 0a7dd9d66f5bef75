"""Link to a port that a holder keeps open and shares (server/extensions/shares/holder).

    holder ── Unix socket ──> SharedPortLink ──> session

The holder is started when it is not there yet, and stays when this server ends. Arrival times are those of the holder,
which stamps right after it read. What the clients of the shares send is passed on to `on_client_data`.
"""

import asyncio
import contextlib
import json
import os
import socket
import subprocess
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from imuscope.server.concurrency.listeners import CallbackList
from imuscope.server.extensions.shares import relay_kernel
from imuscope.server.extensions.shares.holder.messages import (
    CLIENT,
    STAMP,
    VERSION,
    MessageError,
    MessageKind,
    MessageReader,
    json_message,
    message,
)
from imuscope.server.extensions.shares.holder.settings import HolderSettings
from imuscope.server.extensions.shares.holder.shares import ShareAddress
from imuscope.server.extensions.shares.holder.socket_paths import cause_of_end, log_of, socket_of, sockets_of
from imuscope.server.links.base import Chunk, LinkError, LinkSettings, Progress
from imuscope.server.links.reader_thread import READ_BYTES, ThreadedLink, closed, write_all
from imuscope.server.links.serial import PARITIES, SerialLink, cannot_open, latency_notices
from imuscope.server.links.tcp import TcpLink

ROOT = Path(__file__).absolute().parents[4]  # holds imuscope/
GREETING_S = 5.0  # until a holder that runs says who it is
START_S = 30.0  # until one that was started does, from a slow card beside other work
SILENT_S = 8.0  # more than it is busy with opening a port, for which it waits at most 5 s
CONNECT_ATTEMPTS, CONNECT_PAUSE_S = 10, 0.05
ANSWER_S = 12.0  # until a request is carried out or refused; a client that has the voice delays it by 10 s


@dataclass(frozen=True, slots=True)
class ClientData:
    """Bytes that a client of a share sent to the device; arrival as Chunk.arrival_ns."""

    client: int
    peer: str
    data: bytes
    arrival_ns: int


class SharedPortLink(ThreadedLink):
    """A port that is shared.

    Args:
        inner: the link that would open the port itself: serial or TCP.
        shares: what the port is handed on as.

    Attributes:
        state: last state of the holder (server/extensions/shares/holder/process.py), {} before the first.
        names: of clients by number, where they are known better than by their address.
        on_state, on_client_data: called in the event loop.
    """

    def __init__(self, inner: SerialLink | TcpLink, shares: Sequence[ShareAddress], settings: LinkSettings) -> None:
        super().__init__(inner.source, settings)
        self.kind = inner.kind
        self.shares = list(shares)
        self.state: Mapping[str, Any] = {}
        self.on_state: CallbackList[[Mapping[str, Any]]] = CallbackList()
        self.on_client_data: CallbackList[[ClientData]] = CallbackList()
        self.names: dict[int, str] = {}
        self._inner = inner
        self._connection: socket.socket | None = None
        self._messages = MessageReader()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._requests: dict[int, asyncio.Future[int | None]] = {}
        self._answers: deque[Mapping[str, Any]] = deque()  # from the reading thread to the event loop
        self._numbers = 0
        self._offset_ns = 0  # from the monotonic clock to the clock of arrivals
        self._frames = "", ""
        self.holder_pid = 0
        self._holder_socket = ""
        self._busy_with = 0  # process of the server that the holder has, if it refused this one
        self._sending = asyncio.Lock()
        self._last_message_s = 0.0
        self._timer: asyncio.TimerHandle | None = None

    @property
    def is_connected(self) -> bool:
        return self._connection is not None

    @property
    def inner(self) -> SerialLink | TcpLink:
        """The link that opens the port itself, for when it is shared no longer."""
        return self._inner

    @property
    def detects_baud(self) -> bool:
        return self._inner.detects_baud

    @property
    def local_path(self) -> str:
        return self._inner.local_path

    @property
    def place(self) -> str:
        """Identity of the port, for its socket."""
        return place_of(self._inner)

    # ── opening ──────────────────────────────────────────────────────────────────────────────────────────────────────

    async def open(self, progress: Progress | None = None) -> None:
        await self.close()
        self._loop = asyncio.get_running_loop()
        connection, first = await self._connected_at_last(self._sockets(), progress)
        self._holder_socket = connection.getpeername()
        self._connection = connection
        self._offset_ns = self.settings.now_ns() - time.monotonic_ns()
        self._take_state(first)
        if not self.state["open"]:
            await self.close()
            raise self._port_error()
        if isinstance(self._inner, SerialLink):
            self.notices = latency_notices(self.place, self.settings.sys_root)
        connection.setblocking(False)
        self._start(connection.fileno(), self._on_readable)
        self._last_message_s = time.monotonic()
        self._watch()
        offered = {one["text"] for one in self.state["shares"]}
        for share in self.shares:
            if share.text not in offered:
                await self.request("share", share=share.to_json())
        if self._frames[0]:
            await self.request("frames", module=self._frames[0], configuration=self._frames[1])

    async def _connected_at_last(
        self, paths: Sequence[Path], progress: Progress | None
    ) -> tuple[socket.socket, Mapping[str, Any]]:
        """As `_connected`. A holder that ends, or still has an earlier connection of this server, gets the request
        again.
        """
        for _ in range(CONNECT_ATTEMPTS):
            try:
                return await self._connected(paths, progress)
            except (LinkError, ConnectionError) as error:
                if isinstance(error, LinkError) and not self._busy_with == os.getpid():
                    raise
            await asyncio.sleep(CONNECT_PAUSE_S)
        return await self._connected(paths, progress)

    async def _connected(
        self, paths: Sequence[Path], progress: Progress | None
    ) -> tuple[socket.socket, Mapping[str, Any]]:
        """A connection to the holder, which is started if necessary, and its state.

        Raises:
            LinkError: there is no holder, and none can be started.
            ConnectionError: the holder ended.
        """
        self._busy_with = 0
        connection = await asyncio.to_thread(_connect, *paths)
        if connection is None:
            await self._start_holder(progress)
            connection = await asyncio.to_thread(_connect, *paths)
        if connection is None:
            raise LinkError("gone", f"The holder of {self.source} does not answer.", "It is started again.")
        try:
            return connection, await asyncio.to_thread(self._read_greeting, connection)
        except (LinkError, ConnectionError):
            connection.close()
            raise
        except (OSError, MessageError, ValueError) as problem:
            connection.close()
            raise LinkError("gone", f"The holder of {self.source} does not answer: {problem}.", "Retry.") from None

    def _sockets(self) -> list[Path]:
        try:
            return sockets_of(self.place)
        except OSError as error:
            raise LinkError("denied", f"{self.source} cannot be shared: {error}.", "Correct it, then retry.") from None

    async def _start_holder(self, progress: Progress | None) -> None:
        """Start a holder, after the rate was detected if it is not known.

        Raises:
            LinkError: the port cannot be opened, or a share cannot be offered.
        """
        inner = self._inner
        if isinstance(inner, SerialLink):
            try:
                await inner.open(progress)  # errors of the port are reported as without a holder
            except LinkError:
                if inner.line.baud is None or os.path.exists(inner.place):
                    raise  # else the holder waits for the port, and programs have it as soon as it is plugged in
            else:
                baud = inner.baud
                await inner.close()
                inner.line = replace(inner.line, baud=baud)
        await asyncio.to_thread(_run_holder, holder_settings(inner, self.shares))

    def _read_greeting(self, connection: socket.socket) -> Mapping[str, Any]:
        """The first state of the holder; in a thread."""
        self._messages = MessageReader()
        connection.settimeout(GREETING_S)
        while data := connection.recv(READ_BYTES):
            for kind, body in self._messages.feed(data):
                if kind == MessageKind.HELLO:
                    hello = json.loads(body)
                    if hello["version"] != VERSION:
                        raise MessageError("it is of another version of imuscope; stop it, then retry")
                    self.holder_pid = int(hello["pid"])
                    self._busy_with = int(hello["busy"])
                    if self._busy_with:
                        hint = "Open the page of that one, or stop it."
                        text = f"{self.source} is held for another imuscope (process {hello['busy']})."
                        raise LinkError("busy", text, hint)
                if kind == MessageKind.STATE:
                    greeting: Mapping[str, Any] = json.loads(body)
                    return greeting
        raise ConnectionResetError("it ended")

    def _take_state(self, state: Mapping[str, Any]) -> None:
        self.state = state
        self.baud = state["baud"]
        if isinstance(self._inner, SerialLink) and self.baud:
            self.capacity = self._inner.line.capacity(self.baud)

    def _port_error(self) -> LinkError:
        number, text = self.state["errno"], self.state["error"]
        if isinstance(self._inner, SerialLink):
            return cannot_open(self.place, self._inner.line, OSError(number, text))
        return LinkError("refused", f"{self.source} is not reachable: {text}.", "Check the device and the network.")

    # ── reading ──────────────────────────────────────────────────────────────────────────────────────────────────────

    def _on_readable(self) -> None:
        assert self._queue is not None
        assert self._connection is not None
        try:
            data = self._connection.recv(READ_BYTES)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            raise self._ended()
        try:
            for kind, body in self._messages.feed(data):
                self._on_message(kind, body)
        except (MessageError, ValueError, KeyError) as error:
            raise LinkError("gone", f"The holder of {self.source} sent nonsense: {error}.", "Retry.") from None

    def _watch(self) -> None:
        """Fail if the holder has sent nothing for a while: it reports its state once a second."""
        if time.monotonic() - self._last_message_s > SILENT_S:
            self.fail(self._does_not_answer())
        else:
            self._timer = asyncio.get_running_loop().call_later(1.0, self._watch)

    def _on_message(self, kind: MessageKind, body: bytes) -> None:
        """A message, in the reading thread."""
        assert self._queue is not None
        self._last_message_s = time.monotonic()
        if kind == MessageKind.DATA:
            (stamp,) = STAMP.unpack_from(body)
            self._queue.put(Chunk(body[STAMP.size :], stamp + self._offset_ns))
        elif kind == MessageKind.CLIENT_DATA:
            stamp, client = CLIENT.unpack_from(body)
            peer = next((one["peer"] for one in self.state["clients"] if one["number"] == client), "")
            self._in_loop(
                self.on_client_data.call, ClientData(client, peer, body[CLIENT.size :], stamp + self._offset_ns)
            )
        elif kind == MessageKind.STATE:
            was_open = self.state.get("open", True)
            self._take_state(json.loads(body))
            self._in_loop(self.on_state.call, self.state)
            if was_open and not self.state["open"]:
                raise self._port_error()
        elif kind == MessageKind.DONE:
            self._answers.append(json.loads(body))
            self._in_loop(self._take_answers)

    def _in_loop(self, function: Callable[..., None], *arguments: Any) -> None:
        assert self._loop is not None
        with contextlib.suppress(RuntimeError):  # the loop is closed already
            self._loop.call_soon_threadsafe(function, *arguments)

    # ── sending ──────────────────────────────────────────────────────────────────────────────────────────────────────

    async def write(self, data: bytes) -> int | None:
        stamp_ns = await self._transfer(lambda number: message(MessageKind.WRITE, number.to_bytes(4, "little") + data))
        return None if stamp_ns is None else stamp_ns + self._offset_ns

    async def request(self, do: str, **arguments: Any) -> None:
        """A request to the holder (server/extensions/shares/holder/process.py).

        Raises:
            LinkError: it cannot be carried out.
        """
        await self._transfer(lambda number: json_message(MessageKind.REQUEST, {"id": number, "do": do, **arguments}))

    async def _transfer(self, make: Callable[[int], bytes]) -> int | None:
        """Send a message and wait for its answer: of a write, its monotonic time in ns. LinkError: as `request`."""
        connection = self._connection
        if connection is None:
            raise closed(self.source)
        self._numbers += 1
        number = self._numbers
        answered = self._requests[number] = asyncio.get_running_loop().create_future()
        try:
            async with self._sending:
                await write_all(connection.fileno(), make(number))
            async with asyncio.timeout(ANSWER_S):
                stamp_ns: int | None = await answered
            return stamp_ns
        except TimeoutError:
            raise self._does_not_answer() from None
        except OSError:
            raise self._ended() from None
        finally:
            self._requests.pop(number, None)

    def _ended(self) -> LinkError:
        why = cause_of_end(self._holder_socket, self.holder_pid)
        hint = f"It is started again; {log_of(self._holder_socket)} has the details." if why else "It is started again."
        return LinkError("gone", f"The holder of {self.source} ended{f': {why}' if why else ''}.", hint)

    def _does_not_answer(self) -> LinkError:
        hint = f"If it does not recover, end its process: kill -9 {self.holder_pid}."
        return LinkError("gone", f"The holder of {self.source} does not answer.", hint)

    def name_of(self, client: int) -> str:
        """Name of a client, else its address; "" if it is not there."""
        peers = (str(one["peer"]) for one in self.state.get("clients", ()) if one["number"] == client)
        return self.names.get(client) or next(peers, "")

    @property
    def other_users(self) -> str:
        return ", ".join(self.name_of(one["number"]) or "a program" for one in self.state.get("clients", ()))

    def _is_busy(self) -> LinkError:
        state = self.state
        name = self.name_of(state.get("speaker") or 0)
        who = f"The client {name}" if name else "Another program"
        does = "configuring the device at" if state.get("configuring") is not None else "talking to"
        takes_over = state.get("configuring") is not None
        hint = f"Wait until it has finished, or {'take over' if takes_over else 'end it'} under Share port."
        return LinkError("busy", f"{who} is {does} {self.source}.", hint)

    def _take_answers(self) -> None:
        """Pass on the answers received so far. Idempotent."""
        while self._answers:
            self._on_done(self._answers.popleft())

    def _on_done(self, body: Mapping[str, Any]) -> None:
        answered = self._requests.get(int(body["id"]))
        if answered is None or answered.done():
            return
        if body.get("kind") == "busy":
            answered.set_exception(self._is_busy())
        elif body.get("error"):
            answered.set_exception(
                LinkError(body["kind"], f"{self.source}: {body['error']}.", "Correct it, then retry.")
            )
        else:
            answered.set_result(body.get("at"))

    def hold_clients(self, on: bool) -> None:
        if self._connection is not None:
            task = asyncio.get_running_loop().create_task(self.request("lock" if on else "unlock"), name="voice")
            task.add_done_callback(lambda done: done.cancelled() or done.exception())

    def use_frames(self, frames: str, configuration: str) -> None:
        if (frames, configuration) != self._frames:
            self._frames = frames, configuration
            if self._connection is not None:
                request = self.request("frames", module=frames, configuration=configuration)
                task = asyncio.get_running_loop().create_task(request, name="frames")
                task.add_done_callback(lambda done: done.cancelled() or done.exception())

    # ── the rate ─────────────────────────────────────────────────────────────────────────────────────────────────────

    async def reopen(self, baud: int | None = None) -> None:
        if self._connection is None:
            await self.open()
        if baud is not None:
            await self.request("baud", baud=baud)
            self.baud = baud
            if isinstance(self._inner, SerialLink):
                self._inner.line = replace(self._inner.line, baud=baud)
                self.capacity = self._inner.line.capacity(baud)
        if self._queue is not None:
            while self._queue.take_now(0):  # bytes of the former rate
                pass

    async def check_rate(self, baud: int) -> None:
        await self.request("try", baud=baud)

    async def _release(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        connection, self._connection = self._connection, None
        if connection is not None:
            connection.close()
        self._take_answers()  # a holder that ends on request answers first; its end may be noticed before the answer
        for answered in self._requests.values():
            if not answered.done():
                answered.set_exception(closed(self.source))
        self._requests.clear()


def place_of(link: SerialLink | TcpLink) -> str:
    """Identity of the port of a link (places.socket_of)."""
    return link.place if isinstance(link, SerialLink) else f"tcp://{link.host}:{link.port}"


def is_held(link: SerialLink | TcpLink) -> bool:
    """Whether a holder has the port of a link: it answers at its socket."""
    try:
        connection = _connect(*sockets_of(place_of(link)))
    except OSError:
        return False
    if connection is not None:
        connection.close()
    return connection is not None


def holder_settings(
    link: SerialLink | TcpLink, shares: Sequence[ShareAddress], *, stay: bool = False
) -> HolderSettings:
    """Settings of a holder of the port of a link.

    Raises:
        OSError: there is no folder for its socket.
    """
    about = _source_of(link), str(socket_of(place_of(link))), tuple(shares)
    return HolderSettings(*about, stay=stay, kernel=relay_kernel.place() or ())


def _connect(*paths: Path) -> socket.socket | None:
    """A connection to the first of these sockets at which a holder answers; None: at none."""
    for path in paths:
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        connection.settimeout(GREETING_S)
        try:
            connection.connect(str(path))
        except OSError:
            connection.close()
        else:
            return connection
    return None


def _run_holder(settings: HolderSettings) -> None:
    """Start a holder that outlives this process; it answers when this returns.

    Raises:
        LinkError: it ended: why.
    """
    try:
        done = subprocess.run(
            settings.command,
            cwd=ROOT,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            start_new_session=True,
            timeout=START_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise LinkError("gone", "The holder of the port did not start.", "Retry.") from None
    if done.returncode:
        why = done.stderr.decode(errors="replace").strip().splitlines()
        text = why[-1].removeprefix("imuscope hold: ") if why else "it ended at once"
        raise LinkError("refused", f"The port cannot be shared: {text}.", "Correct it, then retry.")


def _source_of(inner: SerialLink | TcpLink) -> dict[str, Any]:
    if isinstance(inner, TcpLink):
        return {"kind": "tcp", "host": inner.host, "port": inner.port}
    line = inner.line
    about = {"kind": "serial", "place": inner.place, "baud": line.baud, "parity": PARITIES[line.parity]}
    return {**about, "bits": line.bits, "stop": line.stop, "flow": line.flow}
