"""`imuscope rearm [DEVICE]`: accept a Secure device again after it restarted.

    $ imuscope rearm 102 --server http://robot.local:8080 --token @control.token
    102 re-armed on 1 link of http://robot.local:8080.

Sends the request to the running server; if none is running, the numbers stored in the data folder are deleted instead.
"""

from __future__ import annotations

import json
import urllib.error
import urllib.request
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from imuscope.protocols.plural import counted
from imuscope.server.devices.sequence_store import SequenceStore

TIMEOUT_S = 10.0


class RearmError(Exception):
    """The reason of a failure, in one sentence."""


@dataclass(frozen=True, slots=True)
class RearmRequest:
    """Device to re-arm, and its server.

    Args:
        device: id of the device in the stream (an IDTP device id); "" for all.
        token: control token; "" if none is needed.
    """

    device: str
    server: str
    token: str
    data: Path


def rearm(request: RearmRequest) -> str:
    """Re-arm a device and return a one-line summary.

    Raises:
        RearmError: the device could not be re-armed.
    """
    if request.device and not (request.device.isascii() and request.device.isdigit() and int(request.device) <= 0xFFFF):
        raise RearmError(f"the device must be a number from 0 to 65535, not {request.device!r:.40}")
    if not request.server.startswith(("http://", "https://")):
        raise RearmError(f"{request.server!r:.80} is not a valid server address; write http://host:port")
    device_text = request.device or "every device"
    try:
        devices = _request(request, "/api/devices")
    except ConnectionRefusedError:
        try:
            count = SequenceStore(request.data).forget(None, int(request.device) if request.device else None)
        except OSError as error:
            raise RearmError(f"{request.data} cannot be written: {error.strerror or error}") from None
        outcome = "was deleted from" if count else "was not stored in"
        return (
            f"No server runs at {request.server}; the last sequence number of {device_text} {outcome} {request.data}."
        )
    links = [one["id"] for one in devices if not one["parent"] and _may_restart(one["protocol"])]
    for link in links:
        _request(request, f"/api/devices/{link}/rearm", {"sender": request.device})
    if not links:
        raise RearmError(f"{request.server} has no device with a sequence")
    return f"{device_text} re-armed on {counted(len(links), 'link')} of {request.server}."


def _may_restart(protocol: str) -> bool:
    """True if the protocol's decoder can be re-armed (events.Remembers), or is not known yet."""
    from imuscope.protocols.registry import PROTOCOLS  # imported on first use, because it loads compiled code

    return protocol not in PROTOCOLS or hasattr(PROTOCOLS[protocol].decoding.decoder, "rearm")


def _request(request: RearmRequest, path: str, body: Any = None) -> Any:
    """Answer of the server.

    Raises:
        ConnectionRefusedError: no server is running there.
    """
    data = None if body is None else json.dumps(body).encode()
    http_request = urllib.request.Request(request.server.rstrip("/") + path, data)
    if data is not None:
        http_request.add_header("Content-Type", "application/json")
    if request.token:
        http_request.add_header("Authorization", f"Bearer {request.token}")
    try:
        with urllib.request.urlopen(http_request, timeout=TIMEOUT_S) as answer:
            return json.load(answer)
    except urllib.error.HTTPError as error:
        raise RearmError(_server_message(error)) from None
    except urllib.error.URLError as error:
        if isinstance(error.reason, ConnectionRefusedError):
            raise error.reason from None
        raise RearmError(f"{request.server} does not answer: {error.reason}") from None
    except (OSError, ValueError) as error:
        raise RearmError(f"{request.server} did not answer like an imuscope server: {error}") from None


def _server_message(error: urllib.error.HTTPError) -> str:
    """The error text of the server."""
    try:
        problem = json.load(error)
        return f"{problem['message']} {problem['hint']}".rstrip()
    except (ValueError, KeyError, TypeError):
        return f"the server answered {error.code}"
