"""Source of messages: a server of the Foxglove WebSocket protocol, such as foxglove_bridge or another imuscope.

    foxglove://robot.local:8765                       every topic with numbers
    foxglove://robot.local:8765/imu/data,/fix         these topics

    from the server   text: serverInfo; advertise, unadvertise; status
                      binary: u8 opcode 1 │ u32 subscription id │ u64 log time, ns │ payload          little-endian
    to the server     text: subscribe {subscriptions: [{id, channelId}]}

A thread of its own receives, so that arrival times do not depend on the load of the server. The protocol has no
sequence numbers: what such a server leaves out for a slow client cannot be counted.

Another imuscope serves this protocol at /foxglove, which is tried if there is none at /. If that asks for a token, it
is read from the environment variable IMUSCOPE_FOXGLOVE_TOKEN.

Source: Foxglove WebSocket protocol v1 (foxglove/ws-protocol, docs/spec.md).
"""

import asyncio
import base64
import binascii
import contextlib
import json
import os
import socket
import struct
import threading
from collections.abc import Mapping
from concurrent.futures import Future
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from imuscope.protocols.messages.decoder import reader_of
from imuscope.protocols.messages.records import MessageChannel
from imuscope.server.links.base import Link, LinkError, LinkSettings, Progress
from imuscope.server.links.message_link import (
    NO_NUMBERS,
    MessageLink,
    SeenTopic,
    TopicSource,
    missing_topic,
    nameless,
    other_type,
)
from imuscope.server.links.registry import LinkDefinition, register_link
from imuscope.server.links.source_url import SourceUrl
from imuscope.server.links.text import is_ours, progress_line

if TYPE_CHECKING:
    from websockets.asyncio.client import ClientConnection

DEFAULT_PORT = 8765
SUBPROTOCOLS = ("foxglove.sdk.v1", "foxglove.websocket.v1")
OWN_PATH = "/foxglove"  # of another imuscope
PATHS = ("/", OWN_PATH)
TOKEN = "IMUSCOPE_FOXGLOVE_TOKEN"
MAX_MESSAGE_BYTES = 64 << 20  # bytes of a message; images and clouds are not subscribed to
PING_S = 5.0
CLOSE_S = 1.0  # for the server to answer the closing of the connection
CLOSING_TURNS = 8  # of the event loop, in which a connection that was broken off releases its socket
PORT_HINT = "Check the port: foxglove_bridge has 8765 by default, another imuscope the port of its page."
TOKEN_KINDS = ("no-token", "bad-token")
LOCAL_HOSTS = ("localhost", "127.0.0.1", "::1")
DATA = struct.Struct("<BIQ")
MESSAGE_DATA = 1
SCHEMA_ENCODINGS = {"json": "jsonschema", "protobuf": "protobuf", "cdr": "ros2msg"}


@dataclass(slots=True)
class _Advertised:
    """A channel of the server, and why it is not shown; "" if it is."""

    topic: SeenTopic
    channel: int
    reason: str = ""


class FoxgloveLink(MessageLink):
    """A connection to a Foxglove server."""

    kind = "foxglove"

    def __init__(self, source: str, settings: LinkSettings, where: TopicSource) -> None:
        super().__init__(source, settings, where)
        self._advertised: dict[int, _Advertised] = {}  # by the server's id
        self._channels: dict[int, int] = {}  # subscription → our channel
        self._thread: threading.Thread | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._task: asyncio.Task[None] | None = None
        self._connected = False

    async def open(self, progress: Progress | None = None) -> None:
        await self.close()
        self._advertised, self._channels, self._connected = {}, {}, False
        self.begin()
        opened: Future[str] = Future()
        self._thread = threading.Thread(target=self._main, args=(opened,), name=f"link {self.source}", daemon=True)
        self._thread.start()
        try:
            server = await self._opened(opened)
        except LinkError as error:
            await self.close()
            progress_line(progress, self.where.place, error.message)
            raise
        self._connected = True
        progress_line(progress, self.where.place, f"connected to {server}" if server else "connected")

    async def _opened(self, opened: Future[str]) -> str:
        """Wait for the greeting of the server; returns its name."""
        try:
            async with asyncio.timeout(2 * self.settings.connect_timeout_s):
                return await asyncio.shield(asyncio.wrap_future(opened))
        except TimeoutError:
            words = f"{self.where.place} speaks another version of the Foxglove protocol, or none."
            raise LinkError("refused", words, "Check the port, and update the program there.") from None

    @property
    def notices(self) -> list[str]:
        """Reasons why topics are not shown, by what the server has at present."""
        if not self._connected:
            return []
        channels = list(self._advertised.values())
        topics = [one.topic for one in channels]
        reasons = [one.reason for one in channels if one.reason and self._is_requested(one.topic.name)]
        if absent := [name for name in self.where.topics if all(topic.name != name for topic in topics)]:
            reasons.append(missing_topic(absent, sorted(topics, key=lambda one: one.name), self.where.place))
        elif not self.where.topics and not any(one.channel for one in channels):
            reasons.append(nameless(topics))
        return reasons

    @notices.setter
    def notices(self, notices: list[str]) -> None:
        """Ignore notices: they are made on request."""

    def _is_requested(self, topic: str) -> bool:
        return topic in self.where.topics

    # -- the thread ----------------------------------------------------------------------------------------------------

    def _main(self, opened: Future[str]) -> None:
        with contextlib.suppress(asyncio.CancelledError):  # closed while it ended by itself
            asyncio.run(self._run(opened))

    async def _run(self, opened: Future[str]) -> None:
        """Receive, and let the connection release its socket."""
        try:
            await self._receive(opened)
        finally:
            for _ in range(CLOSING_TURNS):
                with contextlib.suppress(asyncio.CancelledError):  # closed while it was ending by itself
                    await asyncio.sleep(0)

    async def _receive(self, opened: Future[str]) -> None:
        """Connect, then receive until the connection ends."""
        from websockets.exceptions import ConnectionClosed

        self._loop, self._task = asyncio.get_running_loop(), asyncio.current_task()
        try:
            async with asyncio.timeout(self.settings.connect_timeout_s):
                connection = await self._connect()
        except LinkError as error:
            opened.set_exception(error)
            return
        except TimeoutError:
            seconds = self.settings.connect_timeout_s
            hint = "Check that the host is switched on and in this network. A firewall may drop the request."
            words = f"{self.where.place} did not answer within {seconds:g} s."
            opened.set_exception(LinkError("refused", words, hint))
            return
        except asyncio.CancelledError:
            opened.set_exception(LinkError("gone", f"The link to {self.source} is closed.", "Open it again."))
            return
        try:
            async with connection:
                async for message in connection:
                    if isinstance(message, bytes):
                        self._on_data(message)
                    else:
                        await self._on_text(connection, message, opened)
                raise LinkError("gone", f"{self.where.place} closed the connection.", "It is connected again.")
        except ConnectionClosed as closed:
            self._end(opened, LinkError("gone", self._closed_text(closed), "It is connected again when it answers."))
        except LinkError as error:
            self._end(opened, error)
        except asyncio.CancelledError:
            pass
        finally:
            connection.transport.abort()  # also if the server did not answer the closing of the connection

    def _end(self, opened: Future[str], error: LinkError) -> None:
        if not opened.done():
            opened.set_exception(error)
        self.fail(error)

    def _closed_text(self, closed: Exception) -> str:
        code = getattr(getattr(closed, "sent", None), "code", 0)
        if code == 1009:
            return f"{self.where.place} sent a message of more than {MAX_MESSAGE_BYTES >> 20} MB."
        return f"The connection to {self.where.place} broke."

    async def _connect(self) -> "ClientConnection":
        """Connect, at the first path that has the protocol.

        Raises:
            LinkError: it cannot be connected to.
        """
        from websockets.asyncio.client import connect
        from websockets.exceptions import InvalidHandshake, InvalidStatus
        from websockets.typing import Subprotocol

        host = f"[{self.where.host}]" if ":" in self.where.host else self.where.host
        token = os.environ.get(TOKEN, "")
        refusal = LinkError("refused", f"No Foxglove server answers at {self.where.place}.", PORT_HINT)
        for path in PATHS:
            try:
                connection = await connect(
                    f"ws://{host}:{self.where.port}{path}",
                    subprotocols=[Subprotocol(name) for name in SUBPROTOCOLS],
                    compression=None,
                    max_size=MAX_MESSAGE_BYTES,
                    proxy=None,
                    ping_interval=PING_S,
                    ping_timeout=PING_S,
                    close_timeout=CLOSE_S,
                    user_agent_header="imuscope",
                    additional_headers={"Authorization": f"Bearer {token}"} if token else None,
                )
            except InvalidStatus as error:
                if (words := _words_of(error.response.body)) is not None:
                    refusal = self._no_token() if words[0] in TOKEN_KINDS else self._refused(words[1], words[2])
                continue
            except InvalidHandshake:
                continue
            except socket.gaierror as error:
                raise self._no_host(error) from None
            except ConnectionRefusedError:
                raise LinkError("refused", f"Nothing listens at {self.where.place}.", PORT_HINT) from None
            except (OSError, EOFError) as error:
                reason = getattr(error, "strerror", None) or "the connection broke"
                raise LinkError("refused", f"{self.where.place} cannot be reached: {reason}.", PORT_HINT) from None
            if connection.subprotocol is not None and not (path == OWN_PATH and self._is_own()):
                return connection
            await connection.close()
            if connection.subprotocol is not None:  # its devices would be its own source, again and again
                raise self._own_server()
        raise refusal

    def _refused(self, message: str, hint: str) -> LinkError:
        return LinkError("refused", f"{self.where.place} answers: {message}", hint or PORT_HINT)

    def _no_token(self) -> LinkError:
        words = f"{self.where.place} asks for a token."
        return LinkError("denied", words, f"Set {TOKEN} to a view token of that server.")

    def _no_host(self, error: socket.gaierror) -> LinkError:
        hint = "Check the spelling, or give the address as numbers."
        return LinkError("not-found", f"Host {self.where.host!r} not found ({error.strerror}).", hint)

    def _own_server(self) -> LinkError:
        hint = "Its devices are shown already. Give the address of another one."
        return LinkError("bad-source", f"{self.where.place} is this server itself.", hint)

    def _is_own(self) -> bool:
        return self.where.host in LOCAL_HOSTS and is_ours(self.where.port)

    async def _on_text(self, connection: "ClientConnection", text: str, opened: Future[str]) -> None:
        try:
            message = json.loads(text)
            match message["op"]:
                case "serverInfo":
                    if not opened.done():
                        opened.set_result(str(message.get("name", ""))[:80])
                case "advertise":
                    channels = [one for one in message["channels"] if self._advertise(one)]
                    if channels:
                        subscriptions = [{"id": one["id"], "channelId": one["id"]} for one in channels]
                        await connection.send(json.dumps({"op": "subscribe", "subscriptions": subscriptions}))
                case "unadvertise":
                    for number in message["channelIds"]:
                        self._advertised.pop(number, None)
                        self._channels.pop(number, None)
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            return  # not of the protocol; a server that sends nothing valid has no topics

    def _advertise(self, about: Mapping[str, Any]) -> bool:
        """Take note of a channel; True to subscribe to it."""
        number = about["id"]
        if type(number) is not int or not 0 <= number < 1 << 32 or number in self._channels:
            return False
        topic = SeenTopic(str(about["topic"])[:256], str(about.get("schemaName", ""))[:256])
        one = self._advertised[number] = _Advertised(topic, 0)
        is_requested = self._is_requested(topic.name)
        if self.where.topics and not is_requested:
            return False
        if self.where.type and topic.type != self.where.type:
            one.reason = other_type(topic, self.where.type)
            return False
        if not is_requested and topic.type in NO_NUMBERS:
            return False
        encoding = str(about["encoding"])
        schema_encoding = str(about.get("schemaEncoding") or SCHEMA_ENCODINGS.get(encoding, ""))
        schema = _schema(schema_encoding, about.get("schema", ""))
        if reader_of(MessageChannel(0, topic.name, encoding, topic.type, schema_encoding, schema)) is None:
            one.reason = f"{topic.name} is {encoding} ({schema_encoding or 'no schema'}), which cannot be read."
            return False
        one.channel = self.channel(topic.name, encoding, topic.type, schema_encoding, schema)
        self._channels[number] = one.channel
        return one.channel > 0

    def _on_data(self, data: bytes) -> None:
        if len(data) < DATA.size or data[0] != MESSAGE_DATA:
            return
        arrival_ns = self.settings.now_ns()
        _, subscription, time_ns = DATA.unpack_from(data)
        self.deliver(self._channels.get(subscription, 0), data[DATA.size :], arrival_ns, publish_ns=time_ns)

    async def _release(self) -> None:
        self._connected = False
        thread, self._thread = self._thread, None
        if thread is None:
            return
        is_cancelled = False
        while thread.is_alive():
            if not is_cancelled and self._loop is not None and self._task is not None:
                is_cancelled = True  # once: it must be able to close its connection
                with contextlib.suppress(RuntimeError):  # its loop has ended
                    self._loop.call_soon_threadsafe(self._task.cancel)
            await asyncio.to_thread(thread.join, 0.2)
        self._loop = self._task = None


def _words_of(body: bytes | bytearray | None) -> tuple[str, str, str] | None:
    """Kind, message and hint of an error of another imuscope; None for any other answer."""
    try:
        answer = json.loads(body or b"")
        return str(answer["kind"]), str(answer["message"])[:200], str(answer["hint"])[:200]
    except (ValueError, KeyError, TypeError, RecursionError):
        return None


def _schema(encoding: str, text: Any) -> bytes:
    """Bytes of a schema as advertised; binary ones are in base64."""
    if encoding in ("protobuf", "flatbuffer"):
        try:
            return base64.b64decode(str(text))
        except binascii.Error:
            return b""
    return str(text).encode(errors="replace")


def _open(source: str, settings: LinkSettings, parsed: SourceUrl) -> Link:
    parsed.allow(("type",))
    return FoxgloveLink(source, settings, TopicSource.parse(parsed, DEFAULT_PORT))


register_link(
    LinkDefinition(
        "foxglove",
        "Foxglove",
        _open,
        "foxglove://host:port/topic",
        usage=(("foxglove://host:8765/topic", "messages of a Foxglove server, another imuscope's too; no topic: all"),),
        examples=lambda: [("foxglove://robot.local:8765/imu/data", "a topic of a Foxglove server")],
        order=36,
        network=True,
    )
)
