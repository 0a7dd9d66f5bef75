"""A Secure device that restarted is accepted again: `imuscope rearm [DEVICE]`.

    $ imuscope rearm 102 --server http://robot.local:8080 --token @control.token
    102 re-armed on 1 link of http://robot.local:8080.

Asks the running server; where none runs, the remembered numbers in the data folder are forgotten instead.
"""

from __future__ import annotations

import json
import urllib.error
import urllib.request
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from server.devices.sequence_store import SequenceStore

PATIENCE_S = 10.0


class RearmError(Exception):
    """Why it could not be done, in one sentence."""


@dataclass(frozen=True, slots=True)
class RearmRequest:
    """Whom to re-arm, and where.

    Args:
        device: as the stream names it (an IDTP device id); "" for every one.
        token: for control, "" where none is needed.
    """

    device: str
    server: str
    token: str
    data: Path


def rearm(wish: RearmRequest) -> str:
    """What was done, in a line.

    Raises:
        RearmError: it could not be done.
    """
    if wish.device and not (wish.device.isascii() and wish.device.isdigit() and int(wish.device) <= 0xFFFF):
        raise RearmError(f"a device is a number from 0 to 65535, given {wish.device!r:.40}")
    if not wish.server.startswith(("http://", "https://")):
        raise RearmError(f"{wish.server!r:.80} is not a valid address of a server; write http://host:port")
    whom = wish.device or "every device"
    try:
        devices = _ask(wish, "/api/devices")
    except ConnectionRefusedError:
        try:
            count = SequenceStore(wish.data).forget(None, int(wish.device) if wish.device else None)
        except OSError as error:
            raise RearmError(f"{wish.data} cannot be written: {error.strerror or error}") from None
        kept = "was forgotten" if count else "was not kept"
        return f"No server runs at {wish.server}; the last sequence number of {whom} {kept} in {wish.data}."
    links = [one["id"] for one in devices if not one["parent"] and one["protocol"] in ("idtp", "")]
    for link in links:
        _ask(wish, f"/api/devices/{link}/rearm", {"sender": wish.device})
    if not links:
        raise RearmError(f"{wish.server} has no IDTP device")
    return f"{whom} re-armed on {len(links)} link{'s' if len(links) > 1 else ''} of {wish.server}."


def _ask(wish: RearmRequest, path: str, body: Any = None) -> Any:
    """What the server answers. ConnectionRefusedError: there is none."""
    data = None if body is None else json.dumps(body).encode()
    request = urllib.request.Request(wish.server.rstrip("/") + path, data)
    if data is not None:
        request.add_header("Content-Type", "application/json")
    if wish.token:
        request.add_header("Authorization", f"Bearer {wish.token}")
    try:
        with urllib.request.urlopen(request, timeout=PATIENCE_S) as answer:
            return json.load(answer)
    except urllib.error.HTTPError as error:
        raise RearmError(_told(error)) from None
    except urllib.error.URLError as error:
        if isinstance(error.reason, ConnectionRefusedError):
            raise error.reason from None
        raise RearmError(f"{wish.server} does not answer: {error.reason}") from None
    except (OSError, ValueError) as error:
        raise RearmError(f"{wish.server} does not answer as a server of imuscope does: {error}") from None


def _told(error: urllib.error.HTTPError) -> str:
    """The server's own words."""
    try:
        told = json.load(error)
        return f"{told['message']} {told['hint']}".rstrip()
    except (ValueError, KeyError, TypeError):
        return f"the server answers {error.code}"
