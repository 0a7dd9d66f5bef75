"""Webhooks of alarms: each change of an alarm is posted as JSON to an address that a user gave.

    AlarmInstance ─ message ─> WebhookQueue of the alarm ─ one after the other ─> POST, again after a pause if it fails

Nothing waits for a receiver: each alarm has a queue and a task of its own, bounded in length, rate, attempts and time.
An address may hold a secret anywhere behind the host, so that answers, events and logs only show the host. Which
hosts may be reached: webhook_targets.py. A request is marked, and a server of imuscope refuses one that is.
"""

import asyncio
import base64
import contextlib
import http.client
import json
import logging
import socket
import ssl
import urllib.parse
from collections import deque
from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Any

from imuscope.server import wire
from imuscope.server.access.security_headers import WEBHOOK_HEADER
from imuscope.server.concurrency.backoff import Backoff
from imuscope.server.concurrency.limiters import TokenBucket
from imuscope.server.concurrency.tasks import end_tasks
from imuscope.server.errors import DomainError
from imuscope.server.extensions.alarms.webhook_targets import TargetError, check_host, connect
from imuscope.server.version import VERSION

log = logging.getLogger("imuscope.alarms")

HIDDEN = "/…"  # stands for all that follows the host
MAX_QUEUE = 20
MESSAGES_PER_S, MESSAGE_BURST = 1 / 3, 20  # messages of one alarm
AGAIN = {408, 425, 429}  # and 5xx

Report = Callable[[wire.Level, str], None]


@dataclass(frozen=True, slots=True)
class WebhookTiming:
    """Bounds of a delivery: s of one attempt, pauses between attempts (s), number of attempts."""

    attempt_s: float = 10.0
    first_pause_s: float = 1.0
    longest_pause_s: float = 30.0
    attempts: int = 6


class UndeliveredError(Exception):
    """A message was not taken; the text says why.

    Args:
        is_final: another attempt would not help.
    """

    def __init__(self, why: str, *, is_final: bool = False) -> None:
        super().__init__(why)
        self.is_final = is_final


def checked_url(url: str, allowed: Collection[str] | None = None) -> urllib.parse.SplitResult:
    """The parts of an address.

    Args:
        allowed: hosts that may be this machine or its link; None: the host is not judged.

    Raises:
        DomainError: it is not one of http or https, or its host may not be reached.
    """
    hint = "Give the whole address, such as https://example.org/hook."
    try:
        parts = urllib.parse.urlsplit(url)
        is_valid = parts.scheme in ("http", "https") and bool(parts.hostname) and parts.port != 0
    except ValueError:
        is_valid = False
    if not is_valid or not url.isascii() or any(letter <= " " or letter == "\x7f" for letter in url):
        raise DomainError("bad-value", "webhook: this is not an address with http or https.", hint)
    if allowed is not None:
        check_host(parts.hostname or "", allowed)
    return parts


def shown_url(url: str) -> str:
    """An address without its possibly secret parts: user, password, path and query."""
    if not url:
        return ""
    try:
        parts = urllib.parse.urlsplit(url)
    except ValueError:  # of a file that was edited by hand
        return HIDDEN
    host = parts.netloc.rpartition("@")[2]
    is_whole = url.rstrip("/") == f"{parts.scheme}://{host}"
    return url if is_whole else f"{parts.scheme}://{host}{HIDDEN}"


async def post(url: str, body: dict[str, Any], attempt_s: float, allowed: Collection[str] = ()) -> None:
    """Post a body as JSON; redirects are not followed.

    Args:
        allowed: hosts that may be this machine or its link.

    Raises:
        UndeliveredError: it was not taken.
    """
    parts = checked_url(url)
    kind = http.client.HTTPSConnection if parts.scheme == "https" else http.client.HTTPConnection
    connection = kind(parts.hostname or "", parts.port, timeout=attempt_s)
    headers = {
        "content-type": "application/json",
        "user-agent": f"imuscope/{VERSION}",
        "connection": "close",
        WEBHOOK_HEADER: "1",
    }
    if parts.username is not None:
        pair = f"{urllib.parse.unquote(parts.username)}:{urllib.parse.unquote(parts.password or '')}"
        headers["authorization"] = "Basic " + base64.b64encode(pair.encode()).decode()
    path = urllib.parse.urlunsplit(("", "", parts.path or "/", parts.query, ""))

    def exchange() -> int:
        try:
            line = connect(connection.host, connection.port, attempt_s, allowed)
            if parts.scheme == "https":
                line = ssl.create_default_context().wrap_socket(line, server_hostname=connection.host)
            connection.sock = line
            connection.request("POST", path, json.dumps(body, allow_nan=False).encode(), headers)
            return connection.getresponse().status
        finally:
            connection.close()

    try:
        async with asyncio.timeout(attempt_s):
            status = await asyncio.to_thread(exchange)
    except TimeoutError:
        _cut(connection)
        raise UndeliveredError(f"no answer within {attempt_s:g} s") from None
    except asyncio.CancelledError:
        _cut(connection)
        raise
    except TargetError as error:
        raise UndeliveredError(str(error), is_final=True) from None
    except (OSError, http.client.HTTPException, ValueError) as error:
        why = getattr(error, "strerror", None) or type(error).__name__
        raise UndeliveredError(f"no connection ({why})") from None
    if not 200 <= status < 300:
        raise UndeliveredError(f"it answered {status}", is_final=status < 500 and status not in AGAIN)


def _cut(connection: http.client.HTTPConnection) -> None:
    """End an exchange whose thread still waits for the receiver."""
    if connection.sock is not None:
        with contextlib.suppress(OSError):
            connection.sock.shutdown(socket.SHUT_RDWR)


class WebhookQueue:
    """Messages of one alarm to one address."""

    def __init__(self, url: str, timing: WebhookTiming, allowed: Collection[str]) -> None:
        self.url = url
        self._timing, self._allowed = timing, allowed
        self._waiting: deque[tuple[dict[str, Any], Report]] = deque()
        self._bucket = TokenBucket(MESSAGES_PER_S, MESSAGE_BURST, asyncio.get_running_loop().time())
        self._left_out = 0
        self._is_failing = False
        self._task: asyncio.Task[None] | None = None

    def add(self, body: dict[str, Any], report: Report) -> None:
        """Post a message after those that wait; above the limits it is left out, and the next one has their number."""
        now = asyncio.get_running_loop().time()
        if len(self._waiting) >= MAX_QUEUE or self._bucket.wait_s(now) > 0:
            self._left_out += 1
            return
        self._bucket.acquire(now)
        self._waiting.append(({**body, "left_out": self._left_out}, report))
        self._left_out = 0
        if not self.is_busy:
            self._task = asyncio.get_running_loop().create_task(self._work(), name="webhook")

    @property
    def is_busy(self) -> bool:
        """Whether messages wait or are being posted."""
        return self._task is not None and not self._task.done()

    async def _work(self) -> None:
        while self._waiting:
            body, report = self._waiting.popleft()
            try:
                await self._deliver(body)
            except UndeliveredError as error:
                if not self._is_failing:
                    report("warning", f"was not delivered to {shown_url(self.url)}: {error}. Later ones are tried.")
                self._is_failing = True
            except Exception:
                log.exception("a webhook failed")
            else:
                if self._is_failing:
                    report("info", f"is delivered to {shown_url(self.url)} again.")
                self._is_failing = False

    async def _deliver(self, body: dict[str, Any]) -> None:
        timing = self._timing
        backoff = Backoff(timing.first_pause_s, timing.longest_pause_s)
        for attempt in range(1, timing.attempts + 1):
            try:
                await post(self.url, body, timing.attempt_s, self._allowed)
            except UndeliveredError as error:
                if error.is_final or attempt == timing.attempts:
                    times = "one attempt" if attempt == 1 else f"{attempt} attempts"
                    raise UndeliveredError(f"{error} ({times})") from None
                await asyncio.sleep(backoff.next())
            else:
                return

    async def close(self) -> None:
        """Post nothing more."""
        self._waiting.clear()
        await end_tasks(self._task)


class Webhooks:
    """Queues of all alarms that have a webhook; `allowed`: hosts that may be this machine or its link."""

    def __init__(self, timing: WebhookTiming | None = None, allowed: Collection[str] = ()) -> None:
        self.timing = timing or WebhookTiming()
        self.allowed = allowed
        self._queues: dict[tuple[str, str], WebhookQueue] = {}

    def send(self, alarm: str, url: str, body: dict[str, Any], report: Report) -> None:
        """Post a message of an alarm in the background; `report` is given a failure in words, once until it works."""
        queue = self._queues.get((alarm, url))
        if queue is None:
            queue = self._queues[alarm, url] = WebhookQueue(url, self.timing, self.allowed)
        queue.add(body, report)

    def is_busy(self, alarm: str) -> bool:
        """Whether messages of an alarm wait or are being posted."""
        return any(queue.is_busy for (own, _), queue in self._queues.items() if own == alarm)

    async def forget(self, alarm: str, spare: str = "") -> None:
        """End the queues of an alarm that was changed or deleted, but that to the address `spare`."""
        for key in [key for key in self._queues if key[0] == alarm and key[1] != spare]:
            await self._queues.pop(key).close()

    async def close(self) -> None:
        """End all queues."""
        for alarm in {alarm for alarm, _ in self._queues}:
            await self.forget(alarm)
