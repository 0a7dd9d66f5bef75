"""The state machine of a connection: legal and rejected events in every state, and a session that follows it."""

import asyncio
import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from imuscope.server.devices.decode.decode_options import DecodeOptions
from imuscope.server.devices.link.connection_state import (
    OPEN_STATES,
    TRANSITIONS,
    Connection,
    ConnectionEvent,
    ConnectionState,
    IllegalTransitionError,
)
from imuscope.server.devices.link.session import Session
from imuscope.server.links.base import LinkError, LinkSettings
from imuscope.server.streaming.telemetry import Telemetry
from tests.support import virtual_time
from tests.support.decode_options import decode_options
from tests.support.each_row import each_row
from tests.support.fakes import SPEECH, FakeClock, FakeLink, sample

# Expected table in another notation: the letters of the events (in their order) accepted in a state.
LEGAL = {
    "closed": "S.......C",
    "opening": ".O..fn.rC",
    "waiting": "..DQfn.rC",
    "live": "...Qfn.rC",
    "silent": "..DQfn.rC",
    "retrying": "......RrC",
    "stopped": "......RrC",
}
LEADS_TO = {
    "start": "opening",
    "opened": "waiting",
    "decoded": "live",
    "silence": "silent",
    "failed": "retrying",
    "finished": "stopped",
    "retry": "opening",
    "reopen": "opening",
    "close": "closed",
}
PATHS = {  # how to come to each state
    ConnectionState.CLOSED: [],
    ConnectionState.OPENING: ["start"],
    ConnectionState.WAITING: ["start", "opened"],
    ConnectionState.LIVE: ["start", "opened", "decoded"],
    ConnectionState.SILENT: ["start", "opened", "decoded", "silence"],
    ConnectionState.RETRYING: ["start", "failed"],
    ConnectionState.STOPPED: ["start", "finished"],
}


def machine_in(state: ConnectionState) -> Connection:
    connection = Connection()
    for event in PATHS[state]:
        connection.apply(ConnectionEvent(event))
    assert connection.state is state
    return connection


@each_row("state", ConnectionState, ids=lambda state: state.value)
@each_row("number", range(len(ConnectionEvent)), ids=[event.value for event in ConnectionEvent])
def test_every_event_in_every_state(state: ConnectionState, number: int) -> None:
    event = list(ConnectionEvent)[number]
    connection = machine_in(state)
    legal = LEGAL[state.value][number] != "."
    assert connection.allows(event) is legal
    if legal:
        assert connection.apply(event) is connection.state is ConnectionState(LEADS_TO[event.value])
    else:
        with pytest.raises(IllegalTransitionError, match="is not legal in state") as caught:
            connection.apply(event)
        assert (caught.value.state, caught.value.event) == (state, event)
        assert connection.state is state


def test_the_table_has_a_row_for_every_state_and_leaves_none_unreachable() -> None:
    assert set(TRANSITIONS) == set(ConnectionState)
    assert {to for row in TRANSITIONS.values() for to in row.values()} == set(ConnectionState)


@given(st.lists(st.sampled_from(ConnectionEvent), max_size=60))
def test_any_event_sequence_keeps_the_invariants(events: list[ConnectionEvent]) -> None:
    """A rejected event changes no state; a link that was not reopened is neither decoded nor silent; after CLOSE only
    START is accepted.
    """
    connection, opened = Connection(), False
    for event in events:
        before = connection.state
        if not connection.allows(event):
            with pytest.raises(IllegalTransitionError):
                connection.apply(event)
            assert connection.state is before
            continue
        connection.apply(event)
        if event is ConnectionEvent.OPENED:
            opened = True
        elif event not in (ConnectionEvent.DECODED, ConnectionEvent.SILENCE):
            opened = False
        assert connection.is_open is opened is (connection.state in OPEN_STATES)
        if before is ConnectionState.CLOSED:
            assert event in (ConnectionEvent.START, ConnectionEvent.CLOSE)


STEPS = st.lists(
    st.sampled_from(["bytes", "die", "deny", "end", "retry", "silence", "reopen", "tick", "decode", "refuse", "rekey"]),
    max_size=25,
)
SHOWN = {
    ConnectionState.LIVE: {"live"},
    ConnectionState.SILENT: {"lost"},
    ConnectionState.RETRYING: {"lost", "denied", "connecting"},
    ConnectionState.STOPPED: {"ended", "idle"},
}


class Simulated(FakeLink):
    """Switched off and on when its key is changed."""

    kind = "simulator"


@given(STEPS)
def test_the_state_machine_agrees_with_the_reported_status(steps: list[str]) -> None:
    async def run() -> None:
        clock = FakeClock()
        link = Simulated("sim:fake", LinkSettings(now_ns=clock.now_ns))
        telemetry = Telemetry.create(clock)
        session = Session("1", link, telemetry.bus, SPEECH, DecodeOptions("fake"))
        session.start()
        sent = 0
        for step in steps:
            match step:
                case "bytes":
                    link.send(sample(sent % 250))
                    sent += 1
                case "die":
                    link.die(LinkError("gone", "gone.", "?"))
                case "deny":
                    link.die(LinkError("denied", "denied.", "?"))
                case "end":
                    link.die(LinkError("ended", "over.", "?"))
                case "refuse":
                    link.refuses.append(LinkError("bad-source", "no such thing.", "?"))
                case "retry":
                    session.retry()
                case "reopen":
                    with contextlib.suppress(LinkError):
                        await session.access.reopen()
                case "rekey":
                    await session.read_as(decode_options("fake", key=bytes([sent % 250])))
                case "silence":
                    for _ in range(40):
                        clock.move(0.1)
                        session.tick(clock())
                case "tick":
                    clock.move(0.1)
                    session.tick(clock())
                case "decode":
                    session.access.decode()
            await asyncio.sleep(0.2)
            state = session._connection.state
            assert session.info.status in SHOWN.get(state, {session.info.status}), (state, step)
            assert session.info.is_open is session._connection.is_open, (state, step)
            assert session._task is not None
            assert not session._task.done(), "it is still tried"
        await session.close()
        assert session._connection.state is ConnectionState.CLOSED
        assert dict(telemetry.bus.devices.latest) == {}

    virtual_time.run(run())
