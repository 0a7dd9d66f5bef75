"""User-facing errors in the one shape {kind, message, hint}, and the table of kinds.

`DomainError` is raised when a request cannot be fulfilled, by code that is independent of HTTP; server/api/errors.py
converts it to a response, server/cli.py any ExplainedError to one line. A kind is one word for programs, with one
meaning and one HTTP status.

Programs may act on a kind, so a kind never has two meanings, nor does one error have two kinds. The test
tests/rules/test_errors.py collects all errors in the source and compares them with this table.

To add a kind, add a row; first check that no existing kind means the same.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from imuscope.recordings.errors import ExplainedError


@dataclass(frozen=True, slots=True)
class Kind:
    """Meaning of an error kind, and its HTTP status; 0: used on WebSockets only."""

    status: int
    meaning: str


KINDS: Mapping[str, Kind] = {
    # the request
    "bad-request": Kind(422, "The request does not match its schema, or its parts contradict each other."),
    "bad-span": Kind(422, "Invalid time range."),
    "bad-value": Kind(422, "Invalid value of a setting or a command."),
    "too-much": Kind(422, "The outputs would exceed the capacity of the link."),
    "bad-snapshot": Kind(422, "The text or file is not a snapshot that this version can use."),
    "bad-format": Kind(422, "The file format cannot be written."),
    "bad-source": Kind(400, "Invalid source; retrying does not help."),
    "bad-protocol": Kind(400, "Unknown protocol."),
    "bad-setting": Kind(400, "Invalid decode option."),
    "bad-subprotocol": Kind(0, "The WebSocket uses another version of the wire."),
    "too-many": Kind(422, "The request exceeds a limit of one: rows, samples, memory or time."),
    "which-message": Kind(422, "Several messages of the device have a signal of that name."),
    "which-device": Kind(422, "The recording has several devices, and none was named."),
    "bad-expression": Kind(422, "The expression cannot be understood, or its parts do not fit."),
    "bad-query": Kind(422, "The question about a store is not valid SQL, does not only read, or exceeds its limits."),
    "no-result": Kind(422, "The samples do not determine the result that was requested."),
    "not-json": Kind(415, "The body is not JSON."),
    "not-a-file": Kind(415, "The upload is not sent as the bytes of a file."),
    "too-large": Kind(413, "The body is too large."),
    "no-length": Kind(411, "The body has no length."),
    "cut": Kind(400, "The upload is incomplete."),
    "not-allowed": Kind(405, "The address does not support this method."),
    "file-not-allowed": Kind(403, "The file is outside the library and the configured folders."),
    # access
    "no-token": Kind(401, "A token is needed."),
    "bad-token": Kind(401, "The token is invalid."),
    "too-many-tokens": Kind(429, "Too many wrong tokens were sent from that address."),
    "too-fast": Kind(429, "Too many requests were sent from that address."),
    "view-only": Kind(403, "The token is view-only."),
    "bad-host": Kind(403, "The server was addressed by a name that is not its own."),
    "bad-origin": Kind(403, "Requests from another page are not allowed."),
    "own-webhook": Kind(403, "The request is a webhook of imuscope, which may not act on imuscope."),
    # state
    "not-found": Kind(404, "Not found."),
    "busy": Kind(409, "Already in use, by another program or for the same purpose."),
    "full": Kind(409, "The maximum number is reached; one has to end first."),
    "changed": Kind(412, "It was changed by another client since it was read."),
    "not-now": Kind(409, "Not possible in the present state."),
    "not-read": Kind(409, "The device has to be read first."),
    "no-defaults": Kind(409, "The factory settings of the device are not documented."),
    "not-alike": Kind(409, "Devices or settings of another family, which cannot be compared."),
    "no-driver": Kind(409, "The device cannot be configured."),
    "no-settings": Kind(409, "The device has no settings."),
    "no-receiver": Kind(409, "The device does not accept corrections."),
    "no-rate": Kind(409, "No rates fit the link."),
    "no-store": Kind(409, "The server has no store of recordings."),
    "confirm": Kind(409, "The request could do harm; it is carried out when sent again with `confirmed`."),
    "name": Kind(409, "The name is taken or invalid."),
    "cannot-open": Kind(422, "The recording cannot be read."),
    # system and network
    "denied": Kind(403, "Permission denied by the system."),
    "gone": Kind(502, "No longer available."),
    "refused": Kind(502, "No answer from there, or the request was refused."),
    "ended": Kind(502, "The file has been played to its end."),
    "tile-server": Kind(502, "The server of map tiles failed."),
    "store": Kind(502, "The store of recordings cannot be used."),
    "disk": Kind(507, "Writing to disk failed."),
    "no-extension": Kind(503, "The part of the server that does this is not installed."),
    "no-view": Kind(503, "The viewer is not running."),
    "fault": Kind(500, "Internal error."),
}


class UsageError(ExplainedError):
    """A command of the command line that cannot be carried out: one sentence, which may lack its full stop."""


class DomainError(ExplainedError):
    """A request that cannot be fulfilled: a kind of KINDS, a sentence for the user, and what to do next ("": none)."""

    def __init__(self, kind: str, message: str, hint: str = "") -> None:
        super().__init__(message, hint)
        self.kind = kind


def unknown_device(device: str) -> DomainError:
    """The refusal of a request that names no device."""
    hint = "It may have been removed; choose one of the list."
    return DomainError("not-found", f"Device {device:.40} not found.", hint)


def status_of(kind: str) -> int:
    """HTTP status of an error kind."""
    return KINDS[kind].status
