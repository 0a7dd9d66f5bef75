"""`imuscope rearm [DEVICE]`: accept a Secure device again after it restarted.

    $ imuscope rearm 102 --server http://robot.local:8080 --token @control.token
    102 re-armed on 1 link of http://robot.local:8080.

Sends the request to the running server; if none is running, the numbers stored in the data folder are deleted instead.
"""

import json
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any

from imuscope.protocols.schema.plural import counted
from imuscope.server.devices.decode.sequence_store import SequenceStore
from imuscope.server.errors import UsageError
from imuscope.server.text.printable import json_text, printable

TIMEOUT_S = 10.0


def rearm(device: str, server: str, token: str, data: Path, *, as_json: bool = False) -> str:
    """Re-arm a device and return a one-line summary, for people or as JSON.

    Args:
        device: id of the device in the stream (an IDTP device id); "" for all.
        token: control token of the server; "" if none is needed.
        data: the data folder, for when no server runs.

    Raises:
        UsageError: the device could not be re-armed.
    """
    if device and not (device.isascii() and device.isdigit() and int(device) <= 0xFFFF):
        raise UsageError(f"the device must be a number from 0 to 65535, not {device!r:.40}")
    if not server.startswith(("http://", "https://")):
        raise UsageError(f"{server!r:.80} is not a valid server address; write http://host:port")
    device_text = device or "every device"
    try:
        devices = _request(server, token, "/api/devices")
    except ConnectionRefusedError:
        try:
            count = SequenceStore(data).forget(None, int(device) if device else None)
        except OSError as error:
            raise UsageError(f"{data} cannot be written: {error.strerror or error}") from None
        if as_json:
            return json_text({"device": device, "links": [], "forgotten": bool(count)})
        outcome = "was deleted from" if count else "was not stored in"
        return printable(f"No server runs at {server}; the last sequence number of {device_text} {outcome} {data}.")
    links = [one["id"] for one in devices if not one["parent"] and _may_restart(one["protocol"])]
    for link in links:
        _request(server, token, f"/api/devices/{link}/rearm", {"sender": device})
    if not links:
        raise UsageError(f"{server} has no device with a sequence")
    if as_json:
        return json_text({"device": device, "links": links, "forgotten": True})
    return printable(f"{device_text} re-armed on {counted(len(links), 'link')} of {server}.")


def _may_restart(protocol: str) -> bool:
    """True if the protocol's decoder can be re-armed (events.Remembers), or is not known yet."""
    from imuscope.protocols.registry.families import PROTOCOLS  # imported on first use, because it loads compiled code

    return protocol not in PROTOCOLS or hasattr(PROTOCOLS[protocol].decoding.decoder, "rearm")


def _request(server: str, token: str, path: str, body: Any = None) -> Any:
    """Answer of the server.

    Raises:
        ConnectionRefusedError: no server is running there.
    """
    content = None if body is None else json.dumps(body).encode()
    http_request = urllib.request.Request(server.rstrip("/") + path, content)
    if content is not None:
        http_request.add_header("Content-Type", "application/json")
    if token:
        http_request.add_header("Authorization", f"Bearer {token}")
    try:
        with urllib.request.urlopen(http_request, timeout=TIMEOUT_S) as answer:
            return json.load(answer)
    except urllib.error.HTTPError as error:
        raise UsageError(_server_message(error)) from None
    except urllib.error.URLError as error:
        if isinstance(error.reason, ConnectionRefusedError):
            raise error.reason from None
        raise UsageError(f"{server} does not answer: {error.reason}") from None
    except (OSError, ValueError) as error:
        raise UsageError(f"{server} did not answer like an imuscope server: {error}") from None


def _server_message(error: urllib.error.HTTPError) -> str:
    try:
        problem = json.load(error)
        return f"{problem['message']} {problem['hint']}".rstrip()
    except (ValueError, KeyError, TypeError):
        return f"the server answered {error.code}"
