"""Messages that carry the pages of a robot over the bus, in MessagePack, with a limit for everything.

    fleet server                                       robot
    OpenStream      a request, or a WebSocket    ──>
                                                 <──   ResponseHead   status and headers, or the WebSocket is accepted
                                                 <──   ResponsePart   a piece of the body or of a WebSocket message
    Acknowledge     bytes that were delivered    ──>
    ClientMessage   a message of the browser     ──>
    CancelStream    the viewer disconnected      ──>
                                                 <──   EndStream      it is complete, or the WebSocket is closed
                                                 <──   StreamError    it is refused, or broken
    KeepAlive       sent while a stream is open  <─>

Each stream has a number that its fleet server gave it, and the messages of a stream are numbered from 0 in each
direction, so that a lost one is noticed: the stream then ends. Bytes that a robot sends before they are acknowledged
are limited by a window (flow_control.py). docs/fleet.md is the specification. `decode_request` and `decode_answer`
raise TunnelMessageError and nothing else, for any bytes.
"""

from typing import Annotated, Literal, TypeVar

import msgspec
from msgspec import Meta

from imuscope.server.extensions.fleet.model.reports import Boot

MAX_BODY = 256 * 1024  # bytes of a request
MAX_PART = 16 * 1024
MAX_CLIENT_MESSAGE = 64 * 1024  # as of every browser (server/http/server.py)
MAX_REQUEST = MAX_BODY + 128 * 1024
MAX_ANSWER = 64 * 1024
MAX_OPEN = 64  # streams of a robot

Number = Annotated[int, Meta(ge=0, le=2**53 - 1)]
Path = Annotated[str, Meta(max_length=2000, pattern="^/")]
Query = Annotated[str, Meta(max_length=16_000)]
Method = Literal["GET", "HEAD", "POST", "PUT", "PATCH", "DELETE"]
HeaderName = Annotated[str, Meta(max_length=100, pattern="^[a-z0-9-]+$")]
HeaderText = Annotated[str, Meta(max_length=4000, pattern=r"^[\t\x20-\x7e\xa0-\xff]*\Z")]
Headers = Annotated[tuple[tuple[HeaderName, HeaderText], ...], Meta(max_length=40)]
Subprotocol = Annotated[str, Meta(max_length=100, pattern="^[A-Za-z0-9._-]*$")]
Words = Annotated[str, Meta(max_length=500)]
Kind = Annotated[str, Meta(max_length=40, pattern="^[a-z-]+$")]


class TunnelMessageError(ValueError):
    """An invalid message: the reason as one sentence."""


class OpenStream(msgspec.Struct, frozen=True, tag="open"):
    """A request.

    Args:
        boot: run of the robot's server that is meant.
        query: without "?".
        role: of the viewer at the fleet server.
        who: the viewer, for the log of commands.
        peer: address of the viewer, for limits per address.
        socket: subprotocols of a WebSocket; None for a request.
    """

    stream: Number
    boot: Boot
    method: Method
    path: Path
    query: Query = ""
    headers: Headers = ()
    body: Annotated[bytes, Meta(max_length=MAX_BODY)] = b""
    role: Literal["view", "control"] = "view"
    who: Annotated[str, Meta(max_length=100)] = ""
    peer: Annotated[str, Meta(max_length=64)] = ""
    socket: Annotated[tuple[Subprotocol, ...], Meta(max_length=8)] | None = None
    number: Literal[0] = 0
    version: Literal[1] = 1


class ClientMessage(msgspec.Struct, frozen=True, tag="say"):
    """A text message of the browser."""

    stream: Number
    number: Number
    text: Annotated[str, Meta(max_length=MAX_CLIENT_MESSAGE)]


class Acknowledge(msgspec.Struct, frozen=True, tag="taken"):
    """Bytes delivered to the viewer since the beginning of the stream (flow control)."""

    stream: Number
    number: Number
    size: Number


class CancelStream(msgspec.Struct, frozen=True, tag="stop"):
    """The viewer disconnected."""

    stream: Number
    number: Number


class KeepAlive(msgspec.Struct, frozen=True, tag="beat"):
    """Keep-alive, sent while a stream is open and echoed by the robot.

    Args:
        last: the newest stream that the fleet server has opened.
        open: of the robot: the streams that are open there, after all that it sent of others.
    """

    boot: Boot
    last: Number = 0
    open: Annotated[tuple[Number, ...], Meta(max_length=MAX_OPEN)] = ()


class ResponseHead(msgspec.Struct, frozen=True, tag="head"):
    """Status and headers; of a WebSocket: it is accepted, with this subprotocol."""

    stream: Number
    number: Number
    status: Annotated[int, Meta(ge=200, le=599)] = 200
    headers: Headers = ()
    subprotocol: Subprotocol = ""


class ResponsePart(msgspec.Struct, frozen=True, tag="part"):
    """A piece of the body, or of a message of a WebSocket.

    Args:
        is_text: the message is text.
        is_last: the message ends here.
    """

    stream: Number
    number: Number
    data: Annotated[bytes, Meta(max_length=MAX_PART)]
    is_text: bool = False
    is_last: bool = False


class EndStream(msgspec.Struct, frozen=True, tag="end"):
    """The answer is complete, or the WebSocket was closed with this code."""

    stream: Number
    number: Number
    code: Annotated[int, Meta(ge=1000, le=4999)] = 1000
    reason: Words = ""


class StreamError(msgspec.Struct, frozen=True, tag="fail"):
    """The stream ends with a problem: a kind of server/errors.py, a sentence, and what to do."""

    stream: Number
    number: Number
    kind: Kind
    message: Words
    hint: Words = ""


TunnelRequest = OpenStream | ClientMessage | Acknowledge | CancelStream | KeepAlive
Answer = ResponseHead | ResponsePart | EndStream | StreamError | KeepAlive
T = TypeVar("T", TunnelRequest, Answer)
_encoder = msgspec.msgpack.Encoder()
_requests: msgspec.msgpack.Decoder[TunnelRequest] = msgspec.msgpack.Decoder(TunnelRequest)
_answers: msgspec.msgpack.Decoder[Answer] = msgspec.msgpack.Decoder(Answer)


def encode(message: TunnelRequest | Answer) -> bytes:
    return _encoder.encode(message)


def decode_request(data: bytes) -> TunnelRequest:
    """The message of a fleet server in these bytes.

    Raises:
        TunnelMessageError: it is invalid.
    """
    return _decoded(data, _requests, MAX_REQUEST)


def decode_answer(data: bytes) -> Answer:
    """The message of a robot in these bytes.

    Raises:
        TunnelMessageError: it is invalid.
    """
    return _decoded(data, _answers, MAX_ANSWER)


def _decoded(data: bytes, decoder: msgspec.msgpack.Decoder[T], limit: int) -> T:
    if len(data) > limit:
        raise TunnelMessageError(f"The message has {len(data)} bytes; at most {limit} are allowed.")
    try:
        return decoder.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise TunnelMessageError(f"The message is not valid: {error!s:.200}.") from None
