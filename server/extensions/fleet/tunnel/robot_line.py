"""Requests of this fleet server to one robot, in the name of a user: JSON there and back, through the robot's pages.

What becomes of a request that was sent and not answered is unknown (LineError). A request that was refused, or never
sent, has done nothing (DomainError). Answers are checked against a type, since nothing here trusts a robot.
"""

import asyncio
from typing import Any, TypeVar

import msgspec

from imuscope.server.errors import KINDS, DomainError
from imuscope.server.extensions.fleet.tunnel.http_tunnel_protocol import (
    EndStream,
    OpenStream,
    ResponseHead,
    ResponsePart,
)
from imuscope.server.extensions.fleet.tunnel.http_tunnel_server import PageStream, RobotPages
from imuscope.server.text.printable import printable

ANSWER_S = 30.0
MAX_ANSWER = 2 * 1024 * 1024  # bytes
MAX_WHO = 100  # characters
JSON = (("accept", "application/json"), ("content-type", "application/json"))
VERSION_HINT = "Its version may be too new for this fleet server; update the fleet server."
LOST = ("gone", "fault")
"""Kinds of a line that broke: the robot may have carried the request out."""
T = TypeVar("T")


class LineError(Exception):
    """A request was sent, and its answer did not arrive: one sentence."""


class _Problem(msgspec.Struct):
    message: str
    kind: str = ""
    hint: str = ""


class RobotLine:
    """Requests to a robot.

    Args:
        who: the user, and why; the robot logs it with each command.
    """

    def __init__(self, pages: RobotPages, robot: str, who: str) -> None:
        self._pages, self._robot = pages, robot
        self._who = who[:MAX_WHO]

    async def get(self, path: str, answer: type[T]) -> T:
        """Get a resource of the robot.

        Raises:
            LineError, DomainError: there is no answer, or a refusal.
        """
        return await self._request("GET", path, b"", answer)

    async def post(self, path: str, body: object, answer: type[T]) -> T:
        """Send a command to the robot.

        Raises:
            LineError: it may have been done.
            DomainError: it was not done.
        """
        return await self._request("POST", path, msgspec.json.encode(body), answer)

    async def _request(self, method: Any, path: str, body: bytes, answer: type[T]) -> T:
        stream = self._pages.open(
            self._robot,
            lambda number, boot: OpenStream(
                *(number, boot, method, path), headers=JSON, body=body, role="control", who=self._who
            ),
        )
        try:
            async with asyncio.timeout(ANSWER_S):
                status, data = await _answer(stream)
        except TimeoutError:
            raise LineError(f"The robot did not answer within {ANSWER_S:.0f} s.") from None
        except DomainError as error:
            if error.kind in LOST:
                raise LineError(error.message) from None
            raise
        finally:
            stream.close()
        return decoded(status, data, answer)


def decoded(status: int, data: bytes, answer: type[T]) -> T:
    """The answer of a robot.

    Raises:
        LineError: it is not valid.
        DomainError: the robot refuses.
    """
    try:
        if status < 400:
            return msgspec.json.decode(data, type=answer)
        problem = msgspec.json.decode(data, type=_Problem)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        raise LineError("The robot's answer is not valid.") from None
    kind = problem.kind if problem.kind in KINDS and KINDS[problem.kind].status else "refused"
    raise DomainError(kind, printable(problem.message[:500]), printable(problem.hint[:500]))


async def _answer(stream: PageStream) -> tuple[int, bytes]:
    """Status and body.

    Raises:
        DomainError: the robot refuses, or the line is broken.
    """
    head = await stream.next()
    if not isinstance(head, ResponseHead):
        raise DomainError("gone", "The robot's answer has no beginning.", VERSION_HINT)
    body = bytearray()
    while not isinstance(part := await stream.next(), EndStream):
        if not isinstance(part, ResponsePart) or len(body) > MAX_ANSWER:
            raise DomainError("gone", "The robot's answer is too long, or not valid.", VERSION_HINT)
        body += part.data
        stream.acknowledge(len(part.data))
    return head.status, bytes(body)
