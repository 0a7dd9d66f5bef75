"""Fuzzing of the WebSocket.

    a sequence of steps ──> a connection of its own ──> an answer of our shape, or the connection ends
     valid, nearly valid, garbage,                              │
     binary, torn frames, floods                                v
    a witness, connected all the while ──────────> still gets its pong and its health, in time

The steps of /ws are drawn by hypothesis from the operations of server/wire/; /foxglove, the sockets of the viewers
and of a recording's scene get the same in a small dose: nothing is known of their answers but that they end well. For
every sequence: no traceback in the log, the memory within bounds, the witness undisturbed. Afterwards a client that is
still connected gets the pong of its ping, whatever it said before.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, NamedTuple

from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st
from websockets.exceptions import ConnectionClosed, InvalidHandshake
from websockets.sync.client import ClientConnection
from websockets.typing import Subprotocol

from imuscope.server.wire import SUBPROTOCOL
from tests.fuzz.cases import BrokenError, write_json
from tests.fuzz.http import FuzzedServer
from tests.support.timeouts import PATIENCE_S, connect

ANSWERS = {
    "hello", "devices", "channels", "health", "unknown_payloads", "events", "jobs", "recorder", "library", "exports",
    "traffic", "history_end", "pong", "error",
}  # fmt: skip
MOST_BEFORE_PONG = 10_000  # messages: of slow simulators, for many minutes
ENDS = (1000, 1002, 1003, 1005, 1006, 1007, 1008, 1009)
"""How a connection may end; 1011 is a fault of the server, 1006 is what a torn frame leaves."""
OTHERS = (*2 * [("/foxglove", "foxglove.sdk.v1"), ("/rerun/live", "")], ("/ws/scene/R", ""), ("/viser", "viser-v1"))


class Step(NamedTuple):
    """One step; `raw` are bytes on the connection itself, between or instead of frames."""

    kind: Literal["text", "binary", "raw"]
    data: str  # of binary and raw the hex
    times: int = 1


class Talk(NamedTuple):
    """Steps of one client."""

    path: str
    protocol: str
    steps: list[Step]

    def write(self, name: str, showed: str) -> Path:
        """Keep it."""
        return write_json("ws", name, showed, self._asdict())

    @staticmethod
    def read(path: Path) -> Talk:
        """One that was kept."""
        document = json.loads(path.read_text())
        return Talk(document["path"], document["protocol"], [Step(*step) for step in document["steps"]])


# -- what is said ------------------------------------------------------------------------------------------------------

_numbers = st.one_of(
    st.integers(),
    st.floats(),
    st.sampled_from([0, -1, 2**31, 2**53, 2**64, 10**40, 10**400, 1e308, -1e308, 1e-320, float("nan"), float("inf")]),
)
_anything = st.recursive(
    st.none() | st.booleans() | _numbers | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=8,
)
_ids = st.lists(st.integers(0, 60) | st.integers(), max_size=30)
_pings = st.fixed_dictionaries({"op": st.just("ping"), "t": _numbers})
_subscribes = st.fixed_dictionaries(
    {"op": st.just("subscribe"), "history": st.floats(0, 1e5) | _numbers, "channels": st.none() | _ids}
)


@st.composite
def _nearly(draw: st.DrawFn) -> Any:
    """A request with something else in it, without something, or of another op."""
    request = dict(draw(_pings | _subscribes))
    name = draw(st.sampled_from([*request, "more"]))
    if draw(st.booleans()):
        request[name] = draw(_anything)
    else:
        request.pop(name, None)
    return request


def _text_of(value: Any) -> str:
    return json.dumps(value)  # NaN and Infinity as Python writes them: no JSON, but common


_garbage = st.one_of(
    st.text(max_size=60),
    st.sampled_from(
        ["", "{", "[" * 50_000, '{"op":' * 9_000, '{"op":"ping","t":' + "9" * 5000 + "}", "null", '"ping"', "\x00",
         "1" * 60_000, '{"op":"ping","op":"subscribe"}', '{"op":"ping","t":1}garbage', '{"op":"\\ud800"}',
         '{"op":"hello"}', "x" * 70_000]
    ),
)  # fmt: skip
_words = st.one_of(
    _pings.map(_text_of), _subscribes.map(_text_of), _nearly().map(_text_of), _anything.map(_text_of), _garbage
)
_torn = st.one_of(
    st.binary(max_size=40),  # frames without a mask, of unknown kinds, of reserved bits
    st.sampled_from(
        [
            bytes([0x81, 0xFF]) + b"\xff" * 8,  # a text of 2^64 bytes
            bytes([0x81, 0xFE, 0xFF, 0xFF]),  # a frame of 65535 bytes that never arrives
            bytes([0x89, 0xFE, 0x01, 0x00]),  # a ping longer than a ping may be
            bytes([0x80, 0x80, 0, 0, 0, 0]),  # the rest of nothing
            bytes([0x01, 0x81, 0, 0, 0, 0, 0x7B]),  # the beginning of a text, no end
            bytes([0x81, 0x82, 0, 0, 0, 0, 0xC3, 0x28]),  # no UTF-8
            bytes([0x88, 0x81, 0, 0, 0, 0, 0x01]),  # a close with half a code
            bytes([0x88, 0x82, 0, 0, 0, 0, 0x00, 0x00]),  # a close with code 0
            bytes([0x91, 0x80, 0, 0, 0, 0]),  # reserved bits
        ]
    ),
)
_once = st.just(1)
_steps = st.one_of(
    st.builds(Step, st.just("text"), _words, _once),
    st.builds(Step, st.just("text"), _words, _once),
    st.builds(Step, st.just("text"), _words, st.sampled_from([2, 2, 2, 5, 5, 60])),
    st.builds(Step, st.just("binary"), st.binary(max_size=200).map(bytes.hex), _once),
    st.builds(Step, st.just("raw"), _torn.map(bytes.hex), _once),
)
_binary = st.builds(Step, st.just("binary"), st.binary(max_size=200).map(bytes.hex), _once)
_theirs = st.sampled_from(['{"op":"subscribe","subscriptions":[{"id":1,"channelId":99}]}', "{}", "7"])
_foreign = st.one_of(
    st.builds(Step, st.just("text"), _theirs | _words, _once),
    _binary,
    st.builds(Step, st.just("raw"), _torn.map(bytes.hex), _once),
)  # fmt: skip

live_talks = st.builds(Talk, st.just("/ws"), st.sampled_from([SUBPROTOCOL] * 9 + [""]), st.lists(_steps, max_size=8))
other_talks = st.builds(
    lambda other, steps: Talk(*other, steps), st.sampled_from(OTHERS), st.lists(_foreign, max_size=6)
)


# -- who says it -------------------------------------------------------------------------------------------------------


class Floor:
    """A server, a witness, and clients that come and go.

    Args:
        server: with simulators.
    """

    def __init__(self, server: FuzzedServer) -> None:
        self.server = server
        self.talks = 0
        self.ended: dict[int, int] = {}
        self._url = server.url.replace("http", "ws", 1)
        self._witness = self._connected("/ws", SUBPROTOCOL)
        self._witness.send(json.dumps({"op": "subscribe", "history": 0, "channels": []}))

    def close(self) -> None:
        """Let the witness go."""
        self._witness.close()

    def hold(self, talk: Talk) -> None:
        """Play all steps of one client.

        Raises:
            BrokenError: the server violated an invariant.
        """
        self.talks += 1
        try:
            client = self._connected(talk.path, talk.protocol)
        except (InvalidHandshake, OSError):
            client = None  # refused; for the others, missing items are
        if client is not None:
            code = self._talk(client, talk)
            self.ended[code] = self.ended.get(code, 0) + 1
            if code not in ENDS and not (talk.path != "/ws" and code in (1011, 1013)):
                raise BrokenError("code", f"the connection ended with {code}")
        self._check_the_witness()
        self.server.check()

    def _connected(self, path: str, protocol: str) -> ClientConnection:
        protocols = [Subprotocol(protocol)] if protocol else None
        return connect(
            self._url + path,
            subprotocols=protocols,
            compression=None,
            close_timeout=1,
            max_size=None,
            max_queue=None,  # the witness reads everything immediately
            ping_interval=None,
        )

    def _talk(self, client: ClientConnection, talk: Talk) -> int:
        """Says it; the code with which the connection ended, 1000 where we ended it."""
        torn = False
        try:
            for step in talk.steps:
                for _ in range(step.times):
                    if step.kind == "raw":
                        torn = torn or bool(step.data)
                        client.socket.sendall(bytes.fromhex(step.data))
                    else:
                        text = step.kind == "text"
                        client.send(_whole(step.data) if text else bytes.fromhex(step.data))
            if talk.path == "/ws" and talk.protocol and not torn:
                self._pong(client, f"{self.talks}.5")
        except ConnectionClosed as closed:
            return closed.rcvd.code if closed.rcvd is not None else 1006
        except OSError:
            return 1006
        finally:
            with contextlib.suppress(OSError):
                client.socket.shutdown(2)
            client.close()
        return 1000

    def _pong(self, client: ClientConnection, number: str) -> None:
        """The pong of a ping with a unique value; every message before it is checked for its format."""
        client.send(f'{{"op":"ping","t":{number}}}')
        for _ in range(MOST_BEFORE_PONG):
            try:
                message = client.recv(timeout=PATIENCE_S)
            except TimeoutError:
                break
            if isinstance(message, bytes):
                continue
            answer = json.loads(message)
            if answer.get("op") not in ANSWERS:
                raise BrokenError("answer", message[:300])
            if answer["op"] == "error":
                _check_problem(answer)
            if answer["op"] == "pong" and answer["t"] == float(number):
                return
        raise BrokenError("hang", f"no pong for {PATIENCE_S:g} s, or not among {MOST_BEFORE_PONG} messages")

    def _check_the_witness(self) -> None:
        try:
            self._pong(self._witness, f"{self.talks}.25")
        except ConnectionClosed as closed:
            raise BrokenError("witness", f"another client was disconnected: {closed}") from None


def _whole(text: str) -> str:
    """The text in a form the library can send: unpaired surrogates are escaped as JSON or omitted."""
    return text.encode("utf-8", "replace").decode()


def _check_problem(answer: dict[str, Any]) -> None:
    words = [answer.get(name) for name in ("kind", "message", "hint")]
    if set(answer) != {"op", "kind", "message", "hint"} or not all(isinstance(word, str) for word in words):
        raise BrokenError("shape", f"{answer!s:.300}")
    if not answer["message"].endswith(".") or len(answer["message"]) > 300 or len(answer["hint"]) > 300:
        raise BrokenError("shape", f"{answer!s:.700}")


def talks(floor: Floor, first: int, examples: int) -> Iterator[tuple[Talk, BrokenError]]:
    """So many sequences to /ws and a tenth of them to the others; gives what broke."""
    yield from _some(floor, live_talks, first, examples)
    yield from _some(floor, other_talks, first, max(1, examples // 10))


def _some(floor: Floor, drawn: st.SearchStrategy[Talk], first: int, examples: int) -> list[tuple[Talk, BrokenError]]:
    broken: list[tuple[Talk, BrokenError]] = []

    @seed(first)
    @settings(
        max_examples=examples,
        phases=(Phase.generate,),
        database=None,
        deadline=None,
        derandomize=False,
        suppress_health_check=list(HealthCheck),
    )
    @given(drawn)
    def one(talk: Talk) -> None:
        try:
            floor.hold(talk)
        except BrokenError as error:
            broken.append((talk, error))

    one()
    return broken
