"""What sorts of errors are there, in one word for programs? Each word has one meaning, and one status of HTTP.

A program may act on a kind, so a kind is never used for two things, nor one thing called by two kinds.
tests/error_catalog.py reads all errors that the source can say and holds them against this table.

To add a kind, add a row; first look whether one here means the same.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Kind:
    """What a kind means, and with which status it is answered; 0: it only comes over a WebSocket."""

    status: int
    meaning: str


KINDS: Mapping[str, Kind] = {
    # how it is asked
    "bad-request": Kind(422, "A part of the request is not what its schema says, or does not fit the others."),
    "bad-span": Kind(422, "A stretch of time that is none."),
    "bad-value": Kind(422, "A value that a setting or a command cannot have."),
    "too-much": Kind(422, "The outputs would need more than the link carries."),
    "bad-snapshot": Kind(422, "A text or file that is no snapshot this version can use."),
    "bad-format": Kind(422, "A format of files that cannot be written."),
    "bad-source": Kind(400, "A source that is written wrongly: trying again cannot help."),
    "bad-protocol": Kind(400, "A protocol that there is not."),
    "bad-setting": Kind(400, "A setting of how a source is read that cannot be used."),
    "bad-subprotocol": Kind(0, "A WebSocket of another version of the wire."),
    "too-many": Kind(422, "An answer would be longer than may be asked at once."),
    "which-device": Kind(422, "A recording holds several devices, and none was named."),
    "not-json": Kind(415, "A body that is no JSON."),
    "not-a-file": Kind(415, "An upload that is not sent as the bytes of a file."),
    "too-large": Kind(413, "A body of more bytes than are taken."),
    "no-length": Kind(411, "A body that does not say how long it is."),
    "cut": Kind(400, "An upload that ended before it was whole."),
    "not-allowed": Kind(405, "A method that this address does not have."),
    "file-not-allowed": Kind(403, "A file outside the library and the folders that the settings name."),
    # who asks
    "no-token": Kind(401, "A token is needed."),
    "bad-token": Kind(401, "The token is not one of this server."),
    "too-many-tokens": Kind(429, "Too many wrong tokens came from that address."),
    "too-fast": Kind(429, "Too many requests came from that address."),
    "view-only": Kind(403, "The token may look, not change."),
    "bad-host": Kind(403, "The server was called by a name that is not its own."),
    "bad-origin": Kind(403, "Another page asks, which may not."),
    # what is there
    "not-found": Kind(404, "There is no such thing."),
    "busy": Kind(409, "It is in use already: by another program, or for the same."),
    "full": Kind(409, "There are as many as there may be; one has to end first."),
    "not-now": Kind(409, "It cannot be done in the state that it is in."),
    "not-read": Kind(409, "The device has to be read first."),
    "no-defaults": Kind(409, "A device whose factory settings no document tells."),
    "not-alike": Kind(409, "Devices or settings of another family, which cannot be compared."),
    "no-driver": Kind(409, "A device that cannot be configured."),
    "no-settings": Kind(409, "A device without settings."),
    "no-receiver": Kind(409, "A device that takes no corrections."),
    "no-rate": Kind(409, "No rates fit the link."),
    "confirm": Kind(409, "It could harm: it is done when it comes again with `confirmed`."),
    "name": Kind(409, "A name that is taken, or cannot be one."),
    "cannot-open": Kind(422, "A recording that cannot be read."),
    # the world
    "denied": Kind(403, "The system gives no permission."),
    "gone": Kind(502, "It was there, and is not any more."),
    "refused": Kind(502, "Nobody answers there, or it does not take what it was asked."),
    "ended": Kind(502, "A file has been played to its end."),
    "tile-server": Kind(502, "The server of map tiles did not answer well."),
    "disk": Kind(507, "The disk does not take it."),
    "no-view": Kind(503, "A viewer does not run."),
    "fault": Kind(500, "A fault of ours."),
}


def status_of(kind: str) -> int:
    """With which status an error of that kind is answered."""
    return KINDS[kind].status
