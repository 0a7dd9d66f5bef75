"""Time limits of tests. For as long as nobody would: the machine is busy with others.

A limit is there to end a test that would hang, and says nothing about how quick a thing is; those that libraries have
by themselves (5 s for a request, 10 s for the handshake of a WebSocket) are too short for that. So everything that
talks to a server takes its limit from here.
"""

import ssl
import urllib.error
import urllib.request
from functools import partial

import httpx
import websockets.asyncio.client
import websockets.sync.client

PATIENCE_S = 120.0

connect = partial(websockets.sync.client.connect, open_timeout=PATIENCE_S)
"""A WebSocket, for tests without an event loop."""
connecting = partial(websockets.asyncio.client.connect, open_timeout=PATIENCE_S)
"""A WebSocket, for tests with one."""

_TRUST_NONE = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)  # the world's authorities take 50 ms to read, for each client

http_client = partial(httpx.Client, timeout=PATIENCE_S, verify=_TRUST_NONE)
"""Asks a server without TLS; with `verify` one that has it."""
get = partial(httpx.get, timeout=PATIENCE_S, verify=_TRUST_NONE)


def status_of(url: str) -> int:
    """Status of the answer."""
    try:
        with urllib.request.urlopen(url, timeout=PATIENCE_S) as answer:
            return int(answer.status)
    except urllib.error.HTTPError as error:
        return error.code
