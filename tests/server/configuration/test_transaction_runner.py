"""The trace of a transaction: where its generators are, and what they wait for."""

import asyncio
import logging
from collections.abc import Callable, Generator
from typing import Any

import pytest

from imuscope.protocols.commands.transactions import Send, WaitFor
from imuscope.protocols.events import Event
from imuscope.server.configuration.transaction_runner import Runner, position_of

SECRET = bytes.fromhex("00112233445566778899aabbccddeeff")


class SilentPort:
    """A device that never answers."""

    async def send(self, data: bytes) -> int | None:
        return None

    async def reopen(self, baud: int | None) -> None:
        raise AssertionError("nothing reopens it")

    def listen(self, callback: Callable[[Event], None]) -> Callable[[], None]:
        return lambda: None

    def decode(self) -> None:
        return


class NullLog:
    def sent(self, frame: bytes, what: str, written_ns: int | None) -> None:
        return

    def matched(self, event: Event, *, may_refuse: bool = False) -> None:
        return

    def add_note(self, text: str, *, error: bool = False) -> None:
        return


def inner() -> Generator[Any, Any, str]:
    yield Send(SECRET)
    yield WaitFor(lambda event: None, 0.05)
    return "done"


def outer() -> Generator[Any, Any, str]:
    result: str = yield from inner()
    return result


def test_a_running_transaction_states_where_it_is(caplog: pytest.LogCaptureFixture) -> None:
    async def play() -> None:
        runner = Runner(SilentPort(), NullLog())
        assert repr(runner) == "<Runner: idle>"
        job = asyncio.create_task(runner.run(outer()))
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        assert repr(runner).startswith("<Runner: outer:")
        assert " › inner:" in repr(runner)
        assert repr(runner).endswith(", WaitFor an event, 0.05 s>")
        assert await job == "done"
        assert repr(runner) == "<Runner: idle>"

    with caplog.at_level(logging.DEBUG, "imuscope.runner"):
        asyncio.run(play())
    [sent, waits, answer] = [record.getMessage() for record in caplog.records if record.name == "imuscope.runner"]
    assert sent.endswith(" << Send 16 B")
    assert waits.endswith(" << WaitFor an event, 0.05 s")
    assert answer.endswith(" >> NoneType")
    assert SECRET.hex() not in caplog.text


def test_an_ended_transaction_has_no_position() -> None:
    transaction = outer()
    transaction.close()
    assert position_of(transaction) == "ended"
