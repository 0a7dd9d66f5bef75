"""The fleet server's end of the pages of robots: requests of viewers, sent over the bus, and what the robots answer.

    viewer ─> server/extensions/fleet/server/page_routes.py ─> RobotPages.open ─> OpenStream ─> bus ─> robot
                                  Stream  <── ResponseHead, ResponsePart, EndStream ── Inbox <── bus

Nothing here trusts a robot: a stream belongs to the robot that it was opened for, its messages are numbered, and what
it sends beyond the acknowledged bytes ends it. A stream ends with its viewer, with the line of the robot, and when the
robot is silent for SILENCE_S.
"""

import asyncio
import contextlib
import itertools
import secrets
import time
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING

from imuscope.server.errors import KINDS, DomainError
from imuscope.server.extensions.fleet.model import keys
from imuscope.server.extensions.fleet.model.inbox import Inbox
from imuscope.server.extensions.fleet.model.summaries import RobotSummary
from imuscope.server.extensions.fleet.tunnel.flow_control import MAX_WINDOW_BYTES
from imuscope.server.extensions.fleet.tunnel.http_tunnel_protocol import (
    Acknowledge,
    Answer,
    CancelStream,
    ClientMessage,
    EndStream,
    KeepAlive,
    OpenStream,
    ResponseHead,
    ResponsePart,
    StreamError,
    TunnelMessageError,
    TunnelRequest,
    decode_answer,
    decode_request,
    encode,
)
from imuscope.server.text.printable import printable
from imuscope.server.text.prometheus import PrometheusText

if TYPE_CHECKING:
    import zenoh

SILENCE_S = 15.0
BEAT_S = 4.0
MAX_STREAMS = 60  # of a robot; it takes a few more, for those that end at the moment
MAX_IN_ALL = 2000
LOST_HINT = "Try again; the line of the robot may be bad."


class RobotPages:
    """Open requests to robots. To be used in the event loop, except `declare`.

    Args:
        boot_of: run of the server of a robot; empty if it is not live.
        summary_of: a robot as it is listed; None if it is unknown.
    """

    def __init__(self, boot_of: Callable[[str], str], summary_of: Callable[[str], RobotSummary | None]) -> None:
        self.id = secrets.token_hex(8)
        self.requests = 0
        self.bytes = 0
        self.invalid = 0
        self._boot_of, self._summary_of = boot_of, summary_of
        self._inbox = Inbox(self.take)
        self._session: zenoh.Session | None = None
        self._streams: dict[tuple[str, int], PageStream] = {}
        self._numbers = itertools.count(1)
        self._last_messages: dict[str, float] = {}
        self._beat_at = 0.0

    def start(self) -> None:
        """Begin to take messages over, in the event loop."""
        self._inbox.start()

    def declare(self, session: "zenoh.Session") -> object:
        """Begin to receive; from any thread. Returns what has to be kept."""

        def on_answer(sample: "zenoh.Sample") -> None:
            self._inbox.put(keys.robot_of(str(sample.key_expr)), sample.payload.to_bytes())

        self._session = session
        return session.declare_subscriber(keys.answers(self.id), on_answer)

    def open(self, robot: str, make: Callable[[int, str], OpenStream]) -> "PageStream":
        """Send a request to a robot.

        Args:
            make: the request, with this number of a stream and this run of the robot's server.

        Raises:
            DomainError: the robot is unknown or not live, too many requests are open, or this one is too long.
        """
        boot = self._boot_of(robot)
        if not boot or self._session is None:
            raise self._absence(robot)
        if len(self._streams) >= MAX_IN_ALL or sum(name == robot for name, _ in self._streams) >= MAX_STREAMS:
            words = f"At most {MAX_STREAMS} requests to a robot are open at once."
            raise DomainError("full", words, "Close an unused page, or try again later.")
        number = next(self._numbers)
        request = make(number, boot)
        try:
            decode_request(encode(request))
        except TunnelMessageError as error:
            raise DomainError(
                "bad-request", f"This cannot be sent to a robot. {error}", "Make the request shorter."
            ) from None
        stream = self._streams[robot, number] = PageStream(self, robot, number)
        self.requests += 1
        self._last_messages[robot] = time.monotonic()
        self.put(robot, request)
        return stream

    def _absence(self, robot: str) -> DomainError:
        """Reason why requests to a robot are refused."""
        name, summary = printable(robot[:80]), self._summary_of(robot)
        if summary is None:
            hint = "Check the name in the list of robots; one that was removed has to join again."
            return DomainError("not-found", f"There is no robot {name} in this fleet.", hint)
        if summary.same_name:
            hint = "Start each with its own name: imuscope serve … --fleet-name NAME."
            return DomainError("gone", f"The page of {name} does not open while another robot has its name.", hint)
        hint = "Its page opens when it is back; its devices and recordings are not affected."
        return DomainError("gone", f"The line of robot {name} is lost.", hint)

    def put(self, robot: str, message: TunnelRequest) -> None:
        """Send a message. Never waits: a message that does not fit is lost, and its number missed."""
        import zenoh

        session = self._session
        if session is None:
            return
        with contextlib.suppress(zenoh.ZError):  # a closed session: the streams end when their robots are silent
            session.put(
                keys.request_key(robot, self.id),
                encode(message),
                congestion_control=zenoh.CongestionControl.DROP,
            )

    def take(self, robot: str, data: bytes) -> None:
        """Take over a message of a robot."""
        if robot not in self._last_messages:
            return  # nothing was sent
        self.bytes += len(data)
        try:
            answer = decode_answer(data)
        except TunnelMessageError:
            self.invalid += 1
            return
        self._last_messages[robot] = time.monotonic()
        if isinstance(answer, KeepAlive):
            for (name, number), one in list(self._streams.items()):
                if name == robot and number <= answer.last and number not in answer.open:
                    one.fail(DomainError("gone", "A part of the request was lost.", LOST_HINT))
            return
        stream = self._streams.get((robot, answer.stream))
        if stream is not None:
            stream.take(answer)

    def tick(self) -> None:
        """Close streams of disconnected robots and ping the others. Call once a second."""
        now = time.monotonic()
        is_due = now >= self._beat_at
        if is_due:
            self._beat_at = now + BEAT_S
        robots = {robot for robot, _ in self._streams}
        for robot in robots:
            boot = self._boot_of(robot)
            if not boot:
                self._fail(robot, f"The line of robot {robot} is lost.")
            elif now - self._last_messages[robot] > SILENCE_S:
                self._fail(robot, f"Robot {robot} has not answered for {SILENCE_S:.0f} s.")
            elif is_due:
                streams = [one for (name, _), one in self._streams.items() if name == robot]
                for stream in streams:
                    stream.acknowledge(0)  # in case the last one was lost
                self.put(robot, KeepAlive(boot, max(one.number for one in streams)))
        for robot in set(self._last_messages) - robots:
            del self._last_messages[robot]

    def _fail(self, robot: str, words: str) -> None:
        hint = "Try again when the fleet shows it as live. Commands that it has received are carried out."
        for stream in [one for (name, _), one in self._streams.items() if name == robot]:
            stream.fail(DomainError("gone", words, hint))

    def close(self) -> None:
        """End everything, and forget the session."""
        for robot in {robot for robot, _ in self._streams}:
            self._fail(robot, "The fleet server ends.")
        self._session = None

    def forget(self, robot: str, number: int) -> None:
        """Remove a closed stream."""
        self._streams.pop((robot, number), None)

    def add_metrics(self, page: PrometheusText) -> None:
        """Add the families of pages to the page for Prometheus."""
        page.family("imuscope_fleet_page_streams", "gauge", "Requests and WebSockets to robots that are open.")
        page.add(len(self._streams))
        page.family("imuscope_fleet_page_requests_total", "counter", "Requests and WebSockets to robots.")
        page.add(self.requests)
        page.family("imuscope_fleet_page_bytes_total", "counter", "Bytes that robots answered.")
        page.add(self.bytes)
        page.family("imuscope_fleet_page_invalid_total", "counter", "Messages of robots that were not valid.")
        page.add(self.invalid + self._inbox.dropped)


class PageStream:
    """A request to a robot, or a WebSocket. `close` it in the end."""

    def __init__(self, pages: RobotPages, robot: str, number: int) -> None:
        self.robot, self.number = robot, number
        self._pages = pages
        self._answers: deque[ResponseHead | ResponsePart | EndStream] = deque()
        self._news = asyncio.Event()
        self._problem: DomainError | None = None
        self._expected = 0
        self._sent = 1
        self._received = self._acknowledged = 0
        self._is_over = False

    def take(self, answer: Answer) -> None:
        """Take over a message of the robot."""
        if isinstance(answer, KeepAlive) or self._is_over or self._problem is not None:
            return
        if answer.number != self._expected:
            self.fail(DomainError("gone", "A part of the robot's answer was lost.", LOST_HINT))
            return
        self._expected += 1
        if isinstance(answer, StreamError):
            kind = answer.kind if answer.kind in KINDS and KINDS[answer.kind].status else "refused"
            self.fail(DomainError(kind, printable(answer.message), printable(answer.hint)))
            return
        if isinstance(answer, ResponsePart):
            self._received += len(answer.data)
        if (
            self._received - self._acknowledged > 2 * MAX_WINDOW_BYTES
            or len(self._answers) > 2 * MAX_WINDOW_BYTES // 1024
        ):
            self.fail(DomainError("gone", "The robot sent more than was requested.", "Its version may be too new."))
            return
        self._answers.append(answer)
        self._is_over = isinstance(answer, EndStream)
        self._news.set()

    def fail(self, problem: DomainError) -> None:
        """End with a problem."""
        if not self._is_over:
            self._problem = self._problem or problem
            self._answers.clear()
            self._news.set()

    async def next(self) -> ResponseHead | ResponsePart | EndStream:
        """The next message of the robot.

        Raises:
            DomainError: the robot refuses, or the stream is broken.
        """
        while not self._answers:
            if self._problem is not None:
                raise self._problem
            if self._is_over:
                return EndStream(self.number, self._expected)
            self._news.clear()
            await self._news.wait()
        return self._answers.popleft()

    def acknowledge(self, size: int) -> None:
        """Acknowledge `size` delivered bytes (flow control)."""
        self._acknowledged += size
        self._put(Acknowledge(self.number, self._next_number(), self._acknowledged))

    def send_text(self, text: str) -> None:
        """Send a message of the browser."""
        self._put(ClientMessage(self.number, self._next_number(), text))

    def close(self) -> None:
        """The viewer has gone, or has everything."""
        if not self._is_over:
            self._put(CancelStream(self.number, self._next_number()))
        self._is_over = True
        self._pages.forget(self.robot, self.number)

    def _next_number(self) -> int:
        number, self._sent = self._sent, self._sent + 1
        return number

    def _put(self, message: ClientMessage | Acknowledge | CancelStream) -> None:
        self._pages.put(self.robot, message)
