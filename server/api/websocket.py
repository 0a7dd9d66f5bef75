"""The WebSocket: what server/wire.py specifies, carried out for one browser.

Two tasks per browser: one reads its requests, one takes from its outbox and sends. Sending waits for the socket, never
for anything else, and nothing else waits for it; what a socket takes at once never comes here
(server/streaming/send_queue.py). A socket that does not take a byte for `STUCK_S` is closed: progress is seen in the
transport's buffer, so that a slow link that crawls is not taken for a dead one.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from typing import Any

from fastapi import APIRouter, WebSocket, WebSocketDisconnect

from server import wire, wire_codec
from server.streaming.hub import Hub
from server.streaming.send_queue import SendQueue

log = logging.getLogger("imuscope.live")
router = APIRouter()

STUCK_S = 5.0
MOST_WAITING_TEXT = 16 * 1024 * 1024  # bytes; text is never dropped, so who takes it so slowly is better connected anew
REQUESTS_PER_S, REQUESTS_AT_ONCE = 20.0, 60.0  # a page asks twice a second, and some dozen times when it is opened
LONGEST_INTERVAL_S = 0.1  # between two flushes, however seldom a page draws: what it shows when it does is this old
HISTORY_PAUSE_S = 0.002  # between two messages of history: 128 KiB each, so 60 MB/s at most, for all browsers together


class WebSocketSender:
    """Sends one outbox, and knows when the last byte moved."""

    def __init__(self, socket: WebSocket, hub: Hub) -> None:
        self._socket = socket
        self._hub = hub
        self._wake = asyncio.Event()
        extensions = socket.scope.get("extensions", {})
        self.outbox = SendQueue(self._wake.set, send_now=extensions.get("imuscope.send_now", lambda frame: False))
        self._transport: asyncio.WriteTransport | None = extensions.get("imuscope.transport")
        self.peer = socket.client.host if socket.client is not None else ""
        self._waiting = 0
        self._stuck_since: float | None = None

    async def run(self, pace: asyncio.Lock) -> None:
        """Send for ever. `pace` is shared: history is made for one browser at a time, so it never fills the loop."""
        outbox = self.outbox
        while True:
            message = outbox.take()
            if message is None and outbox.wants_history:
                async with pace:
                    message = outbox.take_history(self._hub.now())
                    await asyncio.sleep(HISTORY_PAUSE_S)
            if message is None:
                if outbox.idle:
                    self._wake.clear()
                    await self._wake.wait()
                continue
            outbox.sending_since = self._stuck_since = self._hub.now()
            if isinstance(message, str):
                await self._socket.send_text(message)
            else:
                await self._socket.send_bytes(message)
            outbox.sending_since = self._stuck_since = None
            outbox.sent_bytes += len(message)

    def is_stuck(self, now: float) -> bool:
        """Has no byte moved for `STUCK_S`, or does too much wait? To be asked about once a second."""
        if self.outbox.text_bytes > MOST_WAITING_TEXT:
            return True
        if self._stuck_since is None:
            return False
        waiting = self._transport.get_write_buffer_size() if self._transport is not None else self._waiting
        if waiting < self._waiting:
            self._stuck_since = now
        self._waiting = waiting
        return now - self._stuck_since > STUCK_S


class RequestThrottle:
    """So many a second, and some at once: who wants more waits, and so does what it sends, in its own socket."""

    def __init__(self, per_s: float, at_once: float, now: float) -> None:
        self._per_s, self._at_once = per_s, at_once
        self._left, self._at = at_once, now

    def wait(self, now: float) -> float:
        """Take one; how long to wait for it, s."""
        self._left = min(self._at_once, self._left + (now - self._at) * self._per_s) - 1
        self._at = now
        return max(0.0, -self._left / self._per_s)


async def _listen(socket: WebSocket, hub: Hub, outbox: SendQueue) -> None:
    """Serve the browser's requests until it goes, so many a second: a flood of them costs the others nothing."""
    pace = RequestThrottle(REQUESTS_PER_S, REQUESTS_AT_ONCE, hub.now())
    while True:
        message: dict[str, Any] = dict(await socket.receive())
        if message["type"] == "websocket.disconnect":
            return
        if wait := pace.wait(hub.now()):
            await asyncio.sleep(wait)
        try:
            text = message.get("text")
            if text is None:
                raise wire_codec.WireError(
                    "A browser sends text frames only.", "Binary frames carry samples to the browser."
                )
            request = wire_codec.decode_text(text)
        except wire_codec.WireError as error:
            outbox.say(wire_codec.encode_text(wire.Problem("bad-request", str(error), error.hint)))
            continue
        if isinstance(request, wire.Ping):
            outbox.say(wire_codec.encode_text(wire.Pong(request.t, hub.now())))
        elif isinstance(request, wire.Interval):
            outbox.interval_s = min(request.s, LONGEST_INTERVAL_S)
        else:
            hub.subscribe(outbox, request)


async def _watch(sender: WebSocketSender, hub: Hub) -> None:
    """Return when the browser is stuck; tell the log when it begins to lag."""
    told = 0
    while not sender.is_stuck(hub.now()):
        dropped = sender.outbox.dropped
        if dropped > told:
            _log(sender, f"does not keep up: {dropped} samples dropped so far.", dropped=dropped)
        told = dropped
        await asyncio.sleep(1.0)


def _log(sender: WebSocketSender, words: str, level: int = logging.WARNING, **data: object) -> None:
    number = sender.outbox.number
    data = {"client": number, "peer": sender.peer, **data}
    often = ("client", number) if level > logging.INFO else None
    log.log(level, "Browser %d %s", number, words, extra={"event": "client", "data": data, "often": often})


@router.websocket("/ws")
async def live(socket: WebSocket) -> None:
    """Everything that is live; see server/wire.py."""
    hub: Hub = socket.app.state.hub
    pace: asyncio.Lock = socket.app.state.history_pace
    if wire.SUBPROTOCOL not in socket.scope.get("subprotocols", []):
        await socket.accept()
        hint = "Reload the page; it may be older or newer than this server."
        problem = wire.Problem("bad-subprotocol", f"This server speaks {wire.SUBPROTOCOL}.", hint)
        await socket.send_text(wire_codec.encode_text(problem))
        await socket.close(1002, "subprotocol")
        return
    await socket.accept(wire.SUBPROTOCOL)
    sender = WebSocketSender(socket, hub)
    hub.attach(sender.outbox)
    _log(sender, f"is connected, from {sender.peer or 'an unknown peer'}.", logging.INFO)
    tasks = [
        asyncio.create_task(_listen(socket, hub, sender.outbox), name="browser listens"),
        asyncio.create_task(sender.run(pace), name="browser is sent"),
        asyncio.create_task(_watch(sender, hub), name="browser is watched"),
    ]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        if tasks[2] in done:
            _log(sender, f"took no byte for {STUCK_S:g} s, or far too few, and was disconnected.")
            transport = socket.scope.get("extensions", {}).get("imuscope.transport")
            if transport is not None:
                transport.abort()
        for task in done:
            with contextlib.suppress(WebSocketDisconnect, RuntimeError, OSError):
                task.result()
    finally:
        hub.detach(sender.outbox)
        outbox = sender.outbox
        figures = {"sent_bytes": outbox.sent_bytes, "dropped": outbox.dropped}
        _log(sender, f"has gone; {outbox.sent_bytes / 1e6:.1f} MB sent.", logging.INFO, **figures)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
