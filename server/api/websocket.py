"""The live WebSocket: the server side of server/wire/ for one browser.

Two tasks per browser: one reads its requests, one sends from its queue. Sending waits only for the socket, and nothing
else waits for it; messages that a socket accepts at once bypass this task (server/streaming/send_queue.py). A socket
that does not accept a byte for `stuck_s` (server/services/services.py) is closed. Progress is measured in the
transport's buffer, so that a very slow link is not taken for a dead one.
"""

import asyncio
import contextlib
import logging
from typing import Any

from fastapi import WebSocket, WebSocketDisconnect

from imuscope.server import wire
from imuscope.server.api.dependencies import TheServices
from imuscope.server.api.lazy_routes import lazy_router
from imuscope.server.concurrency.limiters import TokenBucket
from imuscope.server.concurrency.tasks import end_tasks
from imuscope.server.streaming.clients import ClientFanout
from imuscope.server.streaming.send_queue import SendQueue
from imuscope.server.wire import codec as wire_codec

log = logging.getLogger("imuscope.live")
router = lazy_router()

MAX_WAITING_TEXT = 16 * 1024 * 1024  # bytes; text is never dropped, so a client this slow is disconnected
REQUESTS_PER_S, REQUESTS_AT_ONCE = 20.0, 60.0  # a page asks twice a second, and some dozen times when it is opened
LONGEST_INTERVAL_S = 0.1  # between two flushes, however rarely a page draws; bounds the age of what it shows
HISTORY_PAUSE_S = 0.002  # between two messages of history: 128 KiB each, so 60 MB/s at most, for all browsers together


class WebSocketSender:
    """Sends the queue of one browser, and detects a stalled socket.

    Args:
        stuck_s: a socket that accepts no byte for this long is stalled.
    """

    def __init__(self, socket: WebSocket, clients: ClientFanout, stuck_s: float) -> None:
        self._socket = socket
        self._clients = clients
        self._stuck_s = stuck_s
        self._wake_event = asyncio.Event()
        extensions = socket.scope.get("extensions", {})
        self.queue = SendQueue(self._wake_event.set, try_send=extensions.get("imuscope.try_send", lambda frame: False))
        self._transport: asyncio.WriteTransport | None = extensions.get("imuscope.transport")
        self.peer = socket.client.host if socket.client is not None else ""
        self._waiting = 0
        self._stuck_since: float | None = None

    async def run(self, pace: asyncio.Lock) -> None:
        """Send until cancelled. `pace` is shared by all browsers: history is prepared for one at a time, so that it
        never blocks the loop.
        """
        queue = self.queue
        while True:
            message = queue.pop()
            if message is None and queue.wants_history:
                async with pace:
                    message = queue.take_history(self._clients.now())
                    await asyncio.sleep(HISTORY_PAUSE_S)
            if message is None:
                if queue.is_idle:
                    self._wake_event.clear()
                    await self._wake_event.wait()
                continue
            queue.sending_since = self._stuck_since = self._clients.now()
            if isinstance(message, str):
                await self._socket.send_text(message)
            else:
                await self._socket.send_bytes(message)
            queue.sending_since = self._stuck_since = None
            queue.sent_bytes += len(message)

    def is_stuck(self, now: float) -> bool:
        """Whether no byte has moved for `stuck_s`, or too much is queued. Call it about once a second."""
        if self.queue.text_bytes > MAX_WAITING_TEXT:
            return True
        if self._stuck_since is None:
            return False
        waiting = self._transport.get_write_buffer_size() if self._transport is not None else self._waiting
        if waiting < self._waiting:
            self._stuck_since = now
        self._waiting = waiting
        return now - self._stuck_since > self._stuck_s


async def _listen(socket: WebSocket, clients: ClientFanout, queue: SendQueue) -> None:
    """Serve the browser's requests until it disconnects, rate-limited so that a flood does not slow other clients."""
    requests = TokenBucket(REQUESTS_PER_S, REQUESTS_AT_ONCE, clients.now())
    while True:
        message: dict[str, Any] = dict(await socket.receive())
        if message["type"] == "websocket.disconnect":
            return
        wait_s = requests.wait_s(now := clients.now())
        requests.acquire(now)
        if wait_s:
            await asyncio.sleep(wait_s)
        try:
            text = message.get("text")
            if text is None:
                raise wire_codec.WireError(
                    "A browser sends text frames only.", "Binary frames carry samples to the browser."
                )
            request = wire_codec.decode_text(text)
        except wire_codec.WireError as error:
            queue.put_message(wire_codec.encode_text(wire.Problem("bad-request", str(error), error.hint)))
            continue
        if isinstance(request, wire.Ping):
            queue.put_message(wire_codec.encode_text(wire.Pong(request.t, clients.now())))
        elif isinstance(request, wire.Interval):
            queue.interval_s = min(request.s, LONGEST_INTERVAL_S)
        else:
            clients.subscribe(queue, request)


async def _watch(sender: WebSocketSender, clients: ClientFanout) -> None:
    """Return when the browser is stuck; log when it begins to lag."""
    reported = 0
    while not sender.is_stuck(clients.now()):
        dropped = sender.queue.dropped
        if dropped > reported:
            _log(sender, f"does not keep up: {dropped} samples dropped so far.", dropped=dropped)
        reported = dropped
        await asyncio.sleep(1.0)


def _log(sender: WebSocketSender, words: str, level: int = logging.WARNING, **data: object) -> None:
    number = sender.queue.number
    data = {"client": number, "peer": sender.peer, **data}
    often = ("client", number) if level > logging.INFO else None
    log.log(level, "Browser %d %s", number, words, extra={"event": "client", "data": data, "often": often})


@router.websocket("/ws")
async def live(socket: WebSocket, services: TheServices) -> None:
    """Stream everything live; see server/wire/."""
    clients = services.telemetry.clients
    if wire.SUBPROTOCOL not in socket.scope.get("subprotocols", []):
        await socket.accept()
        hint = "Reload the page; it may be older or newer than this server."
        problem = wire.Problem("bad-subprotocol", f"This server speaks {wire.SUBPROTOCOL}.", hint)
        await socket.send_text(wire_codec.encode_text(problem))
        await socket.close(1002, "subprotocol")
        return
    await socket.accept(wire.SUBPROTOCOL)
    stuck_s = services.timings.stuck_s
    sender = WebSocketSender(socket, clients, stuck_s)
    state = socket.scope.get("state", {})
    # an operator commands a part of the robots of a fleet server: requests to the others are refused with the reason
    clients.attach(sender.queue, "control" if state.get("operator") else state.get("role", "control"))
    services.parts.viewed()
    _log(sender, f"is connected, from {sender.peer or 'an unknown peer'}.", logging.INFO)
    tasks = [
        asyncio.create_task(_listen(socket, clients, sender.queue), name="browser: receive"),
        asyncio.create_task(sender.run(clients.history_lock), name="browser: send"),
        asyncio.create_task(_watch(sender, clients), name="browser: watch"),
    ]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        if tasks[2] in done:
            _log(sender, f"took no byte for {stuck_s:g} s, or far too few, and was disconnected.")
            transport = socket.scope.get("extensions", {}).get("imuscope.transport")
            if transport is not None:
                transport.abort()
        for task in done:
            with contextlib.suppress(WebSocketDisconnect, RuntimeError, OSError):
                task.result()
    finally:
        clients.detach(sender.queue)
        queue = sender.queue
        figures = {"sent_bytes": queue.sent_bytes, "dropped": queue.dropped}
        _log(sender, f"has gone; {queue.sent_bytes / 1e6:.1f} MB sent.", logging.INFO, **figures)
        await end_tasks(*tasks)
