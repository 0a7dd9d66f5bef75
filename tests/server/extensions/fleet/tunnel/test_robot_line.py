"""Requests to a robot: answers, refusals, and what is unknown because the line broke or took too long."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

import pytest

from imuscope.server.errors import DomainError
from imuscope.server.extensions.fleet.tunnel import robot_line
from imuscope.server.extensions.fleet.tunnel.http_tunnel_protocol import (
    EndStream,
    OpenStream,
    ResponseHead,
    ResponsePart,
)
from imuscope.server.extensions.fleet.tunnel.robot_line import LineError, RobotLine
from tests.support.each_row import each_row
from tests.support.waiting import until


class Stream:
    """What a robot sends; then nothing."""

    def __init__(self, *sent: object) -> None:
        self._sent = list(sent)
        self.is_closed = False

    async def next(self) -> object:
        if not self._sent:
            await until(lambda: self.is_closed, "nobody waits any more")
        one = self._sent.pop(0)
        if isinstance(one, Exception):
            raise one
        return one

    def acknowledge(self, size: int) -> None:
        """Nobody counts."""

    def close(self) -> None:
        self.is_closed = True


class Pages:
    """The lines of a fleet server, with one robot."""

    def __init__(self, stream: Stream) -> None:
        self.stream = stream
        self.requests: list[OpenStream] = []

    def open(self, robot: str, request: Callable[[int, str], OpenStream]) -> Stream:
        self.requests.append(request(1, "boot"))
        return self.stream


def line(*sent: object) -> tuple[RobotLine, Pages]:
    pages = Pages(Stream(*sent))
    return RobotLine(pages, "otter", "Ada"), pages  # type: ignore[arg-type]


def test_an_answer_is_put_together_and_decoded() -> None:
    robot, pages = line(ResponseHead(1, 1), ResponsePart(1, 2, b'{"a"'), ResponsePart(1, 3, b": 7}"), EndStream(1, 4))
    assert asyncio.run(robot.get("/api/x", dict[str, int])) == {"a": 7}
    assert [(one.method, one.path, one.role, one.who) for one in pages.requests] == [
        ("GET", "/api/x", "control", "Ada")
    ]
    assert pages.stream.is_closed


@each_row("kind", ["gone", "fault"])
def test_a_line_that_broke_leaves_open_what_was_done(kind: str) -> None:
    robot, pages = line(DomainError(kind, "The line is lost."))
    with pytest.raises(LineError, match="The line is lost"):
        asyncio.run(robot.post("/api/x", {}, dict[str, Any]))
    assert pages.stream.is_closed


def test_a_refusal_has_done_nothing() -> None:
    robot, _ = line(DomainError("not-now", "It is busy."))
    with pytest.raises(DomainError, match="It is busy"):
        asyncio.run(robot.post("/api/x", {}, dict[str, Any]))


def test_a_robot_that_does_not_answer_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(robot_line, "ANSWER_S", 0.01)
    robot, pages = line(ResponseHead(1, 1))
    with pytest.raises(LineError, match="did not answer"):
        asyncio.run(robot.get("/api/x", dict[str, Any]))
    assert pages.stream.is_closed
