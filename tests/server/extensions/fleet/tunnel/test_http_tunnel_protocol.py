"""Streams of pages between both ends of a real line: long answers, slow viewers, viewers that leave, silence."""

import asyncio
import hashlib
import re
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Any

import msgspec
import pytest

from imuscope.server.access.route_rules import RouteRules
from imuscope.server.errors import DomainError
from imuscope.server.extensions.fleet.model.access import RouterSettings
from imuscope.server.extensions.fleet.model.bus import BusCredentials, client_settings, open_bus
from imuscope.server.extensions.fleet.model.reports import RobotStatus
from imuscope.server.extensions.fleet.model.summaries import summary_of
from imuscope.server.extensions.fleet.tunnel import http_tunnel_robot, http_tunnel_server
from imuscope.server.extensions.fleet.tunnel.flow_control import MAX_WINDOW_BYTES, MIN_WINDOW_BYTES, Window
from imuscope.server.extensions.fleet.tunnel.http_tunnel_protocol import (
    MAX_PART,
    CancelStream,
    EndStream,
    KeepAlive,
    OpenStream,
    ResponseHead,
    ResponsePart,
    encode,
)
from imuscope.server.extensions.fleet.tunnel.http_tunnel_robot import PageServer
from imuscope.server.extensions.fleet.tunnel.http_tunnel_server import PageStream, RobotPages
from tests.support.each_row import each_row
from tests.support.free_ports import free_port
from tests.support.waiting import until

BOOT = "0123456789abcdef"
LONG_BODY = b"".join(hashlib.sha256(bytes([i % 251, i // 251])).digest() for i in range(60_000))  # 1.9 MB


@dataclass
class Application:
    """What a robot answers with, in place of its page."""

    began: list[str] = field(default_factory=list)
    ended: list[str] = field(default_factory=list)
    sent: int = 0
    carry_on: asyncio.Event = field(default_factory=asyncio.Event)

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        path = scope["path"].removeprefix("/api")
        self.began.append(path)
        try:
            if scope["type"] == "websocket":
                await self._socket(receive, send)
                return
            if path in ("/wait", "/command"):
                await self.carry_on.wait()
            headers = [(b"content-type", b"text/plain"), (b"set-cookie", b"a=b"), (b"location", b"/")]
            await send({"type": "http.response.start", "status": 200, "headers": headers})
            if path == "/endless":
                while True:
                    await send({"type": "http.response.body", "body": bytes(4096), "more_body": True})
                    self.sent += 4096
            await send({"type": "http.response.body", "body": LONG_BODY if path == "/long" else b"short"})
        finally:
            self.ended.append(path)

    async def _socket(self, receive: Any, send: Any) -> None:
        await receive()
        await send({"type": "websocket.accept", "subprotocol": "imuscope.v1"})
        while (message := await receive())["type"] == "websocket.receive":
            await send({"type": "websocket.send", "text": message["text"] * 3})
            await send({"type": "websocket.send", "bytes": LONG_BODY})


@dataclass
class Line:
    app: Application
    robot: PageServer
    fleet: RobotPages
    alive: list[bool]
    notices: list[str]

    def request(self, path: str, **others: Any) -> PageStream:
        request = OpenStream(
            0, BOOT, path=path, **{"method": "GET", "role": "control", "who": "operator at 10.0.0.5", **others}
        )
        return self.fleet.open("a", lambda number, boot: msgspec.structs.replace(request, stream=number, boot=boot))


@asynccontextmanager
async def line(delay_of: Callable[[int], float] = lambda size: 0.0) -> AsyncIterator[Line]:
    """A robot and a fleet server over a router."""
    bus = f"tcp/127.0.0.1:{free_port()}"
    router = await asyncio.to_thread(open_bus, RouterSettings(bus).settings())
    session = await asyncio.to_thread(open_bus, client_settings(bus, BusCredentials()))
    app, alive, report = Application(), [True], list[str]()
    known = {"a": summary_of("a", RobotStatus(), 0.0)}
    robot = PageServer("a", BOOT, "control", RouteRules(), lambda level, text: report.append(text), delay_of)
    fleet = RobotPages(lambda name: BOOT if alive[0] else "", known.get)
    held = [fleet.declare(router), robot.declare(session)]
    fleet.start()
    robot.serve(app)
    there = Line(app, robot, fleet, alive, report)
    try:
        await ready(there)
        yield there
    finally:
        await robot.close()
        fleet.close()
        for one in (session, router):
            await asyncio.to_thread(one.close)
        del held


async def ready(there: Line) -> None:
    """Wait until each side knows what the other has declared."""
    for _ in range(100):
        stream = there.request("/api/short")
        try:
            async with asyncio.timeout(0.5):
                await body(stream)
            await until(lambda: there.robot.streams == 0, "the first answer is over")
            there.app.began.clear()
            there.app.ended.clear()
            return
        except TimeoutError:
            continue
        finally:
            stream.close()
    raise AssertionError("the robot does not answer")


async def body(stream: PageStream) -> bytes:
    assert isinstance(await stream.next(), ResponseHead)
    data = b""
    while isinstance(part := await stream.next(), ResponsePart):
        data += part.data
        stream.acknowledge(len(part.data))
    assert isinstance(part, EndStream)
    stream.close()
    return data


async def test_a_long_answer_arrives_whole_beside_short_ones() -> None:
    async with line() as there:
        streams = [there.request("/api/long"), *(there.request("/api/short") for _ in range(10))]
        answers = await asyncio.gather(*map(body, streams))
        assert answers[0] == LONG_BODY
        assert set(answers[1:]) == {b"short"}
        await until(lambda: there.robot.streams == 0, "nothing is left at the robot")


async def test_cookies_and_redirections_of_a_robot_stay_there() -> None:
    async with line() as there:
        stream = there.request("/api/short")
        head = await stream.next()
        assert isinstance(head, ResponseHead)
        assert head.headers == (("content-type", "text/plain"),)
        stream.close()


async def test_a_viewer_that_takes_nothing_stops_the_robot_and_costs_no_memory() -> None:
    async with line() as there:
        stream = there.request("/api/endless")
        await until(lambda: there.app.sent > MIN_WINDOW_BYTES, "it begins")
        await body(there.request("/api/long"))  # others go on meanwhile
        assert there.app.sent <= MAX_WINDOW_BYTES
        stream.close()
        await until(lambda: there.app.ended == ["/long", "/endless"], "it ends with its viewer")


async def test_messages_of_a_socket_arrive_whole_and_in_order() -> None:
    async with line() as there:
        stream = there.request("/ws", socket=("imuscope.v1",))
        head = await stream.next()
        assert isinstance(head, ResponseHead)
        assert head.subprotocol == "imuscope.v1"
        for text in ("é", "b" * 30_000):
            stream.send_text(text)
            for expected, is_text in ((text.encode() * 3, True), (LONG_BODY, False)):
                message = b""
                while True:
                    part = await stream.next()
                    assert isinstance(part, ResponsePart)
                    assert part.is_text == is_text
                    message += part.data
                    stream.acknowledge(len(part.data))
                    if part.is_last:
                        break
                assert message == expected
        stream.close()
        await until(lambda: there.robot.streams == 0, "it ends with its viewer")


async def test_a_command_is_carried_out_although_its_viewer_leaves_and_its_line_is_lost() -> None:
    async with line() as there:
        waiting, command = there.request("/api/wait"), there.request("/api/command", method="POST")
        await until(lambda: set(there.app.began) == {"/wait", "/command"}, "both have begun")
        waiting.close()
        command.close()
        there.robot.line_lost()
        await until(lambda: there.app.ended == ["/wait"], "the one that only reads has ended")
        there.app.carry_on.set()
        await until(lambda: there.robot.streams == 0, "the other one, too")
        assert there.notices == ["Command through the fleet server of operator at 10.0.0.5: POST /api/command."]


async def test_streams_end_when_the_other_side_is_silent(monkeypatch: pytest.MonkeyPatch) -> None:
    async with line() as there:
        stream = there.request("/api/wait")
        await until(lambda: there.robot.streams == 1, "it is open")
        monkeypatch.setattr(http_tunnel_server, "SILENCE_S", -1.0)
        there.fleet.tick()
        with pytest.raises(DomainError, match="has not answered") as error:
            await stream.next()
        assert error.value.kind == "gone"
        assert error.value.hint
        monkeypatch.setattr(http_tunnel_robot, "SILENCE_S", -1.0)
        there.robot.tick()
        await until(lambda: there.robot.streams == 0, "the robot has ended it, too")


async def test_both_sides_report_to_each_other_that_they_are_there() -> None:
    async with line() as there:
        stream = there.request("/api/wait")
        received = there.fleet.bytes
        there.fleet.tick()
        await until(lambda: there.fleet.bytes > received, "the robot answers")
        there.alive[0] = False
        there.fleet.tick()
        with pytest.raises(DomainError, match="is lost"):
            await stream.next()
        with pytest.raises(DomainError, match="is lost"):
            there.request("/api/short")


async def test_a_lost_message_ends_its_stream_and_no_other() -> None:
    async with line() as there:
        broken, other = there.request("/api/wait"), there.request("/api/wait")
        there.fleet.take("a", encode(ResponsePart(broken.number, 3, b"x")))
        there.fleet.take("b", encode(ResponsePart(other.number, 3, b"x")))  # not of that robot
        with pytest.raises(DomainError, match="was lost"):
            await broken.next()
        there.app.carry_on.set()
        assert await body(other) == b"short"


async def test_a_request_that_was_lost_on_the_way_is_noticed() -> None:
    async with line() as there:
        other = there.request("/api/wait")
        session, there.fleet._session = there.fleet._session, None
        with pytest.raises(DomainError, match="is lost"):
            there.request("/api/short")
        there.fleet._session = session
        lost = there.request("/api/wait")
        await until(lambda: there.robot.streams == 2, "both are open")
        there.robot.take(there.fleet.id, encode(CancelStream(lost.number, 1)))  # as if it had never arrived
        await until(lambda: there.robot.streams == 1, "the robot has one")
        there.fleet.tick()
        with pytest.raises(DomainError, match="part of the request was lost"):
            await lost.next()
        there.app.carry_on.set()
        assert await body(other) == b"short"


async def test_a_robot_that_sends_more_than_was_requested_is_not_listened_to() -> None:
    async with line() as there:
        stream = there.request("/api/wait")
        there.fleet.take("a", encode(ResponseHead(stream.number, 0)))
        for number in range(1, 3 * MAX_WINDOW_BYTES // MAX_PART):
            there.fleet.take("a", encode(ResponsePart(stream.number, number, bytes(MAX_PART))))
        with pytest.raises(DomainError, match="more than was requested"):
            await stream.next()


async def test_requests_at_once_are_limited() -> None:
    async with line() as there:
        streams = [there.request("/api/wait") for _ in range(http_tunnel_server.MAX_STREAMS)]
        with pytest.raises(DomainError) as error:
            there.request("/api/short")
        assert error.value.kind == "full"
        await until(lambda: there.robot.streams == len(streams), "all are open")
        streams.pop().close()
        assert await body(there.request("/api/short")) == b"short"


async def test_a_request_for_another_run_of_the_robot_is_not_answered() -> None:
    async with line() as there:
        there.robot.take("f" * 16, encode(OpenStream(1, "f" * 16, "POST", "/api/command", role="control")))
        there.robot.take("f" * 16, encode(KeepAlive("f" * 16)))
        assert there.robot.streams == 0
        assert there.notices == []


async def test_what_is_sent_keeps_to_the_limit_of_the_line() -> None:
    counted: list[int] = []

    def delay_of(size: int) -> float:
        counted.append(size)
        return 0.0

    async with line(delay_of) as there:
        counted.clear()
        await body(there.request("/api/long"))
        assert len(LONG_BODY) < sum(counted) < 1.1 * len(LONG_BODY)


async def test_a_window_shrinks_on_a_slow_line_and_grows_on_a_fast_one() -> None:
    window = Window()
    sent = 0
    for step in range(10):
        sent += window.piece
        window.sent(window.piece, now=10.0 * step)
        assert window.acknowledge(sent, now=10.0 * step + 5)
    assert window.size == MIN_WINDOW_BYTES
    for step in range(100):
        sent += window.piece
        window.sent(window.piece, now=1000.0 + step)
        assert window.acknowledge(sent, now=1000.01 + step)
    assert window.size == MAX_WINDOW_BYTES
    assert not window.acknowledge(sent + 1, 2000.0)
    assert not window.acknowledge(sent - 1, 2000.0)
    window.sent(MAX_WINDOW_BYTES, 2000.0)
    waiting = asyncio.create_task(window.wait(1))
    await asyncio.sleep(0)
    assert not waiting.done()
    window.close()
    await waiting


@each_row(
    ("robot", "kind", "words"),
    [
        ("lost", "gone", "The line of robot lost is lost"),
        ("nobody", "not-found", "There is no robot nobody in this fleet"),
        ("vm (2)", "gone", "does not open while another robot has its name"),
    ],
)
def test_a_robot_that_never_existed_was_called_lost(robot: str, kind: str, words: str) -> None:
    known = {name: summary_of(name, RobotStatus(), 0.0, is_live=name != "lost") for name in ("lost", "vm (2)")}
    known["vm (2)"].same_name = 1
    pages = RobotPages(lambda name: "", known.get)
    with pytest.raises(DomainError, match=re.escape(words)) as refused:
        pages.open(
            robot, lambda number, boot: OpenStream(number, boot, "GET", "/api/devices", role="view", who="a viewer")
        )
    assert refused.value.kind == kind
